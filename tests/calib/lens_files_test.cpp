// Cameras in mrcal's and OpenCV's files: written by us, read by their own readers, and back to the last bit.
#include "calib/lens_files.h"

#include "core/error.h"
#include "core/file.h"
#include "tests/calib/synthetic_board_views.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
extern "C" {
#include <mrcal/mrcal.h>
}

namespace fringecal::calib {
namespace {

using ::testing::HasSubstr;

/// Numbers that need all their digits.
PlacedCamera camera_with_odd_numbers(double k3) {
  return {{.width_px = 1392,
           .height_px = 1040,
           .fx_px = 3721.0 + 1.0 / 3.0,
           .fy_px = 3720.123456789012,
           .cx_px = 1.0 / 7.0 + 700,
           .cy_px = 511.9999999999999,
           .distortion = {-0.1 / 3, 0.06 / 7, 1e-4 / 3, -1.7e-5, k3},
           .pixel_mm = {}},
          {rotation_from_vector({0.1, -0.37, 0.02}), {400.1, 3.3, -17.0 / 3}}};
}

std::filesystem::path written(const std::filesystem::path& folder, const PlacedCamera& p, LensFormat format) {
  const auto file = folder / (std::string("camera") + ending_of(format));
  write_atomically(file, lens_file(p, format, "made by a test\nsecond line"));
  return file;
}

TEST(LensFiles, ComeBackToTheLastBit) {
  const test::TemporaryFolder folder;
  for (const double k3 : {0.0, 0.011}) {
    const PlacedCamera p = camera_with_odd_numbers(k3);
    for (const LensFormat format : {LensFormat::mrcal, LensFormat::opencv}) {
      const PlacedCamera back = read_lens_file(written(folder.path(), p, format));
      EXPECT_EQ(back.camera.fx_px, p.camera.fx_px);
      EXPECT_EQ(back.camera.fy_px, p.camera.fy_px);
      EXPECT_EQ(back.camera.cx_px, p.camera.cx_px);
      EXPECT_EQ(back.camera.cy_px, p.camera.cy_px);
      EXPECT_EQ(back.camera.distortion, p.camera.distortion);
      EXPECT_EQ(back.camera.width_px, p.camera.width_px);
      EXPECT_EQ(back.camera.height_px, p.camera.height_px);
      // The pose goes through another parametrisation (rotation vector, matrix) and metres: some roundings of 1e-16.
      EXPECT_LT(back.cam_from_reference.rotation.angularDistance(p.cam_from_reference.rotation), 1e-15 * 10);
      EXPECT_LT((back.cam_from_reference.translation_mm - p.cam_from_reference.translation_mm).norm(), 1e-12);
    }
  }
}

TEST(LensFiles, MrcalsOwnReaderSeesTheSameCameraAndProjectsTheSame) {
  const test::TemporaryFolder folder;
  const model::Scanner scanner = test::known_scanner();
  for (const PlacedCamera& p : {camera_with_odd_numbers(0), camera_with_odd_numbers(0.011),
                                PlacedCamera{camera_of(scanner.projector), scanner.proj_from_cam}}) {
    const auto file = written(folder.path(), p, LensFormat::mrcal);
    mrcal_cameramodel_t* m = mrcal_read_cameramodel_file(file.c_str());
    ASSERT_NE(m, nullptr);
    EXPECT_EQ(m->lensmodel.type, p.camera.distortion[4] == 0 ? MRCAL_LENSMODEL_OPENCV4 : MRCAL_LENSMODEL_OPENCV5);
    EXPECT_EQ(m->intrinsics[0], p.camera.fx_px);
    EXPECT_EQ(m->intrinsics[3], p.camera.cy_px);
    EXPECT_EQ(m->intrinsics[5], p.camera.distortion[1]);
    EXPECT_EQ(m->imagersize[0], static_cast<unsigned>(p.camera.width_px));
    // A point of the reference frame, through mrcal's pose (m) and lens, and through ours (mm).
    const Eigen::Vector3d point(31, -22, 1000);
    mrcal_point3_t in_m = {}, in_cam = {};
    for (int i = 0; i < 3; ++i) in_m.xyz[i] = point[i] / 1000;
    mrcal_transform_point_rt(in_cam.xyz, nullptr, nullptr, m->rt_cam_ref, in_m.xyz);
    mrcal_point2_t q = {};
    ASSERT_TRUE(mrcal_project(&q, nullptr, nullptr, &in_cam, 1, &m->lensmodel, m->intrinsics));
    const auto ours = p.camera.project(p.cam_from_reference * point);
    ASSERT_TRUE(ours);
    // Roundings of 1e-16 in the pose times f = 3700 px, some of them.
    EXPECT_NEAR(q.xy[0], ours->x(), 1e-10);
    EXPECT_NEAR(q.xy[1], ours->y(), 1e-10);
    mrcal_free_cameramodel(&m);
  }
}

TEST(LensFiles, OpenCvsOwnReaderSeesTheSameCameraAndProjectsTheSame) {
  const test::TemporaryFolder folder;
  const PlacedCamera p = camera_with_odd_numbers(0.011);
  const cv::FileStorage file(written(folder.path(), p, LensFormat::opencv).string(), cv::FileStorage::READ);
  ASSERT_TRUE(file.isOpened());
  cv::Mat matrix, distortion, r, t, rotation_vector;
  file["camera_matrix"] >> matrix;
  file["distortion_coefficients"] >> distortion;
  file["R"] >> r;
  file["T"] >> t;
  EXPECT_EQ(static_cast<int>(file["image_width"]), 1392);
  EXPECT_EQ(matrix.at<double>(0, 0), p.camera.fx_px);
  EXPECT_EQ(distortion.at<double>(4), p.camera.distortion[4]);
  cv::Rodrigues(r, rotation_vector);
  const Eigen::Vector3d point(31, -22, 1000);
  std::vector<cv::Point2d> pixel;
  cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, rotation_vector, t, matrix, distortion,
                    pixel);
  const auto ours = p.camera.project(p.cam_from_reference * point);
  EXPECT_NEAR(pixel[0].x, ours->x(), 1e-10);
  EXPECT_NEAR(pixel[0].y, ours->y(), 1e-10);
}

TEST(LensFiles, ReadWhatMrcalsOwnWriterWrites) {
  const test::TemporaryFolder folder;
  const PlacedCamera p = camera_with_odd_numbers(0);
  const auto file = written(folder.path(), p, LensFormat::mrcal), again = folder.path() / "again.cameramodel";
  mrcal_cameramodel_t* m = mrcal_read_cameramodel_file(file.c_str());
  ASSERT_NE(m, nullptr);
  ASSERT_TRUE(mrcal_write_cameramodel_file(again.c_str(), m));
  mrcal_free_cameramodel(&m);
  const PlacedCamera back = read_lens_file(again);
  // Its writer keeps six decimals.
  EXPECT_NEAR(back.camera.fx_px, p.camera.fx_px, 1e-6);
  EXPECT_NEAR(back.camera.distortion[1], p.camera.distortion[1], 1e-6);
  EXPECT_NEAR(back.cam_from_reference.translation_mm.x(), p.cam_from_reference.translation_mm.x(), 1e-3);
}

TEST(LensFiles, CarryAProjectorThereAndBack) {
  const model::Scanner scanner = test::known_scanner();
  const model::Camera camera = camera_of(scanner.projector);
  EXPECT_EQ(camera.width_px, 128);  // seven bits
  const model::Projector back = projector_of(camera, scanner.projector);
  const Eigen::Vector3d point(20, 10, 1000);
  // u / w and back: roundings of u = 10 mm, and px counts from the middle of the first stripe.
  EXPECT_NEAR(*back.project(CodeAxis::x, point), *scanner.projector.project(CodeAxis::x, point), 1e-14);
  EXPECT_NEAR(camera.project(point)->x(), *scanner.projector.project(CodeAxis::x, point) / 0.12 - 0.5, 1e-12);
}

TEST(LensFiles, RefuseWhatTheyCannotHold) {
  const test::TemporaryFolder folder;
  const auto refused = [&](const char* name, const std::string& bytes) {
    write_atomically(folder.path() / name, bytes);
    try {
      (void)read_lens_file(folder.path() / name);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("read");
  };
  std::string text = lens_file(camera_with_odd_numbers(0), LensFormat::mrcal, "");
  std::string splined = text;
  splined.replace(splined.find("LENSMODEL_OPENCV4"), 17, "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3");
  EXPECT_THAT(refused("a.cameramodel", splined), HasSubstr("LENSMODEL_OPENCV5"));
  std::string short_list = text;
  short_list.replace(short_list.find("LENSMODEL_OPENCV4"), 17, "LENSMODEL_OPENCV5");
  EXPECT_THAT(refused("b.cameramodel", short_list), HasSubstr("9 numbers"));
  EXPECT_THAT(refused("c.yml", "%YAML:1.0\n---\nimage_width: 640\n"), HasSubstr("camera_matrix"));
  EXPECT_THAT(refused("d.txt", "hello\n"), HasSubstr("neither"));
}

}  // namespace
}  // namespace fringecal::calib

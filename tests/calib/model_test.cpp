// What the instrument is: the camera against two other implementations, inverses, triangulation, files.
#include "calib/model/camera.h"
#include "calib/model/triangulate.h"
#include "core/file.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

extern "C" {
#include <mrcal/mrcal.h>
}

#include <filesystem>

namespace fringecal {
namespace {

std::vector<Eigen::Vector3d> points_in_view() {
  std::vector<Eigen::Vector3d> out;
  for (int i = -4; i <= 4; ++i) {
    for (int j = -4; j <= 4; ++j) out.emplace_back(45.0 * i, 35.0 * j, 900.0 + 13.0 * i - 7.0 * j);
  }
  return out;
}

model::Camera camera(double k3) {
  model::Camera c = test::known_scanner().camera;
  c.fy_px = 3718.5;
  c.distortion[4] = k3;
  return c;
}

// Both sides evaluate the same polynomial in double: some tens of roundings of 1e-16 at 1e3 px, 1e-11 px. 1e-9 px is
// asked.
constexpr double kSame_px = 1e-9;

TEST(Camera, ProjectsLikeOpenCv) {
  const model::Camera c = camera(0.4);
  const cv::Matx33d matrix(c.fx_px, 0, c.cx_px, 0, c.fy_px, c.cy_px, 0, 0, 1);
  std::vector<cv::Point3d> points;
  for (const auto& p : points_in_view()) points.emplace_back(p.x(), p.y(), p.z());
  std::vector<cv::Point2d> theirs;
  cv::projectPoints(points, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), matrix,
                    std::vector<double>(c.distortion.begin(), c.distortion.end()), theirs);
  const auto points_mm = points_in_view();
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    const auto ours = c.project(points_mm[i]);
    ASSERT_TRUE(ours);
    EXPECT_NEAR(ours->x(), theirs[i].x, kSame_px);
    EXPECT_NEAR(ours->y(), theirs[i].y, kSame_px);
  }
}

TEST(Camera, ProjectsLikeMrcal) {
  for (const double k3 : {0.0, 0.4}) {
    const model::Camera c = camera(k3);
    mrcal_lensmodel_t lens{};
    lens.type = k3 == 0.0 ? MRCAL_LENSMODEL_OPENCV4 : MRCAL_LENSMODEL_OPENCV5;
    const auto& d = c.distortion;
    const double intrinsics[] = {c.fx_px, c.fy_px, c.cx_px, c.cy_px, d[0], d[1], d[2], d[3], d[4]};
    for (const auto& p : points_in_view()) {
      const mrcal_point3_t point = {.xyz = {p.x(), p.y(), p.z()}};
      mrcal_point2_t pixel;
      ASSERT_TRUE(mrcal_project(&pixel, nullptr, nullptr, &point, 1, &lens, intrinsics));
      const auto ours = c.project(p);
      ASSERT_TRUE(ours);
      EXPECT_NEAR(ours->x(), pixel.x, kSame_px);
      EXPECT_NEAR(ours->y(), pixel.y, kSame_px);
    }
  }
}

TEST(Camera, SeesEveryPixelAlongTheRayThatProjectsToIt) {
  const model::Camera c = camera(0.4);
  for (int y = 0; y < c.height_px; y += 103) {
    for (int x = 0; x < c.width_px; x += 87) {
      const auto ray = c.ray({x, y});
      ASSERT_TRUE(ray);
      const auto back = c.project(700.0 * *ray);
      ASSERT_TRUE(back);
      // Newton stops at 1e-14 in the normalised plane: 4e-11 px.
      EXPECT_NEAR((*back - Eigen::Vector2d(x, y)).norm(), 0.0, kSame_px);
    }
  }
}

TEST(Camera, HasNoRayWhereThePolynomialHasTurnedOver) {
  model::Camera c = camera(0.0);
  c.distortion = {-2.0, 0, 0, 0, 0};  // x (1 - 2 x^2) has its maximum 0.272 at x = 0.408
  EXPECT_FALSE(c.ray({c.cx_px + 0.28 * c.fx_px, c.cy_px}));
  EXPECT_TRUE(c.ray({c.cx_px + 0.26 * c.fx_px, c.cy_px}));
}

TEST(Triangulate, FindsThePointThatWasProjectedOnEitherAxis) {
  const model::Scanner s = test::known_scanner(true);
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    model::Scanner turned = s;
    // Along y the base line must run along y for the depth to be seen.
    if (axis == CodeAxis::y) {
      const Eigen::Quaterniond quarter(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ()));
      turned.proj_from_cam = Rigid3{quarter, Eigen::Vector3d::Zero()} * s.proj_from_cam;
    }
    for (const auto& offset : points_in_view()) {
      const Eigen::Vector3d point = offset + Eigen::Vector3d(0, 0, 170);
      const auto pixel = s.camera.project(point);
      const auto u = s.projector.project(axis, turned.proj_from_cam * point);
      ASSERT_TRUE(pixel && u);
      const auto found = model::triangulate(s.camera, s.projector, turned.proj_from_cam, axis, *pixel, *u);
      ASSERT_TRUE(found);
      // 1e-14 of the ray and of w = 1 / Z times the depth of 1e3 mm, times the lever L / b = 2.5, some roundings: 1e-9
      // mm.
      EXPECT_NEAR((*found - point).norm(), 0.0, 1e-9);
    }
  }
}

TEST(Triangulate, GivesNoPointBehindTheCameraOrOnAnAxisThatIsNotCoded) {
  const model::Scanner s = test::known_scanner();
  // The fringe plane of a u far beyond the camera's side meets the middle ray behind the camera.
  EXPECT_FALSE(model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::x, {700, 500}, 7.83 + 32.0 * 0.5));
  EXPECT_FALSE(model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::y, {700, 500}, 7.0));
}

TEST(ScannerFile, ReadsBackTheSameBytes) {
  model::Scanner s = test::known_scanner();
  s.board = test::known_board();
  s.observations = test::views(s, *s.board, 3, {});
  s.observations[1].corners[5].used = false;
  s.observations[2].corners[7].x.reset();
  s.cam_from_board.assign(3, s.proj_from_cam);
  s.uncertainty.names = {"camera.fx_px", "projector.x.f"};
  s.uncertainty.covariance = Eigen::MatrixXd::Identity(2, 2) / 3.0;
  s.uncertainty.covariance(0, 1) = s.uncertainty.covariance(1, 0) = 0.1;
  s.priors.push_back({"proj_from_cam.translation_y_mm", 0.0, 40.0, "level pupils"});
  s.method = "given";
  s.provenance = {.version = "1", .date = "2026-01-01T00:00:00Z", .inputs = {{"pose_1", "ab"}}};
  const auto folder = std::filesystem::path(::testing::TempDir());
  const auto first = folder / "fringecal_scanner_1.json", second = folder / "fringecal_scanner_2.json";
  model::write_scanner(first, s);
  const model::Scanner back = model::read_scanner(first);
  model::write_scanner(second, back);
  EXPECT_EQ(read_bytes(first), read_bytes(second));
  EXPECT_EQ(back.camera.fx_px, s.camera.fx_px);
  EXPECT_EQ(back.projector.distortion, s.projector.distortion);
  EXPECT_EQ(back.proj_from_cam.rotation.coeffs(), s.proj_from_cam.rotation.coeffs());
  EXPECT_EQ(back.uncertainty.covariance, s.uncertainty.covariance);
  EXPECT_EQ(back.observations[0].corners[3].pixel, s.observations[0].corners[3].pixel);
  EXPECT_FALSE(back.observations[1].corners[5].used);
  EXPECT_FALSE(back.observations[2].corners[7].x);
}

}  // namespace
}  // namespace fringecal

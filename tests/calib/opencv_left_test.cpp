// The left camera of OpenCV's own examples (Debian package opencv-doc), against the library's own calibration of it,
// left_intrinsics.yml: one focal length, k1, k2, p1, p2, k3. Corners by OpenCV's detector, as its sample program finds
// them.
#include "calib/camera_solve.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace fringecal::calib {
namespace {

// The stop of that program at the time.
constexpr double kCornerStop = 0.1;

std::filesystem::path examples() {
  const char* const elsewhere = std::getenv("FRINGECAL_OPENCV_EXAMPLES");
  return elsewhere ? elsewhere : "/usr/share/doc/opencv-doc/examples/data";
}

TEST(OpenCvLeftCamera, IsWhatTheLibraryPublishes) {
  const auto folder = examples();
  if (!std::filesystem::exists(folder / "left01.jpg")) {
    GTEST_SKIP() << "the images of the Debian package opencv-doc are not in " << folder
                 << "; install it, or set FRINGECAL_OPENCV_EXAMPLES";
  }
  std::vector<PlanarView> views;
  for (int i = 1; i <= 14; ++i) {
    char name[32];
    std::snprintf(name, sizeof name, "left%02d.jpg", i);
    if (!std::filesystem::exists(folder / name)) continue;  // there is no left10
    const cv::Mat image = cv::imread((folder / name).string(), cv::IMREAD_GRAYSCALE);
    std::vector<cv::Point2f> corners;
    ASSERT_TRUE(cv::findChessboardCorners(
        image, {9, 6}, corners, cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_FAST_CHECK | cv::CALIB_CB_NORMALIZE_IMAGE))
        << name;
    cv::cornerSubPix(image, corners, {11, 11}, {-1, -1},
                     {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 30, kCornerStop});
    PlanarView v;
    for (int k = 0; k < 54; ++k) {
      v.board_mm.emplace_back(25.0 * (k % 9), 25.0 * (k / 9));
      v.pixels.emplace_back(corners[static_cast<std::size_t>(k)].x, corners[static_cast<std::size_t>(k)].y);
    }
    views.push_back(std::move(v));
  }
  ASSERT_EQ(views.size(), 13u);
  const auto found = solve_camera(views, 640, 480, {.terms = DistortionTerms::full, .aspect = Aspect::one});
  ASSERT_TRUE(found) << found.error().sentence;
  const auto& c = found->camera;
  const double rms_per_point = found->rms_px * std::sqrt(2.0);
  std::printf("left camera: f %.6f c %.6f %.6f k %.6f %.6f %.6f p %.6f %.6f, rms %.7f px per point\n", c.fx_px, c.cx_px,
              c.cy_px, c.distortion[0], c.distortion[1], c.distortion[4], c.distortion[2], c.distortion[3],
              rms_per_point);
  EXPECT_EQ(c.fx_px, c.fy_px);
  // Its solver stops after 30 iterations or 2e-16: what is left is below its printed 17 digits' use; 1e-3 px is asked.
  EXPECT_NEAR(c.fx_px, 535.91573396, 1e-3);
  EXPECT_NEAR(c.cx_px, 342.28315473, 1e-3);
  EXPECT_NEAR(c.cy_px, 235.57082910, 1e-3);
  EXPECT_NEAR(rms_per_point, 0.39259099, 1e-3);
}

}  // namespace
}  // namespace fringecal::calib

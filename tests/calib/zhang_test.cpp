// Zhang's own five views of 256 corners, against his published solution.
#include "calib/initialise.h"
#include "calib/joint_solve.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

namespace fringecal::calib {
namespace {

std::vector<double> numbers_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istream_iterator<double>(in), std::istream_iterator<double>()};
}

TEST(CameraSolve, AgreesWithZhangsPublishedSolution) {
  const auto folder = std::filesystem::path(FRINGECAL_SHARED_DATA) / "zhang-1998";
  if (!std::filesystem::exists(folder / "Model.txt")) GTEST_SKIP() << "shared data not present: " << folder;
  Bundle b;
  b.camera.width_px = 640;
  b.camera.height_px = 480;
  const auto model = numbers_of(folder / "Model.txt");
  ASSERT_EQ(model.size(), 512u);
  // His board is in inches with y upwards; ours is right-handed seen from the front with y downwards.
  for (std::size_t i = 0; i < model.size(); i += 2) b.targets_mm.emplace_back(25.4 * model[i], -25.4 * model[i + 1]);
  for (int pose = 0; pose < 5; ++pose) {
    const auto points = numbers_of(folder / ("data" + std::to_string(pose + 1) + ".txt"));
    ASSERT_EQ(points.size(), 512u);
    for (int k = 0; k < 256; ++k) {
      const auto i = static_cast<std::size_t>(2 * k);
      b.sights.push_back({pose, k, {points[i], points[i + 1]}, 0.2, {}, {}, true});
    }
  }
  b.cam_from_board.resize(5);
  ASSERT_TRUE(initialise_camera(b));
  SolveSettings settings;
  settings.outliers = Outliers::keep;
  const auto report = solve_bundle(b, settings);
  ASSERT_TRUE(report) << report.error().sentence;
  std::printf("Zhang: f %.4f %.4f c %.4f %.4f k %.5f %.5f rms %.4f px per coordinate\n", b.camera.fx_px, b.camera.fy_px,
              b.camera.cx_px, b.camera.cy_px, b.camera.distortion[0], b.camera.distortion[1], report->camera_rms_px);
  // His model has a skew, 0.2045 px, ours has none: what it takes up moves the others by a fraction of their standard
  // uncertainties, which he states (calibration report of 1998) as 1.4 (f), 0.7 (c), 0.006 and 0.03 (k).
  EXPECT_NEAR(b.camera.fx_px, 832.5, 0.5 * 1.4);
  EXPECT_NEAR(b.camera.fy_px, 832.53, 0.5 * 1.4);
  EXPECT_NEAR(b.camera.cx_px, 303.959, 0.5 * 0.7);
  EXPECT_NEAR(b.camera.cy_px, 206.585, 0.5 * 0.7);
  EXPECT_NEAR(b.camera.distortion[0], -0.228601, 0.003);
  EXPECT_NEAR(b.camera.distortion[1], 0.190353, 0.015);
}

}  // namespace
}  // namespace fringecal::calib

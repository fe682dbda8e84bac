// Tsai's two stages: exact on exact corners, from one tilted pose and from several; refused where f and t_z are one.
#include "calib/tsai.h"

#include "calib/corner_files.h"
#include "tests/calib/synthetic_board_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

namespace fringecal::calib {
namespace {

using ::testing::HasSubstr;

/// The known camera with its principal point in the image's middle and square pixels, as the method takes it.
model::Scanner centred() {
  model::Scanner s = test::known_scanner();
  s.camera.cx_px = 695.5;
  s.camera.cy_px = 519.5;
  s.camera.distortion = {-0.10, 0.06, 0, 0, 0};
  return s;
}

std::vector<PlanarView> exact_views(const model::Camera& camera, const std::vector<double>& tilts_deg) {
  const model::Board board = test::known_board();
  std::vector<PlanarView> out;
  for (std::size_t j = 0; j < tilts_deg.size(); ++j) {
    const double direction = 0.4 + 2.1 * static_cast<double>(j);
    const Rigid3 pose{
        Eigen::Quaterniond(Eigen::AngleAxisd(tilts_deg[j] * std::numbers::pi / 180,
                                             Eigen::Vector3d(std::cos(direction), std::sin(direction), 0))),
        {-110, -80, 1000.0 + 20.0 * static_cast<double>(j)}};
    PlanarView v;
    for (const auto& p : places_of(board)) {
      v.board_mm.push_back(p);
      v.pixels.push_back(*camera.project(pose * Eigen::Vector3d(p.x(), p.y(), 0)));
    }
    out.push_back(std::move(v));
  }
  return out;
}

void expect_truth(const Result<TsaiSolution>& found, const model::Camera& truth) {
  ASSERT_TRUE(found) << found.error().sentence;
  // Stage 1 is linear: rounding 1e-16 times the condition of six numbers from 63 points (some 1e4) and of f against tz
  // (some 1e3).
  EXPECT_NEAR(found->camera.fx_px, truth.fx_px, 1e-6);
  EXPECT_NEAR(found->camera.distortion[0], truth.distortion[0], 1e-8);
  EXPECT_NEAR(found->camera.distortion[1], truth.distortion[1], 1e-6);
  EXPECT_LT(found->rms_px, 1e-9);
}

TEST(Tsai, FindsTheTruthFromOneTiltedPoseOfExactCorners) {
  const model::Camera truth = centred().camera;
  for (const double tilt : {12.0, 30.0, 50.0}) {
    const auto found = calibrate_tsai(exact_views(truth, {tilt}), 1392, 1040);
    expect_truth(found, truth);
    EXPECT_NEAR(found->tilt_rad[0], tilt * std::numbers::pi / 180, 1e-9);
    EXPECT_LT((found->cam_from_board[0].translation_mm - Eigen::Vector3d(-110, -80, 1000)).norm(), 1e-6);
  }
}

TEST(Tsai, FindsTheTruthFromSeveralPosesOneOfThemParallel) {
  const model::Camera truth = centred().camera;
  expect_truth(calibrate_tsai(exact_views(truth, {30, 0.5, 25, 40}), 1392, 1040), truth);
}

TEST(Tsai, RefusesABoardParallelToTheImageWithTheReason) {
  const model::Camera truth = centred().camera;
  for (const double tilt : {0.0, 1.0}) {
    const auto found = calibrate_tsai(exact_views(truth, {tilt}), 1392, 1040);
    ASSERT_FALSE(found);
    EXPECT_THAT(found.error().sentence, HasSubstr("the focal length f and the distance t_z cannot be separated"));
  }
}

TEST(Tsai, IsWithinTheNoiseOfTheOptimumOnNoisyCorners) {
  // planar_views(): 20 boards of 100 corners, 0.1 px; its principal point is 12 px off the middle, which tilts the rays by
  // 12 / 3721 = 3 mrad and costs Tsai, who takes it for the middle, up to a percent of f.
  const auto found = calibrate_tsai(test::planar_views(20, 10, 10, 22, 0.1), 1392, 1040, Eigen::Vector2d(708, 512));
  ASSERT_TRUE(found) << found.error().sentence;
  std::printf("Tsai, 20 boards, 0.1 px: f %.2f (truth 3721), k1 %.4f, k2 %.3f, rms %.4f px\n", found->camera.fx_px,
              found->camera.distortion[0], found->camera.distortion[1], found->rms_px);
  // Each pose's tilt theta is known from stage 1 to some u_px / (f dz/z) = 0.1 / sqrt(100) / (3721 x 0.1 x 0.2) = 1.4e-4 /
  // sin(theta); f scales with tan(theta): 0.05 % of one pose, less of twenty, but biased by its square. 0.5 % is asked.
  EXPECT_NEAR(found->camera.fx_px, 3721, 0.005 * 3721);
}

TEST(Tsai, IsNearZhangsSolutionOnHisPoints) {
  const auto folder = std::filesystem::path(FRINGECAL_SHARED_DATA) / "zhang-1998";
  if (!std::filesystem::exists(folder / "Model.txt")) GTEST_SKIP() << "shared data not present: " << folder;
  std::vector<std::filesystem::path> files;
  for (int i = 1; i <= 5; ++i) files.push_back(folder / ("data" + std::to_string(i) + ".txt"));
  std::vector<PlanarView> views;
  for (const auto& n : read_corners(files, read_places(folder / "Model.txt", 25.4))) views.push_back(n.view);
  const auto found = calibrate_tsai(views, 640, 480, Eigen::Vector2d(303.959, 206.585));
  ASSERT_TRUE(found) << found.error().sentence;
  std::printf("Tsai on Zhang's points: f %.2f k %.4f %.4f rms %.3f px\n", found->camera.fx_px,
              found->camera.distortion[0], found->camera.distortion[1], found->rms_px);
  // With his principal point the method differs from the optimum (832.5, -0.2286, 0.1904; rms 0.24 px) by what stage 1 takes
  // as it finds it: corners of 0.24 px on boards tilted by 20 degrees, some 1 % of f.
  EXPECT_NEAR(found->camera.fx_px, 832.5, 0.02 * 832.5);
  EXPECT_NEAR(found->camera.distortion[0], -0.2286, 0.03);
}

}  // namespace
}  // namespace fringecal::calib

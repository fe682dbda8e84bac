// The fast camera solve: published figures, other implementations on the same corners, and views that cannot answer.
#include "calib/camera_solve.h"

#include "calib/other_solvers.h"
#include "tests/calib/synthetic_board_views.h"
#include "tests/calib/tight_camera_solve.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace fringecal::calib {
namespace {

using ::testing::HasSubstr;

std::vector<double> numbers_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istream_iterator<double>(in), std::istream_iterator<double>()};
}

void print(const char* who, const model::Camera& c, double squares) {
  std::printf("%-8s f %.8f %.8f c %.8f %.8f k %.9f %.9f p %.9f %.9f squares %.12g\n", who, c.fx_px, c.fy_px, c.cx_px,
              c.cy_px, c.distortion[0], c.distortion[1], c.distortion[2], c.distortion[3], squares);
}

TEST(CameraSolve, ReproducesZhangsPublishedSolutionToHisDigits) {
  const auto folder = std::filesystem::path(FRINGECAL_SHARED_DATA) / "zhang-1998";
  if (!std::filesystem::exists(folder / "Model.txt")) GTEST_SKIP() << "shared data not present: " << folder;
  const auto model = numbers_of(folder / "Model.txt");
  std::vector<PlanarView> views;
  for (int pose = 1; pose <= 5; ++pose) {
    const auto points = numbers_of(folder / ("data" + std::to_string(pose) + ".txt"));
    ASSERT_EQ(points.size(), 512u);
    PlanarView v;
    for (std::size_t i = 0; i < 512; i += 2) {
      // His board is in inches with y upwards; ours is right-handed seen from the front with y downwards.
      v.board_mm.emplace_back(25.4 * model[i], -25.4 * model[i + 1]);
      v.pixels.emplace_back(points[i], points[i + 1]);
    }
    views.push_back(std::move(v));
  }
  const auto found = solve_camera(views, 640, 480, {.skew = Skew::free});
  ASSERT_TRUE(found) << found.error().sentence;
  const auto& c = found->camera;
  std::printf("Zhang: f %.5f %.5f skew %.5f c %.5f %.5f k %.6f %.6f, %d iterations\n", c.fx_px, c.fy_px, found->skew_px,
              c.cx_px, c.cy_px, c.distortion[0], c.distortion[1], found->iterations);
  // His figures are printed to 4 decimals, k to 5; his solver's stop leaves some units of the last of them.
  EXPECT_NEAR(c.fx_px, 832.4998, 2e-3);
  EXPECT_NEAR(found->skew_px, 0.2045, 2e-3);
  EXPECT_NEAR(c.fy_px, 832.5296, 2e-3);
  EXPECT_NEAR(c.cx_px, 303.9589, 2e-3);
  EXPECT_NEAR(c.cy_px, 206.5852, 2e-3);
  EXPECT_NEAR(c.distortion[0], -0.22860, 2e-5);
  EXPECT_NEAR(c.distortion[1], 0.19035, 2e-5);
}

TEST(CameraSolve, FindsTheSameOptimumAsOpenCvAndMrcal) {
  const auto views = test::planar_views(20, 10, 10, 22, 0.1);
  const auto radial = solve_camera(views, 1392, 1040, {});
  const auto four = solve_camera(views, 1392, 1040, {.terms = DistortionTerms::radial_tangential});
  ASSERT_TRUE(radial && four);
  const auto solved = [](const Result<OtherSolution>& found) {
    EXPECT_TRUE(found) << found.error().sentence;
    return found.value_or(OtherSolution{});
  };
  const auto cv_radial = solved(solve_with_opencv(views, 1392, 1040, DistortionTerms::radial, 1000));
  const auto cv_four = solved(solve_with_opencv(views, 1392, 1040, DistortionTerms::radial_tangential, 1000));
  const auto mrcal = solved(solve_with_mrcal(views, 1392, 1040, DistortionTerms::radial_tangential));
  print("ours", radial->camera, radial->squares_px2);
  print("OpenCV", cv_radial.camera, cv_radial.squares_px2);
  print("ours", four->camera, four->squares_px2);
  print("OpenCV", cv_four.camera, cv_four.squares_px2);
  print("mrcal", mrcal.camera, mrcal.squares_px2);
  // The same sum of squares, so the same minimum: 1e-5 px in f and c; k changes a corner by f r^2 k, 3700 x 0.03, so 1e-7
  // of k1 (and 3e-6 of k2, r^2 smaller) are 1e-5 px.
  const auto same = [](const model::Camera& a, const model::Camera& b) {
    EXPECT_NEAR(a.fx_px, b.fx_px, 1e-5);
    EXPECT_NEAR(a.fy_px, b.fy_px, 1e-5);
    EXPECT_NEAR(a.cx_px, b.cx_px, 1e-5);
    EXPECT_NEAR(a.cy_px, b.cy_px, 1e-5);
    EXPECT_NEAR(a.distortion[0], b.distortion[0], 1e-7);
    EXPECT_NEAR(a.distortion[1], b.distortion[1], 3e-6);
    EXPECT_NEAR(a.distortion[2], b.distortion[2], 1e-8);
    EXPECT_NEAR(a.distortion[3], b.distortion[3], 1e-8);
  };
  same(radial->camera, cv_radial.camera);
  same(four->camera, cv_four.camera);
  same(four->camera, mrcal.camera);
  // Rounding of a sum of 4000 squares.
  EXPECT_LE(radial->squares_px2, cv_radial.squares_px2 * (1 + 1e-12));
  EXPECT_LE(four->squares_px2, cv_four.squares_px2 * (1 + 1e-12));
  EXPECT_LE(four->squares_px2, mrcal.squares_px2 * (1 + 1e-12));
}

TEST(CameraSolve, LiesWithin1e8PxOfATightReferenceSolve) {
  const auto views = test::planar_views(20, 10, 10, 22, 0.1);
  const auto found = solve_camera(views, 1392, 1040, {});
  const auto tight = test::tight_camera_solve(views, 1392, 1040);
  ASSERT_TRUE(found && tight);
  const double apart = test::distance_px(*found, *tight, views);
  std::printf("corners as projected by both: %.2g px apart at most\n", apart);
  EXPECT_LT(apart, 1e-8);
}

TEST(CameraSolve, IsTheSameToTheLastBitWithOneThreadAndTwo) {
  const auto views = test::planar_views(30, 20, 20, 11, 0.1);  // enough corners to be shared among threads
  const char* const before = std::getenv("FRINGECAL_THREADS");
  const std::string kept = before ? before : "";
  ::setenv("FRINGECAL_THREADS", "1", 1);
  const auto one = solve_camera(views, 1392, 1040, {});
  ::setenv("FRINGECAL_THREADS", "2", 1);
  const auto two = solve_camera(views, 1392, 1040, {});
  if (before) {
    ::setenv("FRINGECAL_THREADS", kept.c_str(), 1);
  } else {
    ::unsetenv("FRINGECAL_THREADS");
  }
  ASSERT_TRUE(one && two);
  EXPECT_EQ(one->camera.fx_px, two->camera.fx_px);
  EXPECT_EQ(one->covariance, two->covariance);
}

TEST(CameraSolve, MeetsItselfFromAnotherOrderOfViews) {
  const auto views = test::planar_views(20, 10, 10, 22, 0.1);
  const auto found = solve_camera(views, 1392, 1040, {});
  ASSERT_TRUE(found);
  // Another order of summation, so another path of roundings: both must end within 1e-8 px of the minimum.
  auto turned = views;
  std::reverse(turned.begin(), turned.end());
  const auto again = solve_camera(turned, 1392, 1040, {});
  ASSERT_TRUE(again);
  EXPECT_NEAR(found->camera.fx_px, again->camera.fx_px, 1e-8);
  EXPECT_NEAR(found->camera.cx_px, again->camera.cx_px, 1e-8);
}

TEST(CameraSolve, RefusesTwoViews) {
  const auto found = solve_camera(test::planar_views(2, 10, 10, 22, 0.1), 1392, 1040, {});
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("at least 3"));
}

}  // namespace
}  // namespace fringecal::calib

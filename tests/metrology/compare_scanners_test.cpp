// Two calibrations against each other: equal ones, ones that differ by a draw from their covariance, and one that drifted.
#include "metrology/compare_scanners.h"

#include "tests/metrology/exact_phase_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::metrology {
namespace {

model::Scanner scanner() {
  model::Scanner s = test::sample_scanner();
  s.uncertainty.names = {"camera.fx_px", "proj_from_cam.translation_x_mm", "proj_from_cam.rotation_y_rad"};
  s.uncertainty.covariance = Eigen::Vector3d(0.01, 1e-4, 1e-10).asDiagonal();
  return s;
}

TEST(CompareScanners, FindsNothingBetweenAScannerAndItself) {
  const auto same = compare_scanners(scanner(), scanner());
  ASSERT_TRUE(same) << same.error().sentence;
  // Rounding of coordinates of 1e3 mm through two projections.
  EXPECT_LT(same->max_mm, 1e-8);
  EXPECT_GT(same->allowed_rms_mm, 0.0);
}

TEST(CompareScanners, DoesNotMindAnotherWorld) {
  auto other = scanner();
  other.working_distance_mm += 25;  // R moved: every point's Z differs by 25 mm
  const auto moved = compare_scanners(scanner(), other);
  ASSERT_TRUE(moved) << moved.error().sentence;
  EXPECT_LT(moved->max_mm, 1e-8);
}

TEST(CompareScanners, ExpectsWhatADrawFromTheCovarianceGives) {
  // One parameter off by its u in B: eq. 2 has three such parts for each of two scanners; each alone gives a share.
  const auto a = scanner();
  double squares = 0, allowed = 0;
  for (int k = 0; k < 3; ++k) {
    const double u = std::sqrt(a.uncertainty.covariance(k, k));
    const auto one = compare_scanners(a, a.changed_by(u * Eigen::Vector3d::Unit(k)));
    ASSERT_TRUE(one) << one.error().sentence;
    squares += 2.0 * one->rms_mm * one->rms_mm;
    allowed = one->allowed_rms_mm;
  }
  // Linear in changes of 1e-5 of the parameters: 1 % covers the second order.
  EXPECT_NEAR(std::sqrt(squares), allowed, 0.01 * allowed);
}

TEST(CompareScanners, CallsADriftOfTenUncertaintiesADisagreement) {
  const auto a = scanner();
  const auto drifted = compare_scanners(a, a.changed_by(Eigen::Vector3d(0, 0.3, 0)));
  ASSERT_TRUE(drifted) << drifted.error().sentence;
  EXPECT_GT(drifted->ratio, 2.0);
  EXPECT_THAT(verdict_of(*drifted), ::testing::HasSubstr("disagree"));
}

TEST(CompareScanners, TellsTheWorstPointOfEachHeight) {
  const auto a = scanner();
  const auto drifted = compare_scanners(a, a.changed_by(Eigen::Vector3d(0, 0.3, 0)));
  ASSERT_TRUE(drifted) << drifted.error().sentence;
  const auto heights = by_height(*drifted);
  ASSERT_EQ(heights.size(), 5u);  // of the grid
  int points = 0;
  double squares = 0, worst = 0;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    if (i > 0) {
      EXPECT_GT(heights[i].z_mm, heights[i - 1].z_mm);
    }
    points += heights[i].points;
    squares += heights[i].points * heights[i].rms_mm * heights[i].rms_mm;
    worst = std::max(worst, heights[i].worst.difference_mm.norm());
  }
  EXPECT_EQ(points, static_cast<int>(drifted->points.size()));
  EXPECT_DOUBLE_EQ(std::sqrt(squares / points), drifted->rms_mm);
  EXPECT_DOUBLE_EQ(worst, drifted->max_mm);
}

TEST(CompareScanners, RefusesScannersOfDifferentImageSizes) {
  auto other = scanner();
  other.camera.width_px += 1;
  EXPECT_FALSE(compare_scanners(scanner(), other));
}

}  // namespace
}  // namespace fringecal::metrology

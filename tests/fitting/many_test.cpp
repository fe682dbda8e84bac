// Fits of many points: the quick way (a sample's frame and start, few passes) gives what the careful way gives, and leaves
// to it what is not in order. Covariances that are all alike take the careful way.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"
#include "fitting/surface.h"

#include <gtest/gtest.h>

#include <limits>

namespace fringecal::fitting {
namespace {

constexpr std::size_t kMany = 6000;

Cloud part_of_sphere(double half_angle_rad, const Eigen::Vector3d& center) {
  Random random(21);
  Cloud cloud;
  for (std::size_t i = 0; i < kMany; ++i) {
    const double z = 1.0 - (1.0 - std::cos(half_angle_rad)) * uniform(random), turn = 6.2831853 * uniform(random);
    const double across = std::sqrt(1.0 - z * z), r = 25.0 + 0.03 * normal(random);
    cloud.push_back(center + r * Eigen::Vector3d(across * std::cos(turn), across * std::sin(turn), z));
  }
  return cloud;
}
Cloud part_of_cylinder(double sector_rad, const Eigen::Vector3d& point) {
  Random random(22);
  const Eigen::Matrix3d axes = axes_with(Eigen::Vector3d(0.3, -1.0, 0.4), 2);
  Cloud cloud;
  for (std::size_t i = 0; i < kMany; ++i) {
    const double turn = sector_rad * (uniform(random) - 0.5), r = 60.0 + 0.03 * normal(random);
    cloud.push_back(point + axes * Eigen::Vector3d(r * std::cos(turn), r * std::sin(turn), 200.0 * uniform(random)));
  }
  return cloud;
}
std::vector<Eigen::Matrix3d> alike() { return std::vector<Eigen::Matrix3d>(kMany, Eigen::Matrix3d::Identity()); }

// The quick way ends within 1e-13 of the points' size, at most 60 mm here: 6e-12 mm in the distances, and a small part of
// a surface amplifies that by the factor that the fit states. Far from the origin the coordinates' rounding is added.
double limit_mm(double amplification, double offset_mm) { return amplification * 6e-12 + 1e-15 * offset_mm; }

TEST(FitManyPoints, OfASphereAgreeWithTheCarefulWay) {
  for (const double half_angle : {0.4, 0.9, 1.6, 3.1}) {
    for (const double offset : {0.0, 1e6}) {
      const Cloud cloud = part_of_sphere(half_angle, offset * Eigen::Vector3d(0.3, -1.0, 0.7));
      const auto covariances = alike();
      const auto quick = fit_sphere(cloud), careful = fit_sphere(cloud, {.covariances_mm2 = covariances});
      ASSERT_TRUE(quick && careful);
      const double limit = limit_mm(quick->amplification, offset);
      EXPECT_NEAR(quick->diameter_mm, careful->diameter_mm, limit);
      EXPECT_LT((quick->center_mm - careful->center_mm).norm(), limit);
      // The matrix is that of the start, a hundredth of the scatter away: its entries are off by less than 1e-4.
      EXPECT_NEAR(quick->amplification, careful->amplification, 1e-3 * careful->amplification);
      EXPECT_NEAR(quick->quality.rms_mm, careful->quality.rms_mm, 1e-9 * careful->quality.rms_mm);
      // Distances are those of one step before, 3e-9 of the size away at most: 60 mm.
      EXPECT_NEAR(*quick->quality.max_mm, *careful->quality.max_mm, 2e-7);
      EXPECT_NEAR(quick->quality.distances_mm[17], careful->quality.distances_mm[17], 2e-7);
    }
  }
}

TEST(FitManyPoints, OfACylinderAgreeWithTheCarefulWay) {
  for (const double sector : {0.7, 2.0, 6.2831853}) {
    for (const double offset : {0.0, 1e6}) {
      const Cloud cloud = part_of_cylinder(sector, offset * Eigen::Vector3d(0.3, -1.0, 0.7));
      const auto covariances = alike();
      const auto quick = fit_cylinder(cloud), careful = fit_cylinder(cloud, {.covariances_mm2 = covariances});
      ASSERT_TRUE(quick && careful);
      const double limit = limit_mm(quick->amplification, offset);
      EXPECT_NEAR(quick->diameter_mm, careful->diameter_mm, limit);
      // Both beside the centroid of all points; along the axis that is seen from the axis one step before, turned by 3e-9 at
      // most over 60 mm.
      const Eigen::Vector3d apart = quick->axis_point_mm - careful->axis_point_mm;
      EXPECT_LT(apart.cross(careful->axis_direction).norm(), limit);
      EXPECT_LT(apart.norm(), limit + 2e-7);
      EXPECT_LT(quick->axis_direction.cross(careful->axis_direction).norm(), limit / 10.0);  // mm over a lever of 60 mm
      EXPECT_NEAR(quick->amplification, careful->amplification, 1e-3 * careful->amplification);
      // The covariances state 1 mm; the quick fit has the scatter.
      EXPECT_NEAR(quick->u_axis_point_mm / quick->quality.standard_deviation_mm, careful->u_axis_point_mm,
                  1e-3 * careful->u_axis_point_mm);
      EXPECT_NEAR(quick->quality.rms_mm, careful->quality.rms_mm, 1e-9 * careful->quality.rms_mm);
    }
  }
}

TEST(FitManyPoints, RefusePointsThatAreNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e150}) {
    for (const Rejection rejection : {Rejection::none, Rejection::robust}) {
      Cloud sphere = part_of_sphere(0.9, {1, 2, 3}), cylinder = part_of_cylinder(2.0, {1, 2, 3});
      sphere[4321].y() = cylinder[4321].z() = bad;
      EXPECT_FALSE(fit_plane(sphere, {.rejection = rejection}));
      const auto a = fit_sphere(sphere, {.rejection = rejection});
      const auto b = fit_cylinder(cylinder, {.rejection = rejection});
      ASSERT_FALSE(a || b);
      EXPECT_NE(a.error().sentence.find("4322"), std::string::npos) << a.error().sentence;
      EXPECT_NE(b.error().sentence.find("4322"), std::string::npos) << b.error().sentence;
    }
  }
}

TEST(FitManyPoints, RefuseWhatLeavesTheShapeOpen) {
  Cloud flat = part_of_sphere(0.9, {1, 2, 3});
  for (std::size_t i = 0; i < flat.size(); ++i) flat[i].z() = i % 2 ? 0.01 : -0.01;
  EXPECT_FALSE(fit_sphere(flat));
  EXPECT_FALSE(fit_cylinder(flat));
}

// One of the 6000 points that lies a thousand kilometres off is in no sample; the fit to all follows it, or says why not.
TEST(FitManyPoints, OnePointFarOffIsNotOverlooked) {
  Cloud cloud = part_of_sphere(3.1, {0, 0, 0});
  cloud[4321] = {1e9, 0, 0};
  const auto fit = fit_sphere(cloud);
  if (fit) {
    EXPECT_GT(fit->quality.rms_mm, 1e3);
  }
  const auto robust = fit_sphere(cloud, {.rejection = Rejection::robust});
  ASSERT_TRUE(robust);
  EXPECT_NEAR(robust->diameter_mm, 50.0, 0.01);  // 0.03 mm noise over 6000 points: 0.002 mm, five times
  EXPECT_TRUE(robust->quality.rejected[4321]);
}

TEST(RejectionRobust, IsSettledWhereTheNextSetIsOfNoConsequence) {
  const UsedBits all = all_used(1000000);
  UsedBits next = all;
  for (std::size_t i = 0; i < 20; ++i) next[1000 * i] = 0xfe;
  EXPECT_TRUE(is_settled(all, next));  // twenty points of a million: sqrt(n) / 50
  next[50001] = 0xfe;
  EXPECT_FALSE(is_settled(all, next));
  UsedBits few = all_used(1000);
  few[3] = 0xfe;
  EXPECT_FALSE(is_settled(all_used(1000), few));
}

}  // namespace
}  // namespace fringecal::fitting

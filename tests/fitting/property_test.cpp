// Laws that every fit obeys: it moves and scales with its points, and does not see their order.
#include "tests/fitting/synthetic.h"

#include "core/rigid.h"
#include "fitting/fit.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace fringecal::fitting {
namespace {

Cloud noisy(Cloud cloud, double sigma_mm) {
  Random random(11);
  for (Eigen::Vector3d& p : cloud) p += sigma_mm * Eigen::Vector3d{normal(random), normal(random), normal(random)};
  return cloud;
}
Cloud sphere_points() { return noisy(sphere_cap({5, -3, 40}, 25.0, {1, 1, -2}, 0.9, 0.0), 0.05); }
Cloud cylinder_points() { return noisy(cylinder_sector({5, -3, 40}, {1, 0.3, -2}, 12.0, 60.0, 2.0, 0.0), 0.05); }
Cloud plane_points() {
  Cloud cloud = cylinder_points();
  for (Eigen::Vector3d& p : cloud) p.x() = 0.2 * p.y() - 0.4 * p.z() + 0.01 * p.x();
  return cloud;
}

const Rigid3 kMotion{Eigen::Quaterniond(Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, -2, 0.3).normalized())),
                     {900, -70, 1300}};
Cloud moved(Cloud cloud) {
  for (Eigen::Vector3d& p : cloud) p = kMotion * p;
  return cloud;
}
Cloud scaled(Cloud cloud, double factor) {
  for (Eigen::Vector3d& p : cloud) p *= factor;
  return cloud;
}
Cloud reversed(Cloud cloud) {
  std::reverse(cloud.begin(), cloud.end());
  return cloud;
}

// Coordinates of 1.5e3 mm are rounded to 2e-13 mm; the radius follows with r / height < 5: 1e-11 mm has a factor of 10.
constexpr double kLength_mm = 1e-11;
// The same over levers of 10 mm and more.
constexpr double kAngle_rad = 1e-12;

TEST(FitPlane, MovesWithItsPointsAndDoesNotSeeTheirOrder) {
  const auto a = fit_plane(plane_points()), b = fit_plane(moved(plane_points())),
             c = fit_plane(reversed(plane_points()));
  ASSERT_TRUE(a && b && c);
  EXPECT_LT((kMotion * a->point_mm - b->point_mm).norm(), kLength_mm);
  EXPECT_LT((kMotion.rotation * a->normal).cross(b->normal).norm(), kAngle_rad);
  EXPECT_LT((a->point_mm - c->point_mm).norm(), kLength_mm);
  EXPECT_LT(a->normal.cross(c->normal).norm(), kAngle_rad);
  EXPECT_NEAR(*a->quality.max_mm, *c->quality.max_mm, kLength_mm);
}

TEST(FitSphere, MovesWithItsPointsAndDoesNotSeeTheirOrder) {
  const auto a = fit_sphere(sphere_points()), b = fit_sphere(moved(sphere_points())),
             c = fit_sphere(reversed(sphere_points()));
  ASSERT_TRUE(a && b && c);
  EXPECT_LT((kMotion * a->center_mm - b->center_mm).norm(), kLength_mm);
  EXPECT_LT(std::abs(a->diameter_mm - b->diameter_mm), kLength_mm);
  EXPECT_LT((a->center_mm - c->center_mm).norm(), kLength_mm);
  EXPECT_NEAR(a->u_diameter_mm, b->u_diameter_mm, kLength_mm);
}

TEST(FitCylinder, MovesWithItsPointsAndDoesNotSeeTheirOrder) {
  const auto a = fit_cylinder(cylinder_points()), b = fit_cylinder(moved(cylinder_points())),
             c = fit_cylinder(reversed(cylinder_points()));
  ASSERT_TRUE(a && b && c);
  EXPECT_LT((kMotion * a->axis_point_mm - b->axis_point_mm).norm(), kLength_mm);
  EXPECT_LT((kMotion.rotation * a->axis_direction).cross(b->axis_direction).norm(), kAngle_rad);
  EXPECT_LT(std::abs(a->diameter_mm - b->diameter_mm), kLength_mm);
  EXPECT_LT((a->axis_point_mm - c->axis_point_mm).norm(), kLength_mm);
  EXPECT_NEAR(a->u_axis_direction_rad, b->u_axis_direction_rad, kAngle_rad);
}

TEST(FitAll, ScaleWithTheirPointsFromMicrometresToMetres) {
  for (const double factor : {1e-4, 1e3}) {
    const auto s = fit_sphere(sphere_points()), s2 = fit_sphere(scaled(sphere_points(), factor));
    const auto c = fit_cylinder(cylinder_points()), c2 = fit_cylinder(scaled(cylinder_points(), factor));
    const auto p = fit_plane(plane_points()), p2 = fit_plane(scaled(plane_points(), factor));
    ASSERT_TRUE(s && s2 && c && c2 && p && p2);
    EXPECT_LT(std::abs(s2->diameter_mm / factor - s->diameter_mm), kLength_mm);
    EXPECT_LT(std::abs(s2->u_diameter_mm / factor - s->u_diameter_mm), kLength_mm);
    EXPECT_LT(std::abs(c2->diameter_mm / factor - c->diameter_mm), kLength_mm);
    EXPECT_LT(std::abs(c2->u_axis_point_mm / factor - c->u_axis_point_mm), kLength_mm);
    EXPECT_LT(c2->axis_direction.cross(c->axis_direction).norm(), kAngle_rad);
    EXPECT_LT(std::abs(p2->quality.rms_mm / factor - p->quality.rms_mm), kLength_mm);
    EXPECT_LT(std::abs(p2->u_tilt_rad - p->u_tilt_rad), kAngle_rad);
  }
}

}  // namespace
}  // namespace fringecal::fitting

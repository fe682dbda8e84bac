// Points that cannot answer, and the rules of rejection.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"
#include "fitting/surface.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace fringecal::fitting {
namespace {

using ::testing::HasSubstr;

template <class Fit>
std::string sentence(const Result<Fit>& fit) {
  return fit ? "(a result)" : fit.error().sentence;
}

Cloud line_points() {
  Cloud cloud;
  for (int i = 0; i < 20; ++i) cloud.emplace_back(1.0 * i, 2.0 * i, -0.5 * i);
  return cloud;
}
Cloud circle_points(double z_sigma_mm) {
  Cloud cloud;
  Random random(5);
  for (int i = 0; i < 60; ++i)
    cloud.emplace_back(10 * std::cos(0.1 * i), 10 * std::sin(0.1 * i), z_sigma_mm * normal(random));
  return cloud;
}
Cloud flat_noise() {
  Cloud cloud;
  Random random(6);
  for (int i = 0; i < 500; ++i) cloud.push_back({50 * uniform(random), 50 * uniform(random), 0.01 * normal(random)});
  return cloud;
}

TEST(FitAll, RefuseFewerPointsThanParameters) {
  const Cloud four{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  EXPECT_THAT(sentence(fit_plane(Points(four).first(2))), HasSubstr("at least 3 points and there are 2"));
  EXPECT_THAT(sentence(fit_sphere(Points(four).first(3))), HasSubstr("at least 4 points and there are 3"));
  EXPECT_THAT(sentence(fit_cylinder(four)), HasSubstr("at least 5 points and there are 4"));
  EXPECT_THAT(sentence(fit_sphere({})), HasSubstr("there are 0"));
}

TEST(FitAll, RefusePointsThatAreNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e200}) {
    Cloud cloud = sphere_cap({0, 0, 0}, 10, {0, 0, 1}, 1, 0);
    cloud[16].y() = bad;
    EXPECT_THAT(sentence(fit_plane(cloud)), HasSubstr("point 17 of 240"));
    EXPECT_THAT(sentence(fit_sphere(cloud, {.rejection = Rejection::robust})), HasSubstr("point 17 of 240"));
    EXPECT_THAT(sentence(fit_cylinder(cloud)), HasSubstr("point 17 of 240"));
  }
}

TEST(FitPlane, RefusesPointsOnOneLine) {
  EXPECT_THAT(sentence(fit_plane(line_points())), HasSubstr("on one line"));
  EXPECT_THAT(sentence(fit_plane(Cloud(10, Eigen::Vector3d(1, 2, 3)))), HasSubstr("on one line"));
  Cloud noisy_line = line_points();
  Random random(8);
  for (auto& p : noisy_line) p += 0.01 * Eigen::Vector3d{normal(random), normal(random), normal(random)};
  EXPECT_THAT(sentence(fit_plane(noisy_line)), HasSubstr("on one line"));
}

TEST(FitSphere, RefusesPointsInOnePlane) {
  EXPECT_THAT(sentence(fit_sphere(circle_points(0.0))), HasSubstr("in one plane"));
  Cloud oblique = circle_points(0.0);
  for (auto& p : oblique) p.z() = 0.3 * p.x() - 0.7 * p.y() + 100.0;
  EXPECT_THAT(sentence(fit_sphere(oblique)), HasSubstr("in one plane"));
  EXPECT_THAT(sentence(fit_cylinder(oblique)), HasSubstr("in one plane"));
  EXPECT_THAT(sentence(fit_sphere(line_points())), HasSubstr("in one plane"));
  EXPECT_THAT(sentence(fit_sphere(Cloud(10, Eigen::Vector3d(1, 2, 3)))), HasSubstr("in one plane"));
}

TEST(FitSphere, RefusesACapThatIsAsFlatAsItsNoise) {
  EXPECT_THAT(sentence(fit_sphere(flat_noise())), HasSubstr("as flat as a plane"));
}

TEST(FitCylinder, RefusesPointsThatDoNotDetermineIt) {
  EXPECT_THAT(sentence(fit_cylinder(circle_points(0.0))), HasSubstr("in one plane"));
  EXPECT_THAT(sentence(fit_cylinder(line_points())), HasSubstr("in one plane"));
  EXPECT_THAT(sentence(fit_cylinder(flat_noise())), HasSubstr("as flat as a plane"));
}

TEST(FitRigid, RefusesPairsOnOneLineAndTooFew) {
  EXPECT_THAT(sentence(fit_rigid(line_points(), line_points())), HasSubstr("on one line"));
  EXPECT_THAT(sentence(fit_rigid(Points(line_points()).first(0), {})), HasSubstr("at least 3"));
}

TEST(FitSphere, ThroughFourPointsLeavesTheUncertaintyOpen) {
  const Cloud four{{10, 0, 0}, {-10, 0, 0}, {0, 10, 0}, {0, 0, 10}};
  const auto fit = fit_sphere(four);
  ASSERT_TRUE(fit) << fit.error().sentence;
  EXPECT_NEAR(fit->diameter_mm, 20.0, 1e-13);  // rounding of numbers of size 20
  EXPECT_TRUE(std::isinf(fit->u_diameter_mm));
  EXPECT_TRUE(std::isinf(fit->u_center_mm.x()));
  EXPECT_TRUE(std::isinf(fit->quality.standard_deviation_mm));
}

TEST(FitSphere, GivesDistancesOfEveryPointAsOrdered) {
  Cloud cloud = sphere_cap({1, 2, 3}, 10, {0, 0, 1}, 3, 0.1);
  const auto fit = fit_sphere(cloud);
  ASSERT_TRUE(fit);
  ASSERT_EQ(fit->quality.distances_mm.size(), cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_NEAR(fit->quality.distances_mm[i], i % 2 ? -0.1 : 0.1, 1e-12);  // rounding, 100 times the eps of 10 mm
  }
}

// With and without distances: the same minimum by two ways of rounding. A scatter of a ten-thousandth of the size leaves
// that of the moments 1e-16 / 1e-8 of itself, ten times for the many terms: 1e-7; at a hundred-thousandth they are taken
// along the plane and good to rounding.
TEST(FitAll, WithoutDistancesGiveTheSameSurfaceAndScatter) {
  for (const double noise_mm : {0.0, 1e-9, 1e-3, 0.02, 2.0}) {
    Random random(6);
    Cloud cloud, round;
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector3d e{200 * uniform(random), 150 * uniform(random), noise_mm * normal(random)};
      cloud.push_back(axes_with(Eigen::Vector3d(1, -2, 3), 2) * e + Eigen::Vector3d(100, 200, 1000));
      const Eigen::Vector3d n{normal(random), normal(random), normal(random)};
      round.push_back((25 + noise_mm * normal(random)) * n.normalized() + Eigen::Vector3d(100, 200, 1000));
    }
    const auto a = fit_plane(cloud), b = fit_plane(cloud, {.distances = DistancesWanted::none});
    ASSERT_TRUE(a && b);
    // 1e3 eps of coordinates of 1000 mm
    EXPECT_LT((a->point_mm - b->point_mm).norm(), 2e-10);
    EXPECT_LT(a->normal.cross(b->normal).norm(), 2e-12);
    const double s = a->quality.standard_deviation_mm, rounding_mm = 1e-12;
    EXPECT_NEAR(b->quality.standard_deviation_mm, s, 1e-7 * s + rounding_mm);
    EXPECT_NEAR(b->u_tilt_rad, a->u_tilt_rad, 1e-7 * a->u_tilt_rad + rounding_mm / 100.0);
    EXPECT_NEAR(b->u_offset_mm, a->u_offset_mm, 1e-7 * a->u_offset_mm + rounding_mm);
    EXPECT_TRUE(b->quality.distances_mm.empty());
    EXPECT_FALSE(b->quality.max_mm || b->quality.min_mm);
    const auto c = fit_sphere(round), d = fit_sphere(round, {.distances = DistancesWanted::none});
    const auto e = fit_sphere(round, {.rejection = Rejection::robust, .distances = DistancesWanted::none});
    ASSERT_TRUE(c && d && e);
    EXPECT_EQ(c->diameter_mm, d->diameter_mm);
    EXPECT_EQ(c->quality.standard_deviation_mm, d->quality.standard_deviation_mm);
    EXPECT_TRUE(d->quality.distances_mm.empty() && e->quality.distances_mm.empty());
    EXPECT_EQ(e->quality.rejected.size(), round.size());
  }
}

TEST(RejectionVdi2634, LeavesOutAtMostThreePerMilleAndOnlyBeyondThreeDeviations) {
  Random random(4);
  Cloud cloud;
  for (int i = 0; i < 2000; ++i) {
    cloud.push_back({50 * uniform(random), 50 * uniform(random), 0.02 * (uniform(random) - 0.5)});
  }
  const auto clean = fit_plane(cloud, {.rejection = Rejection::vdi_2634});  // a uniform scatter ends at 1.7 s
  ASSERT_TRUE(clean);
  EXPECT_EQ(clean->quality.n_rejected, 0u);
  for (int i = 0; i < 10; ++i) cloud[static_cast<std::size_t>(100 * i)].z() = 0.2 + 0.01 * i;
  const auto fit = fit_plane(cloud, {.rejection = Rejection::vdi_2634});
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->quality.n_rejected, 6u);  // 0.3 % of 2000: the six farthest of the ten
  for (int i = 0; i < 10; ++i) EXPECT_EQ(fit->quality.rejected[static_cast<std::size_t>(100 * i)], i >= 4);
}

/// Half of the points on the surface, the others anywhere and on a wall.
Cloud with_background(Cloud cloud, double size) {
  Random random(9);
  const std::size_t n = cloud.size();
  for (auto& p : cloud) p += 0.02 * Eigen::Vector3d{normal(random), normal(random), normal(random)};
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d p{size * (uniform(random) - 0.5), size * (uniform(random) - 0.5),
                            size * (uniform(random) - 0.5)};
    cloud.push_back(i % 2 ? p : Eigen::Vector3d(p.x(), p.y(), -0.6 * size + 0.001 * p.z()));
  }
  return cloud;
}

// The surface's points have noise of 0.02 mm: 400 to 700 of them give diameter and position to about 0.005 mm (1 s);
// the few background points within 0.1 mm are 0.5 % of the set and shift less. 0.03 mm is more than five standard
// deviations.
TEST(RejectionRobust, FindsASphereBeforeABackground) {
  Cloud sphere;
  for (const double pole : {0.0, 0.5, 1.0}) {
    const Cloud cap = sphere_cap({10, 5, -5}, 20, {pole, 0.3, 1}, 1.5, 0.0);
    sphere.insert(sphere.end(), cap.begin(), cap.end());
  }
  const auto fit = fit_sphere(with_background(sphere, 120), {.rejection = Rejection::robust});
  ASSERT_TRUE(fit) << fit.error().sentence;
  EXPECT_NEAR(fit->diameter_mm, 40.0, 0.03);
  EXPECT_LT((fit->center_mm - Eigen::Vector3d(10, 5, -5)).norm(), 0.03);
}

TEST(RejectionRobust, FindsACylinderBeforeABackground) {
  const Cloud cylinder = cylinder_sector({10, 5, -5}, {1, 0.3, 0.4}, 20, 80, 3.0, 0.0);
  const auto fit = fit_cylinder(with_background(cylinder, 120), {.rejection = Rejection::robust});
  ASSERT_TRUE(fit) << fit.error().sentence;
  EXPECT_NEAR(fit->diameter_mm, 40.0, 0.03);
  EXPECT_LT(distance_from_axis({10, 5, -5}, fit->axis_point_mm, fit->axis_direction), 0.03);
}

TEST(RejectionRobust, FindsAPlaneAmongOtherPoints) {
  Cloud cloud = flat_noise();
  Random random(10);
  for (int i = 0; i < 400; ++i) cloud.push_back({50 * uniform(random), 50 * uniform(random), 30 * uniform(random)});
  const auto fit = fit_plane(cloud, {.rejection = Rejection::robust});
  ASSERT_TRUE(fit);
  // noise of 0.01 mm, 500 points over 50 mm: 0.0005 mm and 3e-5 rad; five standard deviations
  EXPECT_LT(std::abs(fit->normal.dot(Eigen::Vector3d(25, 25, 0) - fit->point_mm)), 0.0025);
  EXPECT_LT(fit->normal.head<2>().norm(), 1.5e-4);
  EXPECT_GE(fit->quality.n_used, 490u);
  EXPECT_LE(fit->quality.n_used, 505u);
}

TEST(RejectionRobust, GivesTheSameBytesTwice) {
  const Cloud cloud = with_background(cylinder_sector({0, 0, 0}, {0, 0, 1}, 20, 80, 3.0, 0.0), 120);
  const auto a = fit_cylinder(cloud, {.rejection = Rejection::robust}),
             b = fit_cylinder(cloud, {.rejection = Rejection::robust});
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->diameter_mm, b->diameter_mm);
  EXPECT_EQ(a->axis_direction, b->axis_direction);
}

}  // namespace
}  // namespace fringecal::fitting

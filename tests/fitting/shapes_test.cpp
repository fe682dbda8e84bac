// Line, circle, held diameters, weights from covariances, and the data that leave a shape open.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::fitting {
namespace {

using ::testing::HasSubstr;

template <class Fit>
std::string sentence(const Result<Fit>& fit) {
  return fit ? "(a result)" : fit.error().sentence;
}

/// Points of a circle's arc, each place four times: off by delta inwards, outwards, up and down, so that J^T d = 0.
Cloud arc(const Eigen::Vector3d& center, const Eigen::Vector3d& normal, double radius, double angle_rad, double delta) {
  Cloud cloud;
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal);
  for (int i = 0; i < 60; ++i) {
    const double a = angle_rad * ((i + 0.5) / 60.0 - 0.5);
    const Eigen::Vector3d u = turn * Eigen::Vector3d(std::cos(a), std::sin(a), 0.0),
                          z = turn * Eigen::Vector3d::UnitZ();
    add_pair(cloud, center + radius * u, u, delta);
    add_pair(cloud, center + radius * u, z, delta);
  }
  return cloud;
}

TEST(FitCircle, IsExactOnArcsOfAnyPlaneAndOffset) {
  for (const double angle_deg : {20.0, 90.0, 360.0}) {
    for (const double offset : {0.0, 1e6}) {
      const double half = std::min(angle_deg / 2, 90.0) * std::numbers::pi / 180.0,
                   height = 25.0 * (1.0 - std::cos(half));
      const Eigen::Vector3d center = offset * Eigen::Vector3d(0.3, -1.0, 0.7),
                            normal = Eigen::Vector3d(1, -2, 0.4).normalized();
      const auto fit = fit_circle(arc(center, normal, 25.0, angle_deg * std::numbers::pi / 180.0, 0.02 * height));
      ASSERT_TRUE(fit) << fit.error().sentence;
      // rounding of the coordinates times radius / height, as exact_test.cpp derives; 16 for few points
      const double tolerance = 16.0 * 2.2e-16 * (offset + 25.0) * 25.0 / height;
      EXPECT_LT((fit->center_mm - center).norm(), tolerance);
      EXPECT_NEAR(fit->diameter_mm, 50.0, 2.0 * tolerance);
      EXPECT_LT(fit->normal.cross(normal).norm(), tolerance / height);
      EXPECT_NEAR(fit->quality.rms_mm, 0.02 * height, 1e-9 * height + 1e-15 * offset);
    }
  }
}

TEST(FitCircle, ReportsTheScatterOfRepeatsAsUncertainty) {
  constexpr int kRepeats = 10000;
  const Cloud places = arc({0, 0, 0}, {0, 0, 1}, 25.0, 2.0, 0.0);
  Random random(5);
  double d2 = 0, u_d = 0, x2 = 0, u_x = 0;
  for (int i = 0; i < kRepeats; ++i) {
    Cloud cloud = places;
    for (auto& p : cloud) p += 0.01 * Eigen::Vector3d{normal(random), normal(random), normal(random)};
    const auto fit = fit_circle(cloud);
    ASSERT_TRUE(fit);
    d2 += std::pow(fit->diameter_mm - 50.0, 2);
    u_d += fit->u_diameter_mm;
    x2 += std::pow(fit->center_mm.x(), 2);
    u_x += fit->u_center_mm.x();
  }
  // The scatter of 10 000 repeats is known to 1 / sqrt(20 000) = 0.7 %: three of it, and 0.3 % by which the mean of u is
  // below its root mean square with some 80 degrees of freedom.
  EXPECT_NEAR(std::sqrt(d2 / kRepeats) / (u_d / kRepeats), 1.0, 0.025);
  EXPECT_NEAR(std::sqrt(x2 / kRepeats) / (u_x / kRepeats), 1.0, 0.025);
}

TEST(FitLine, FindsDirectionAndUncertainty) {
  constexpr int kRepeats = 10000;
  const Eigen::Vector3d axis = Eigen::Vector3d(1, 2, -0.5).normalized();
  Random random(6);
  double y2 = 0, u = 0, w2 = 0, u_w = 0;
  const Eigen::Vector3d side = axis.cross(Eigen::Vector3d::UnitZ()).normalized();
  for (int i = 0; i < kRepeats; ++i) {
    Cloud cloud;
    for (int k = -20; k <= 20; ++k)
      cloud.push_back(2.0 * k * axis + 0.01 * Eigen::Vector3d{normal(random), normal(random), normal(random)});
    const auto fit = fit_line(cloud);
    ASSERT_TRUE(fit);
    y2 += std::pow(fit->point_mm.dot(side), 2);
    w2 += std::pow(fit->direction.dot(side), 2);
    u += fit->u_point_mm;
    u_w += fit->u_direction_rad;
  }
  EXPECT_NEAR(std::sqrt(y2 / kRepeats) / (u / kRepeats), 1.0, 0.025);
  EXPECT_NEAR(std::sqrt(w2 / kRepeats) / (u_w / kRepeats), 1.0, 0.025);
}

TEST(FitLineAndCircle, RefuseWhatDoesNotDetermineThem) {
  Random random(7);
  Cloud ball, straight;
  for (int i = 0; i < 200; ++i) {
    ball.push_back({normal(random), normal(random), normal(random)});
    straight.push_back({1.0 * i, 0.01 * normal(random), 0.01 * normal(random)});
  }
  EXPECT_THAT(sentence(fit_line(ball)), HasSubstr("determines no line"));
  EXPECT_THAT(sentence(fit_line(Cloud(5, Eigen::Vector3d(1, 2, 3)))), HasSubstr("determines no line"));
  EXPECT_THAT(sentence(fit_circle(straight)), HasSubstr("as straight as a line"));
  EXPECT_THAT(sentence(fit_circle({})), HasSubstr("there are 0"));
}

TEST(FitWithHeldDiameter, FindsThePlaceThatFitsIt) {
  const double radius = 25.0;
  const Cloud cap = sphere_cap({1, 2, 3}, radius, {0, 0, 1}, 0.3, 0.001);
  const auto sphere = fit_sphere(cap, {.fixed_diameter_mm = 2.0 * radius});
  ASSERT_TRUE(sphere) << sphere.error().sentence;
  EXPECT_LT((sphere->center_mm - Eigen::Vector3d(1, 2, 3)).norm(), 1e-12);  // some eps of 25 mm
  EXPECT_EQ(sphere->u_diameter_mm, 0.0);
  EXPECT_NEAR(sphere->diameter_mm, 50.0, 1e-13);
  const auto free = fit_sphere(cap);
  ASSERT_TRUE(free);
  EXPECT_LT(sphere->u_center_mm.z(), 0.2 * free->u_center_mm.z());  // a cap of 17 degrees leaves radius and height tied
  const Cloud sector = cylinder_sector({1, 2, 3}, {0.2, 0.3, 1}, radius, 60.0, 0.6, 0.001);
  const auto cylinder = fit_cylinder(sector, {.fixed_diameter_mm = 2.0 * radius});
  ASSERT_TRUE(cylinder) << cylinder.error().sentence;
  EXPECT_LT(distance_from_axis({1, 2, 3}, cylinder->axis_point_mm, cylinder->axis_direction), 1e-12);
  // another diameter than the points': the residual is no longer the noise alone
  const auto wrong = fit_sphere(cap, {.fixed_diameter_mm = 49.0});
  ASSERT_TRUE(wrong);
  EXPECT_NEAR(wrong->diameter_mm, 49.0, 1e-12);
  EXPECT_GT(wrong->quality.rms_mm, 1.5 * sphere->quality.rms_mm);
}

TEST(FitWithHeldDiameter, RefusesTwoSidesThatFitAlike) {
  Random random(8);
  Cloud flat;
  for (int i = 0; i < 400; ++i) flat.push_back({uniform(random), uniform(random), 0.05 * normal(random)});
  EXPECT_THAT(sentence(fit_sphere(flat, {.fixed_diameter_mm = 50.0})), HasSubstr("from either side"));
}

TEST(FitWithCovariances, WeighsPointsByTheirVarianceAlongTheNormal) {
  // Half of the points ten times as noisy, and only along x: on a sphere that is along the normal here, across it there.
  constexpr int kRepeats = 1000;
  const Cloud places = sphere_cap({0, 0, 0}, 25.0, {1, 0.2, 0.5}, 1.2, 0.0);
  std::vector<Eigen::Matrix3d> covariances;
  Cloud sigmas;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double s = i % 2 ? 0.01 : 0.1;
    sigmas.emplace_back(s, 0.005, 0.005);
    covariances.push_back(sigmas.back().cwiseAbs2().asDiagonal());
  }
  Random random(9);
  double weighted2 = 0, plain2 = 0, u = 0, chi = 0;
  for (int i = 0; i < kRepeats; ++i) {
    Cloud cloud = places;
    for (std::size_t k = 0; k < cloud.size(); ++k)
      cloud[k] += sigmas[k].cwiseProduct(Eigen::Vector3d{normal(random), normal(random), normal(random)});
    const auto fit = fit_sphere(cloud, {.covariances_mm2 = covariances}), plain = fit_sphere(cloud);
    ASSERT_TRUE(fit && plain);
    weighted2 += std::pow(fit->diameter_mm - 50.0, 2);
    plain2 += std::pow(plain->diameter_mm - 50.0, 2);
    u += fit->u_diameter_mm;
    chi += *fit->quality.scatter_over_expected;
  }
  const double scatter = std::sqrt(weighted2 / kRepeats);
  EXPECT_NEAR(scatter / (u / kRepeats), 1.0, 0.09);  // known to 1 / sqrt(2000) = 2.2 %; four of it
  EXPECT_LT(scatter, 0.5 * std::sqrt(plain2 / kRepeats));
  EXPECT_NEAR(chi / kRepeats, 1.0, 0.01);  // each is known to 1 / sqrt(480), the mean of 1000 to 0.0015
  covariances[7].setZero();
  EXPECT_THAT(sentence(fit_sphere(places, {.covariances_mm2 = covariances})), HasSubstr("not positive"));
}

// Five points: always several. Six: the two rings of a prism, which two cylinders of the same size share by symmetry.
TEST(FitCylinder, StatesWhereFewPointsLieOnSeveral) {
  Random random(10);
  Cloud five;
  for (int i = 0; i < 5; ++i) five.push_back({normal(random), normal(random), normal(random)});
  EXPECT_THAT(sentence(fit_cylinder(five)), HasSubstr("two, four or six cylinders"));
  const Cloud octahedron{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  EXPECT_THAT(sentence(fit_cylinder(octahedron)), HasSubstr("equally well on two cylinders"));
}

}  // namespace
}  // namespace fringecal::fitting

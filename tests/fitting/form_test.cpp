// Form deviations and minimum zones, against constructions with a known zone and against CGAL's exact width.
#include "tests/fitting/synthetic.h"

#include "fitting/form.h"

#include <CGAL/Gmpq.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Width_3.h>
#include <CGAL/Width_default_traits_3.h>
#include <gtest/gtest.h>

#include <functional>

namespace fringecal::fitting {
namespace {

// All lengths here are below 200 mm, known to eps of that after some sums: 1e-12 mm.
constexpr double kRounding_mm = 1e-11;

double exact_width(const Cloud& cloud) {
  using Kernel = CGAL::Simple_cartesian<CGAL::Gmpq>;
  std::vector<Kernel::Point_3> points;
  for (const auto& p : cloud) points.emplace_back(p.x(), p.y(), p.z());
  CGAL::Width_3<CGAL::Width_default_traits_3<Kernel>> width(points.begin(), points.end());
  CGAL::Gmpq numerator, denominator;
  width.get_squared_width(numerator, denominator);
  return std::sqrt(CGAL::to_double(numerator / denominator));
}

TEST(Flatness, EqualsTheExactWidth) {
  Random random(1);
  for (int repeat = 0; repeat < 10; ++repeat) {
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd(uniform(random) * 3, Eigen::Vector3d{normal(random), normal(random), 1}.normalized()));
    Cloud cloud;
    for (int i = 0; i < 100; ++i)
      cloud.push_back(turn * Eigen::Vector3d{100 * uniform(random), 60 * uniform(random), 0.05 * normal(random)});
    const auto zone = flatness(cloud);
    ASSERT_TRUE(zone) << zone.error().sentence;
    EXPECT_NEAR(zone->width_mm, exact_width(cloud), kRounding_mm);
    EXPECT_LE(zone->lower_mm, zone->width_mm);
    EXPECT_GT(zone->lower_mm, zone->width_mm - 1e-9);
  }
}

/// A zone of width 2 delta that is the least: contacts inside and outside alternate all around (2 n of them), so that any
/// displacement pushes one of them farther out.
Cloud lobed(double radius, double delta, int lobes, const std::function<Eigen::Vector3d(double)>& place, bool fill) {
  Cloud cloud;
  const int n = fill ? 40 * lobes : 2 * lobes;
  for (int i = 0; i < n; ++i) {
    const double a = 2.0 * std::numbers::pi * i / n;
    const Eigen::Vector3d u = place(a);
    cloud.push_back((radius + delta * std::cos(lobes * a)) * u);
  }
  return cloud;
}

TEST(Roundness, OfALobedSectionIsTwiceItsAmplitude) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.8, Eigen::Vector3d(1, 2, 3).normalized()));
  for (const int lobes : {2, 3, 5}) {
    Cloud cloud = lobed(
        20.0, 0.05, lobes, [](double a) { return Eigen::Vector3d(std::cos(a), std::sin(a), 0); }, true);
    for (auto& p : cloud) p = turn * p + Eigen::Vector3d(5, -3, 40);
    const auto zone = roundness(cloud);
    ASSERT_TRUE(zone) << zone.error().sentence;
    EXPECT_NEAR(zone->width_mm, 0.1, kRounding_mm);
    EXPECT_GT(zone->lower_mm, zone->width_mm - 1e-9);
  }
}

TEST(Roundness, IsLessThanTheRangeAboutTheGaussianCircle) {
  // three bumps on one side: the Gaussian circle is not the zone's
  Random random(2);
  Cloud cloud;
  for (int i = 0; i < 300; ++i) {
    const double a = 2.0 * std::numbers::pi * uniform(random),
                 r = 20.0 + 0.03 * std::max(0.0, std::cos(3 * a)) * (a < 2.0 ? 2.0 : 0.3);
    cloud.emplace_back(r * std::cos(a), r * std::sin(a), 0.0);
  }
  const auto zone = roundness(cloud);
  const auto circle = fit_circle(cloud);
  ASSERT_TRUE(zone && circle);
  double low = 1e9, high = 0;
  for (const auto& p : cloud) {
    const double r = (p - circle->center_mm).norm();
    low = std::min(low, r);
    high = std::max(high, r);
  }
  EXPECT_LT(zone->width_mm, 0.98 * (high - low));
  // no displacement of a fine search is better than the lower bound
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d c = circle->center_mm + 0.02 * Eigen::Vector3d{normal(random), normal(random), 0};
    double l = 1e9, h = 0;
    for (const auto& p : cloud) {
      l = std::min(l, (p - c).norm());
      h = std::max(h, (p - c).norm());
    }
    EXPECT_GE(h - l, zone->lower_mm);
  }
  EXPECT_GT(zone->lower_mm, 0.999 * zone->width_mm);
}

TEST(SphericityAndCylindricity, AreTheKnownZonesOfConstructedSurfaces) {
  // Sphere: eight corners of a cube outside, six face centres inside, by delta.
  Cloud sphere;
  for (const double x : {-1.0, 1.0}) {
    for (const double y : {-1.0, 1.0}) {
      for (const double z : {-1.0, 1.0}) sphere.push_back(25.02 * Eigen::Vector3d(x, y, z).normalized());
    }
    for (int c = 0; c < 3; ++c) sphere.push_back(24.98 * x * Eigen::Vector3d::Unit(c));
  }
  Random random(3);
  for (int i = 0; i < 500; ++i)
    sphere.push_back((25.0 + 0.039 * (uniform(random) - 0.5)) *
                     Eigen::Vector3d{normal(random), normal(random), normal(random)}.normalized());
  const auto ball = sphericity(sphere);
  ASSERT_TRUE(ball) << ball.error().sentence;
  EXPECT_NEAR(ball->width_mm, 0.04, kRounding_mm);
  EXPECT_GT(ball->lower_mm, ball->width_mm - 1e-4 * ball->width_mm);
  // Cylinder: three-lobed sections at three heights.
  Cloud cylinder;
  for (const double z : {-30.0, 0.0, 30.0}) {
    for (const auto& p : lobed(
             20.0, 0.01, 3, [](double a) { return Eigen::Vector3d(std::cos(a), std::sin(a), 0); }, true)) {
      cylinder.emplace_back(p.x(), p.y(), z);
    }
  }
  for (auto& p : cylinder) p = Eigen::Quaterniond(Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, -1, 2).normalized())) * p;
  const auto zone = cylindricity(cylinder);
  ASSERT_TRUE(zone) << zone.error().sentence;
  EXPECT_NEAR(zone->width_mm, 0.02, kRounding_mm);
  EXPECT_LE(zone->lower_mm, zone->width_mm);
  EXPECT_GT(zone->lower_mm, zone->width_mm * (1.0 - 1e-2));
}

/// The least width that a random walk downhill finds, from a centre (a point of the axis) and a direction on; width_of
/// takes both.
template <class Width>
double searched_width(Eigen::Vector3d place, Eigen::Vector3d direction, const Width& width_of) {
  Random random(9);
  double best = width_of(place, direction);
  for (int i = 0; i < 4000; ++i) {
    const double step = 0.02 * std::pow(0.998, i);  // mm; and as much at the ends of 60 mm
    const auto any = [&] { return Eigen::Vector3d{normal(random), normal(random), normal(random)}; };
    const Eigen::Vector3d p = place + step * any(), a = (direction + step / 30.0 * any()).normalized();
    const double width = width_of(p, a);
    if (!(width < best)) continue;
    best = width;
    place = p;
    direction = a;
  }
  return best;
}

// The walk starts at the Gaussian surface. It ends above the certified lower bound, and cannot end below the upper one,
// which the linear programmes left within 1e-9 mm of the least there is.
TEST(SphericityAndCylindricity, BoundWhatASearchOverAllPositionsFinds) {
  Random random(4);
  Cloud ball, tube;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d u = Eigen::Vector3d{normal(random), normal(random), normal(random)}.normalized();
    ball.push_back((25.0 + 0.02 * uniform(random) + 0.05 * std::max(0.0, u.x() * u.y() * u.z())) * u);
    const double a = 2.0 * std::numbers::pi * uniform(random),
                 r = 20.0 + 0.02 * uniform(random) + 0.01 * std::cos(3 * a);
    tube.emplace_back(r * std::cos(a), r * std::sin(a), 60.0 * (uniform(random) - 0.5));
  }
  const auto spread = [](const Cloud& cloud, const auto& size_of) {
    double low = 1e9, high = 0.0;
    for (const auto& p : cloud) {
      low = std::min(low, size_of(p));
      high = std::max(high, size_of(p));
    }
    return high - low;
  };
  const auto of_ball = [&](const Eigen::Vector3d& c, const Eigen::Vector3d&) {
    return spread(ball, [&](const Eigen::Vector3d& p) { return (p - c).norm(); });
  };
  const auto of_tube = [&](const Eigen::Vector3d& c, const Eigen::Vector3d& a) {
    return spread(tube, [&](const Eigen::Vector3d& p) { return distance_from_axis(p, c, a); });
  };
  const auto sphere = fit_sphere(ball);
  const auto cylinder = fit_cylinder(tube);
  const auto sphere_zone = sphericity(ball), cylinder_zone = cylindricity(tube);
  ASSERT_TRUE(sphere && cylinder && sphere_zone && cylinder_zone);
  const double ball_searched = searched_width(sphere->center_mm, {0, 0, 1}, of_ball),
               tube_searched = searched_width(cylinder->axis_point_mm, cylinder->axis_direction, of_tube);
  std::printf("sphericity %.6f .. %.6f, searched %.6f; cylindricity %.6f .. %.6f, searched %.6f mm\n",
              sphere_zone->lower_mm, sphere_zone->width_mm, ball_searched, cylinder_zone->lower_mm,
              cylinder_zone->width_mm, tube_searched);
  EXPECT_GE(ball_searched, sphere_zone->lower_mm);
  EXPECT_GE(tube_searched, cylinder_zone->lower_mm);
  EXPECT_LE(sphere_zone->width_mm, ball_searched + 1e-9);
  EXPECT_LE(cylinder_zone->width_mm, tube_searched + 1e-9);
  // The bounds enclose: the remainder of eq. 3 for displacements of 0.02 mm is 1e-5 mm, a thousandth of the width.
  EXPECT_GT(sphere_zone->lower_mm, 0.999 * sphere_zone->width_mm);
  EXPECT_GT(cylinder_zone->lower_mm, 0.99 * cylinder_zone->width_mm);
}

TEST(FormDeviation, GivesRangeShellAndStandardDeviation) {
  std::vector<double> values;
  for (int i = 0; i < 100; ++i) values.push_back(0.01 * i);  // 95 of 100 equally spaced span 94 steps
  EXPECT_NEAR(narrowest_interval(values, 0.95), 0.94, 1e-15);
  values.push_back(100.0);
  EXPECT_NEAR(narrowest_interval(values, 0.95), 0.95, 1e-15);  // 96 of 101
  EXPECT_EQ(narrowest_interval(values, 1.0), 100.0);
  Cloud cloud = sphere_cap({1, 2, 3}, 10, {0, 0, 1}, 3, 0.1);
  const auto fit = fit_sphere(cloud);
  ASSERT_TRUE(fit);
  const FormDeviation form = form_of(fit->quality);
  EXPECT_NEAR(form.range_mm, 0.2, kRounding_mm);
  EXPECT_NEAR(form.shell_95_mm, 0.2, kRounding_mm);
  EXPECT_EQ(form.standard_deviation_mm, fit->quality.standard_deviation_mm);
}

}  // namespace
}  // namespace fringecal::fitting

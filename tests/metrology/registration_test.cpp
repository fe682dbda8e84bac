// Registration on a free form whose surface is known: views made from it with noise, their true motions given away to
// nobody but the test.
#include "metrology/registration.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <numbers>
#include <random>

namespace fringecal::metrology {
namespace {

constexpr double kNoise = 0.028;  // mm, along the view, as the default instrument's cloud has it

/// A star-shaped body of about 80 mm radius, and its normal from the gradient of |p| - r(direction).
double radius(const Eigen::Vector3d& u) {
  return 80 + 6 * std::sin(3 * u.x() + 2 * u.z()) + 5 * std::cos(4 * u.y() - u.z());
}

Eigen::Vector3d normal_at(const Eigen::Vector3d& p) {
  Eigen::Vector3d gradient;
  for (int i = 0; i < 3; ++i) {
    constexpr double h = 1e-4;
    const Eigen::Vector3d a = p + h * Eigen::Vector3d::Unit(i), b = p - h * Eigen::Vector3d::Unit(i);
    gradient[i] = (a.norm() - radius(a.normalized()) - b.norm() + radius(b.normalized())) / (2 * h);
  }
  return gradient.normalized();
}

struct Made {
  std::vector<View> views;
  std::vector<Rigid3> part_from_view;  // relative to the first view
};

Made views_of(int count, double step_deg, double noise, unsigned seed) {
  std::mt19937_64 generator(seed);
  std::normal_distribution<double> normal;
  // Twelve, wound about the body at changing heights, so that no two triples are congruent.
  std::vector<Eigen::Vector3d> spheres;
  for (int j = 0; j < 12; ++j) {
    const double angle = j * std::numbers::pi / 6 + 0.05 * j * (j % 3);
    spheres.emplace_back(98 * std::cos(angle), 98 * std::sin(angle), 60 * std::sin(1.7 * j));
  }
  Made out;
  Rigid3 first_from_object;
  for (int i = 0; i < count; ++i) {
    // Turned about the object's z, seen along -x of the view, with a hand's tilt.
    const Rigid3 view_from_object{
        Eigen::Quaterniond(Eigen::AngleAxisd(-i * step_deg * std::numbers::pi / 180, Eigen::Vector3d::UnitZ()) *
                           Eigen::AngleAxisd(0.05 * std::sin(2.0 * i), Eigen::Vector3d::UnitX())),
        Eigen::Vector3d(3.0 * i, -2.0 * i, 1.0 * i)};
    if (i == 0) first_from_object = view_from_object;
    View view{.name = "view " + std::to_string(i)};
    const Eigen::Vector3d towards = view_from_object.rotation.inverse() * Eigen::Vector3d::UnitX();
    for (const auto& c : spheres) {
      if (c.normalized().dot(towards) < 0.1) continue;
      view.spheres_mm.push_back(view_from_object * c +
                                noise / 5 * Eigen::Vector3d{normal(generator), normal(generator), normal(generator)});
    }
    // Every 0.8 mm over the half that faces the camera, shifted from view to view so that no two share a point.
    constexpr double kStep = 0.01;
    for (double latitude = -1.3; latitude < 1.3; latitude += kStep) {
      for (double longitude = 0.003 * i; longitude < 2 * std::numbers::pi; longitude += kStep / std::cos(latitude)) {
        const Eigen::Vector3d u(std::cos(latitude) * std::cos(longitude), std::cos(latitude) * std::sin(longitude),
                                std::sin(latitude));
        const Eigen::Vector3d p = radius(u) * u, n = normal_at(p);
        if (n.dot(towards) < 0.5) continue;
        CloudPoint point;
        point.position_mm = view_from_object * p + noise * normal(generator) * Eigen::Vector3d::UnitX();
        point.normal = view_from_object.rotation * n;
        view.cloud.points.push_back(point);
      }
    }
    out.views.push_back(std::move(view));
    out.part_from_view.push_back(first_from_object * view_from_object.inverse());
  }
  return out;
}

double motion_error_mm(const Rigid3& a, const Rigid3& b) {
  double worst = 0;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(80, 0, 0), Eigen::Vector3d(0, 80, 0), Eigen::Vector3d(0, 0, 80)}) {
    worst = std::max(worst, (a * p - b * p).norm());
  }
  return worst;
}

TEST(Registration, FindsTheMotionsOfExactViews) {
  const auto made = views_of(3, 45, 0, 1);
  const auto registration = register_views(made.views, {.refine = false});
  ASSERT_TRUE(registration) << registration.error().sentence;
  for (std::size_t i = 0; i < 3; ++i) {
    // Rounding of rigid motions at 100 mm, and the stop of the turns at 1e-9 mm.
    EXPECT_LT(motion_error_mm(registration->part_from_view[i], made.part_from_view[i]), 1e-6);
  }
}

// All round in eight views. Noise 0.028 along the view; r holds it over the cosine to the normal (n . towards > 0.5, so
// between 1 and 1/2 of it along the normal), and 1/12 of it from the averaged neighbours: 0.02 .. 0.03 mm. The motions:
// thousands of points each against 0.03 mm give 1 um, the mean over the neighbours on a surface of 40 mm radius shifts by up to
// 1.3^2 / (4 x 40) = 0.010 mm, the same way on all sides: 0.015 mm, half the target.
TEST(Registration, BringsEightNoisyViewsTogether) {
  const auto made = views_of(8, 45, kNoise, 2);
  const auto spheres_only = register_views(made.views, {.refine = false});
  const auto registration = register_views(made.views);
  ASSERT_TRUE(registration) << registration.error().sentence;
  double worst = 0, worst_spheres = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    worst = std::max(worst, motion_error_mm(registration->part_from_view[i], made.part_from_view[i]));
    worst_spheres = std::max(worst_spheres, motion_error_mm(spheres_only->part_from_view[i], made.part_from_view[i]));
  }
  RecordProperty("iterations", registration->iterations);
  RecordProperty("worst_mm", std::to_string(worst));
  RecordProperty("worst_spheres_mm", std::to_string(worst_spheres));
  EXPECT_LT(worst, 0.015);
  EXPECT_LT(worst, worst_spheres) << "the surface must add to what the spheres know";
  EXPECT_LE(registration->mean_deviation_mm, 0.010);
  EXPECT_LE(registration->mean_sd_mm, 0.035);
  EXPECT_GT(registration->mean_sd_mm, 0.015) << "below what the noise allows";
  EXPECT_GE(registration->pairs.size(), 16u) << "each view overlaps both neighbours, seen from both sides";
  EXPECT_EQ(merged(made.views, *registration).points.size(), [&] {
    std::size_t n = 0;
    for (const auto& v : made.views) n += v.cloud.points.size();
    return n;
  }());
}

// The modulation of a matt surface falls with the cosine of the light's incidence, so u = noise / cos. With the views' pupils
// known, points beyond the angle are counted and do not take part, and what is left scatters as its own noise says: the
// neighbours' mean adds up to 0.010 mm of shift on 40 mm radius, sqrt(1 + (0.010 / 0.03)^2) = 1.06 of the noise.
TEST(Registration, LeavesTheRimOutAndWeighsPointsByTheirOwnNoise) {
  auto made = views_of(3, 45, 0, 4);
  std::mt19937_64 generator(5);
  std::normal_distribution<double> normal;
  std::size_t beyond = 0;
  const Eigen::Vector3d camera(1000, 0, 0), light(950, 0, 300);
  for (auto& view : made.views) {
    view.pupils = {camera, light};
    for (auto& p : view.cloud.points) {
      const auto cosine = [&](const Eigen::Vector3d& pupil) {
        return p.normal.dot((pupil - p.position_mm).normalized());
      };
      beyond += cosine(camera) < std::cos(45 * M_PI / 180) || cosine(light) < std::cos(45 * M_PI / 180) ? 1 : 0;
      const double u = kNoise / std::max(0.2, cosine(light));
      p.u_along_ray_mm = u;
      p.position_mm += u * normal(generator) * (camera - p.position_mm).normalized();
    }
  }
  const auto middle = register_views(made.views, {.max_incidence_deg = 45}),
             all = register_views(made.views, {.max_incidence_deg = 89});
  ASSERT_TRUE(middle) << middle.error().sentence;
  ASSERT_TRUE(all) << all.error().sentence;
  std::size_t counted = 0;
  for (const std::size_t n : middle->n_grazing) counted += n;
  // Points that the noise of 0.03 mm moved over the border at 1000 mm: an angle of 3e-5, at most a few of 1e5.
  EXPECT_NEAR(static_cast<double>(counted), static_cast<double>(beyond), 20);
  EXPECT_LT(middle->mean_sd_mm, all->mean_sd_mm);
  EXPECT_NEAR(middle->mean_sd_mm / middle->mean_noise_mm, 1.03, 0.07);
}

TEST(Registration, NamesTheViewThatSharesTooFewSpheres) {
  auto made = views_of(2, 45, 0, 1);
  made.views[1].spheres_mm.resize(2);
  const auto registration = register_views(made.views);
  ASSERT_FALSE(registration);
  EXPECT_NE(registration.error().sentence.find("view 1"), std::string::npos);
  auto opposite = views_of(5, 45, 0, 1);
  opposite.views.erase(opposite.views.begin() + 1,
                       opposite.views.begin() + 4);  // 0 and 180 degrees: too little in common
  const auto apart = register_views(opposite.views);
  ASSERT_FALSE(apart);
  EXPECT_NE(apart.error().sentence.find("view 4"), std::string::npos);
}

}  // namespace
}  // namespace fringecal::metrology

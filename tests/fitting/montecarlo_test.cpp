// The reported standard uncertainties are the scatter of repeats.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"

#include <gtest/gtest.h>

namespace fringecal::fitting {
namespace {

constexpr int kRepeats = 2000;
constexpr double kSigma_mm = 0.01;
// The scatter of 2000 repeats is known to 1 / sqrt(2 * 2000) = 1.6 %; three standard deviations of it.
constexpr double kRelative = 0.05;

struct Scatter {
  double sum2 = 0.0, sum_u = 0.0;
  void add(double error, double u) {
    sum2 += error * error;
    sum_u += u;
  }
  double scatter() const { return std::sqrt(sum2 / kRepeats); }
  double ratio() const { return std::sqrt(sum2 / kRepeats) / (sum_u / kRepeats); }
};

/// Places of a surface with independent normal errors along the normal.
Cloud disturbed(const Cloud& places, const Cloud& normals, Random& random) {
  Cloud cloud = places;
  for (std::size_t i = 0; i < cloud.size(); ++i) cloud[i] += kSigma_mm * normal(random) * normals[i];
  return cloud;
}

TEST(FitSphere, ReportsTheScatterOfRepeatsAsUncertainty) {
  const Cloud places = sphere_cap(Eigen::Vector3d::Zero(), 25.0, Eigen::Vector3d::UnitZ(), 0.8, 0.0);
  Cloud normals;
  for (const auto& p : places) normals.push_back(p.normalized());
  Random random(1);
  Scatter diameter, x, z;
  for (int i = 0; i < kRepeats; ++i) {
    const auto fit = fit_sphere(disturbed(places, normals, random));
    ASSERT_TRUE(fit);
    diameter.add(fit->diameter_mm - 50.0, fit->u_diameter_mm);
    x.add(fit->center_mm.x(), fit->u_center_mm.x());
    z.add(fit->center_mm.z(), fit->u_center_mm.z());
  }
  EXPECT_NEAR(diameter.ratio(), 1.0, kRelative);
  EXPECT_NEAR(x.ratio(), 1.0, kRelative);
  EXPECT_NEAR(z.ratio(), 1.0, kRelative);
}

TEST(FitCylinder, ReportsTheScatterOfRepeatsAsUncertainty) {
  // A sector about +x: by symmetry x and y are the principal directions of the axis's errors, and x is the worse one.
  const Cloud places = cylinder_sector(Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ(), 20.0, 50.0, 1.4, 0.0);
  Cloud normals;
  for (const auto& p : places) normals.emplace_back(Eigen::Vector3d(p.x(), p.y(), 0.0).normalized());
  Random random(2);
  Scatter diameter, point, direction_x, direction_y;
  for (int i = 0; i < kRepeats; ++i) {
    const auto fit = fit_cylinder(disturbed(places, normals, random));
    ASSERT_TRUE(fit);
    diameter.add(fit->diameter_mm - 40.0, fit->u_diameter_mm);
    point.add(fit->axis_point_mm.x(), fit->u_axis_point_mm);
    direction_x.add(fit->axis_direction.x(), fit->u_axis_direction_rad);
    direction_y.add(fit->axis_direction.y(), fit->u_axis_direction_rad);
  }
  EXPECT_NEAR(diameter.ratio(), 1.0, kRelative);
  EXPECT_NEAR(point.ratio(), 1.0, kRelative);
  // The worse of the two principal directions is the one with the larger scatter.
  EXPECT_NEAR(direction_x.scatter() > direction_y.scatter() ? direction_x.ratio() : direction_y.ratio(), 1.0,
              kRelative);
}

TEST(FitPlane, ReportsTheScatterOfRepeatsAsUncertainty) {
  Cloud places, normals;
  for (int i = -5; i <= 5; ++i) {
    for (int k = -2; k <= 2; ++k) {
      places.emplace_back(5.0 * i, 5.0 * k, 0.0);
      normals.push_back(Eigen::Vector3d::UnitZ());
    }
  }
  Random random(3);
  Scatter offset, tilt;
  for (int i = 0; i < kRepeats; ++i) {
    const auto fit = fit_plane(disturbed(places, normals, random));
    ASSERT_TRUE(fit);
    offset.add(fit->point_mm.z(), fit->u_offset_mm);
    tilt.add(fit->normal.y(), fit->u_tilt_rad);  // y is the short side
  }
  EXPECT_NEAR(offset.ratio(), 1.0, kRelative);
  EXPECT_NEAR(tilt.ratio(), 1.0, kRelative);
}

}  // namespace
}  // namespace fringecal::fitting

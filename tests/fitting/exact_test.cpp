// Fits of points whose least-squares surface is known exactly (synthetic.h).
#include "tests/fitting/synthetic.h"

#include "core/rigid.h"
#include "fitting/fit.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>

namespace fringecal::fitting {
namespace {

constexpr double kEps = std::numeric_limits<double>::epsilon();
const Eigen::Vector3d kFar(0.3, -1.0, 0.7);
double radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

// An error e of the coordinates changes the height h of a cap or sector by e and so its radius by about e r / h, and
// less after averaging. e is the rounding of coordinates, eps (offset + size). The largest seen is 4 times that (small
// sets of points, rounding of the fit itself); 16 leaves a factor of 4.
double length_tolerance(double offset, double size, double radius, double height) {
  return 16.0 * kEps * (offset + size) * radius / height;
}

TEST(FitSphere, IsExactOnCapsDownToFiveDegreesAtAnyScaleAndOffset) {
  for (const double half_deg : {2.5, 5.0, 15.0, 45.0, 90.0, 180.0}) {
    for (const double radius : {1e-3, 25.0, 1e3, 1e5}) {
      for (const double offset : {0.0, 1e6}) {
        SCOPED_TRACE(fmt::format("half-angle {} deg, radius {} mm, offset {} mm", half_deg, radius, offset));
        const double half = std::min(radians(half_deg), std::numbers::pi / 2);
        const double height = radius * (1.0 - std::cos(half));
        const Eigen::Vector3d center = offset * kFar, pole(-1.0, 2.0, 0.5);
        const auto fit = fit_sphere(sphere_cap(center, radius, pole, radians(half_deg), 0.05 * height));
        ASSERT_TRUE(fit) << fit.error().sentence;
        const double tolerance = length_tolerance(offset, radius * std::sin(half), radius, height);
        EXPECT_LT((fit->center_mm - center).norm(), tolerance);
        EXPECT_LT(std::abs(fit->diameter_mm / 2 - radius), tolerance);
        // F = n delta^2 by construction; at offset 1e6 the coordinates' rounding of 1e-10 mm is part of the scatter
        EXPECT_NEAR(fit->quality.rms_mm, 0.05 * height, 1e-9 * height + 2.0 * kEps * offset);
      }
    }
  }
}

TEST(FitCylinder, IsExactOnSectorsDownToTenDegreesOfAnyLengthAndDirection) {
  const Cloud directions{{1, 0, 0}, {0, 0, 1}, {1, 1, 1}, {1e-4, 1, 0}, {-0.7, 0.3, -0.02}};
  for (const double angle_deg : {10.0, 20.0, 90.0, 360.0}) {
    for (const double radius : {1e-3, 25.0}) {
      for (const double slenderness : {0.02, 1.0, 1e3, 1e5}) {
        for (const double offset : {0.0, 1e6}) {
          SCOPED_TRACE(fmt::format("sector {} deg, radius {} mm, length {} radii, offset {} mm", angle_deg, radius,
                                   slenderness, offset));
          const double half = std::min(radians(angle_deg) / 2, std::numbers::pi / 2);
          const double height = radius * (1.0 - std::cos(half)), length = slenderness * radius;
          const double size = std::max(length, radius * std::sin(half));
          const Eigen::Vector3d& direction = directions[(static_cast<std::size_t>(angle_deg) + (offset > 0)) % 5];
          const Eigen::Vector3d axis = direction.normalized(), point = offset * kFar;
          const double delta = 0.02 * std::min(height, length);
          const auto fit = fit_cylinder(cylinder_sector(point, axis, radius, length, radians(angle_deg), delta));
          ASSERT_TRUE(fit) << fit.error().sentence;
          // the axis and the radius are tied through the tilt of a sector shorter than it is wide: length / width more
          const double tolerance = length_tolerance(offset, size, radius, height) * std::max(1.0, 0.2 / slenderness);
          EXPECT_LT(distance_from_axis(point, fit->axis_point_mm, fit->axis_direction), tolerance);
          EXPECT_LT(std::abs(fit->diameter_mm / 2 - radius), tolerance);
          // the same over a lever of the length
          EXPECT_LT(axis.cross(fit->axis_direction).norm(), tolerance / length);
          EXPECT_GT(fit->axis_direction.maxCoeff(), -fit->axis_direction.minCoeff());
        }
      }
    }
  }
}

TEST(FitPlane, IsExactOnLongThinPatchesAtAnyScaleAndOffset) {
  for (const double aspect : {1.0, 1e3}) {
    for (const double size : {1e-3, 1.0, 1e3}) {
      for (const double offset : {0.0, 1e6}) {
        SCOPED_TRACE(fmt::format("aspect {}, size {} mm, offset {} mm", aspect, size, offset));
        const Eigen::Quaterniond turn(Eigen::AngleAxisd(1.1, Eigen::Vector3d(2, -1, 0.4).normalized()));
        const Eigen::Vector3d normal = turn * Eigen::Vector3d::UnitZ();
        Cloud cloud;
        for (int i = -5; i <= 5; ++i) {
          for (int k = -5; k <= 5; ++k) {
            const Eigen::Vector3d place =
                turn * Eigen::Vector3d(size * i / 5.0, size / aspect * k / 5.0, 0.0) + offset * kFar;
            add_pair(cloud, place, normal, 0.01 * size / aspect);
          }
        }
        const auto fit = fit_plane(cloud);
        ASSERT_TRUE(fit) << fit.error().sentence;
        // rounding of the coordinates over the narrow side's lever; 4 for the few points
        const double rounding = 4.0 * kEps * (offset + size);
        EXPECT_LT(std::abs(normal.dot(fit->point_mm - offset * kFar)), rounding);
        EXPECT_LT(normal.cross(fit->normal).norm(), rounding / (size / aspect));
        EXPECT_NEAR(fit->quality.rms_mm, 0.01 * size / aspect, rounding);
      }
    }
  }
}

TEST(FitRigid, RecoversAMotionAndNeverMirrors) {
  Random random(3);
  Cloud a, b, mirrored;
  const Rigid3 b_from_a{Eigen::Quaterniond(Eigen::AngleAxisd(2.5, Eigen::Vector3d(1, 2, -1).normalized())),
                        {10, -20, 1e4}};
  for (int i = 0; i < 30; ++i) {
    a.push_back({100 * uniform(random), 100 * uniform(random), i % 2 ? 1.0 : 0.0});
    b.push_back(b_from_a * a.back());
    mirrored.emplace_back(a.back().x(), a.back().y(), -a.back().z());
  }
  const auto fit = fit_rigid(a, b);
  ASSERT_TRUE(fit);
  // rounding of coordinates of 1e4 mm (2e-12 mm), over a lever of 50 mm for the rotation
  EXPECT_LT((fit->rotation - b_from_a.rotation_matrix()).norm(), 1e-12);
  EXPECT_LT((fit->translation_mm - b_from_a.translation_mm).norm(), 1e-10);
  EXPECT_LT(fit->rms_mm, 1e-11);
  const auto other = fit_rigid(a, mirrored);
  ASSERT_TRUE(other);
  // the determinant of a product of two orthogonal matrices, each good to some eps
  EXPECT_NEAR(other->rotation.determinant(), 1.0, 1e-14);
}

}  // namespace
}  // namespace fringecal::fitting

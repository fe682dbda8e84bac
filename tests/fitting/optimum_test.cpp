// Distance of the answers from the true optimum, which is found here in 128-bit arithmetic (113 bits of mantissa, about
// 34 digits) by an independent Gauss-Newton in the textbook's parameters.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>

namespace fringecal::fitting {
namespace {

#if defined(__SIZEOF_FLOAT128__)
__extension__ typedef __float128 Quad;
#else
using Quad = long double;
#endif

Quad root(Quad x) {
  if (!(x > 0)) return 0;
  Quad r = std::sqrt(static_cast<double>(x));
  for (int i = 0; i < 3; ++i) r = (r + x / r) / 2;  // 16, 32, 64 digits
  return r;
}

template <int M>
struct Normal {
  std::array<std::array<Quad, M + 1>, M> a{};
  void add(const std::array<Quad, M>& row, Quad d) {
    for (int r = 0; r < M; ++r) {
      for (int c = 0; c < M; ++c) a[r][c] += row[r] * row[c];
      a[r][M] -= row[r] * d;
    }
  }
  std::array<Quad, M> solved() {  // Gauss with pivots
    for (int c = 0; c < M; ++c) {
      int best = c;
      for (int r = c; r < M; ++r) {
        const Quad x = a[r][c] < 0 ? -a[r][c] : a[r][c], y = a[best][c] < 0 ? -a[best][c] : a[best][c];
        if (x > y) best = r;
      }
      std::swap(a[c], a[best]);
      for (int r = 0; r < M; ++r) {
        if (r == c) continue;
        const Quad f = a[r][c] / a[c][c];
        for (int k = c; k <= M; ++k) a[r][k] -= f * a[c][k];
      }
    }
    std::array<Quad, M> x;
    for (int c = 0; c < M; ++c) x[c] = a[c][M] / a[c][c];
    return x;
  }
};

constexpr int kSteps = 60;  // linear convergence by a factor of scatter / radius or, on small caps, scatter / height

struct SphereOptimum {
  double center_mm = 0, radius_mm = 0;  // distance of the given from the optimum
};
SphereOptimum distance_from_optimum(const Cloud& points, const SphereFit& fit) {
  std::array<Quad, 4> s = {fit.center_mm.x(), fit.center_mm.y(), fit.center_mm.z(), fit.diameter_mm / 2};
  for (int step = 0; step < kSteps; ++step) {
    Normal<4> normal;
    for (const auto& p : points) {
      const Quad x = p.x() - s[0], y = p.y() - s[1], z = p.z() - s[2], rho = root(x * x + y * y + z * z);
      normal.add({-x / rho, -y / rho, -z / rho, -1}, rho - s[3]);
    }
    const auto dx = normal.solved();
    for (int c = 0; c < 4; ++c) s[static_cast<std::size_t>(c)] += dx[static_cast<std::size_t>(c)];
  }
  const Eigen::Vector3d off(static_cast<double>(fit.center_mm.x() - s[0]),
                            static_cast<double>(fit.center_mm.y() - s[1]),
                            static_cast<double>(fit.center_mm.z() - s[2]));
  return {off.norm(), std::abs(static_cast<double>(fit.diameter_mm / 2 - s[3]))};
}

struct CylinderOptimum {
  double axis_mm = 0, radius_mm = 0, direction_rad = 0;
};
/// The axis as (x, y) = (s0, s1) + z (s2, s3) in the frame of the answer's axis, so that the optimum is near zero.
CylinderOptimum distance_from_optimum(const Cloud& points, const CylinderFit& fit) {
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(fit.axis_direction, Eigen::Vector3d::UnitZ());
  // The rotation must be exact: its matrix is made orthonormal in 128 bits from the answer's direction.
  const Eigen::Vector3d e1 = turn.conjugate() * Eigen::Vector3d::UnitX();
  using V = std::array<Quad, 3>;
  const auto dot = [](const V& a, const V& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  const auto unit = [&](V a) {
    const Quad n = root(dot(a, a));
    for (Quad& x : a) x /= n;
    return a;
  };
  const V axis = unit({fit.axis_direction.x(), fit.axis_direction.y(), fit.axis_direction.z()});
  V x = {e1.x(), e1.y(), e1.z()};
  const Quad along = dot(x, axis);
  for (std::size_t c = 0; c < 3; ++c) x[c] -= along * axis[c];
  x = unit(x);
  const V y = {axis[1] * x[2] - axis[2] * x[1], axis[2] * x[0] - axis[0] * x[2], axis[0] * x[1] - axis[1] * x[0]};
  std::array<Quad, 5> s = {0, 0, 0, 0, fit.diameter_mm / 2};
  for (int step = 0; step < kSteps; ++step) {
    Normal<5> normal;
    const Quad length = root(1 + s[2] * s[2] + s[3] * s[3]);
    for (const auto& p : points) {
      const V u = {p.x() - Quad(fit.axis_point_mm.x()), p.y() - Quad(fit.axis_point_mm.y()),
                   p.z() - Quad(fit.axis_point_mm.z())};
      const Quad z = dot(u, axis), a = dot(u, x) - s[0], b = dot(u, y) - s[1];
      const Quad t = (a * s[2] + b * s[3] + z) / length;  // along the axis
      const V across = {a - t * s[2] / length, b - t * s[3] / length, z - t / length};
      const Quad rho = root(dot(across, across));
      const Quad nx = across[0] / rho, ny = across[1] / rho;
      normal.add({-nx, -ny, -nx * t / length, -ny * t / length, -1}, rho - s[4]);
    }
    const auto dx = normal.solved();
    for (std::size_t c = 0; c < 5; ++c) s[c] += dx[c];
  }
  return {std::hypot(static_cast<double>(s[0]), static_cast<double>(s[1])),
          std::abs(static_cast<double>(fit.diameter_mm / 2 - s[4])),
          std::hypot(static_cast<double>(s[2]), static_cast<double>(s[3]))};
}

Cloud disturbed(Cloud cloud, double sigma_mm) {
  Random random(21);
  for (auto& p : cloud) p += sigma_mm * Eigen::Vector3d{normal(random), normal(random), normal(random)};
  return cloud;
}
double radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

// The limits are the requirement. What rounding allows: coordinates of 1 m are rounded to 1e-13 mm, and a cap of height
// h makes of an error of its points one of r / h in the radius: 1e-12 mm for the hemisphere, 1e-10 mm for the 5 degree
// cap (r / h = 1050).
constexpr double kWell_mm = 1e-9, kIll_mm = 1e-7;

TEST(Optimum, OfSpheresIsReachedFromHemispheresToCapsOfFiveDegrees) {
  for (const double half_deg : {90.0, 45.0, 15.0, 5.0, 2.5}) {
    SCOPED_TRACE(fmt::format("cap of {} degrees", 2 * half_deg));
    const double height = 25.0 * (1.0 - std::cos(radians(half_deg)));
    const Cloud cloud = disturbed(sphere_cap({100, -200, 1000}, 25.0, {0.3, 1, -0.5}, radians(half_deg), 0.0),
                                  std::min(0.03, 0.1 * height));
    const auto fit = fit_sphere(cloud);
    ASSERT_TRUE(fit) << fit.error().sentence;
    const SphereOptimum off = distance_from_optimum(cloud, *fit);
    RecordProperty(fmt::format("cap_{}_degrees_mm", 2 * half_deg),
                   fmt::format("{:.1e}", std::max(off.center_mm, off.radius_mm)));
    std::printf("sphere, cap of %g degrees: centre %.1e mm, radius %.1e mm from the optimum\n", 2 * half_deg,
                off.center_mm, off.radius_mm);
    const double limit = half_deg >= 15.0 ? kWell_mm : kIll_mm;
    EXPECT_LE(off.center_mm, limit);
    EXPECT_LE(off.radius_mm, limit);
  }
}

TEST(Optimum, OfCylindersIsReachedFromWholeOnesToSectorsOfTenDegrees) {
  for (const double angle_deg : {360.0, 180.0, 90.0, 30.0, 10.0}) {
    SCOPED_TRACE(fmt::format("sector of {} degrees", angle_deg));
    const double height = 60.0 * (1.0 - std::cos(radians(std::min(angle_deg, 180.0) / 2)));
    const Cloud cloud =
        disturbed(cylinder_sector({100, -200, 1000}, {0.3, 1, -0.5}, 60.0, 100.0, radians(angle_deg), 0.0),
                  std::min(0.03, 0.05 * height));
    const auto fit = fit_cylinder(cloud);
    ASSERT_TRUE(fit) << fit.error().sentence;
    const CylinderOptimum off = distance_from_optimum(cloud, *fit);
    std::printf("cylinder, sector of %g degrees: axis %.1e mm, radius %.1e mm, direction %.1e rad from the optimum\n",
                angle_deg, off.axis_mm, off.radius_mm, off.direction_rad);
    const double limit = angle_deg >= 30.0 ? kWell_mm : kIll_mm;
    EXPECT_LE(off.axis_mm, limit);
    EXPECT_LE(off.radius_mm, limit);
    EXPECT_LE(off.direction_rad, limit / 50.0);  // over half the length
  }
}

void plane_is_reached(DistancesWanted wanted) {
  Cloud cloud;
  Random random(22);
  for (int i = 0; i < 2000; ++i)
    cloud.push_back({400 * uniform(random), 300 * uniform(random), 1000 + 0.03 * normal(random)});
  const auto fit = fit_plane(cloud, {.distances = wanted});
  ASSERT_TRUE(fit);
  // z = a + b x + c y with orthogonal distances: Gauss-Newton about the answer, in 128 bits
  std::array<Quad, 3> s = {0, 0, 0};
  const double cx = fit->point_mm.x(), cy = fit->point_mm.y(), cz = fit->point_mm.z();
  s[1] = -fit->normal.x() / Quad(fit->normal.z());
  s[2] = -fit->normal.y() / Quad(fit->normal.z());
  const std::array<Quad, 3> answer = s;
  for (int step = 0; step < kSteps; ++step) {
    Normal<3> equations;
    const Quad g = root(1 + s[1] * s[1] + s[2] * s[2]);
    for (const auto& p : cloud) {
      const Quad x = p.x() - Quad(cx), y = p.y() - Quad(cy), d = (p.z() - Quad(cz) - s[0] - s[1] * x - s[2] * y) / g;
      equations.add({-1 / g, -x / g - d * s[1] / (g * g), -y / g - d * s[2] / (g * g)}, d);
    }
    const auto dx = equations.solved();
    for (std::size_t c = 0; c < 3; ++c) s[c] += dx[c];
  }
  const double offset = std::abs(static_cast<double>(s[0])),
               tilt = std::hypot(static_cast<double>(s[1] - answer[1]), static_cast<double>(s[2] - answer[2]));
  std::printf("plane: offset %.1e mm, tilt %.1e rad from the optimum\n", offset, tilt);
  EXPECT_LE(offset, kWell_mm);
  EXPECT_LE(200.0 * tilt, kWell_mm);  // over half the side
}
TEST(Optimum, OfPlanesIsReached) { plane_is_reached(DistancesWanted::all); }
TEST(Optimum, OfPlanesIsReachedInOnePassWithoutDistances) { plane_is_reached(DistancesWanted::none); }

}  // namespace
}  // namespace fringecal::fitting

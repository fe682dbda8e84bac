// Random small inputs, most of them bad: degenerate, repeated, not finite, denormal, huge. No crash, no hang, and what a
// fit returns is a stationary point of its sum of squares. FRINGECAL_LONG=1: a million inputs, else two thousand.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"
#include "fitting/surface.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <ctime>
#include <limits>

namespace fringecal::fitting {
namespace {

Cloud random_cloud(Random& random) {
  const std::size_t n = random.below(10) == 0 ? random.below(3) : 3 + random.below(random.below(4) == 0 ? 60 : 12);
  const double exponent = random.below(3) == 0 ? 600.0 * uniform(random) - 300.0 : 8.0 * uniform(random) - 4.0;
  const double scale = std::pow(10.0, exponent);
  Cloud cloud;
  const std::uint64_t family = random.below(9);
  const Eigen::Vector3d offset = (random.below(3) == 0 ? 1e6 * scale : 0.0) * Eigen::Vector3d(0.3, -1.0, 0.7);
  for (std::size_t i = 0; i < n; ++i) {
    Eigen::Vector3d p{normal(random), normal(random), normal(random)};
    if (family == 1) p.z() = 0.0;                                                    // in one plane
    if (family == 2) p = p.x() * Eigen::Vector3d(1, 2, -1);                          // on one line
    if (family == 3) p.setZero();                                                    // in one place
    if (family == 4) p.normalize();                                                  // on a sphere
    if (family == 5) p.head<2>().normalize();                                        // on a cylinder
    if (family == 6) p = {std::round(p.x()), std::round(p.y()), std::round(p.z())};  // on a grid, repeated
    if (family == 7) p.z() *= 1e-9;                                                  // nearly in one plane
    if (family == 8) p.head<2>() *= 1e-7;                                            // nearly on one line
    cloud.push_back(scale * p + offset);
  }
  if (n > 0 && random.below(6) == 0) cloud[random.below(n)] = cloud[random.below(n)];
  if (n > 0 && random.below(12) == 0) {
    constexpr double kBad[] = {std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity(),
                               -std::numeric_limits<double>::infinity(),
                               std::numeric_limits<double>::denorm_min(),
                               1e300,
                               -1e99,
                               0.0};
    cloud[random.below(n)][static_cast<Eigen::Index>(random.below(3))] = kBad[random.below(7)];
  }
  return cloud;
}

double distance_to(const PlaneFit& f, const Eigen::Vector3d& p) { return f.normal.dot(p - f.point_mm); }
double distance_to(const SphereFit& f, const Eigen::Vector3d& p) {
  return (p - f.center_mm).norm() - 0.5 * f.diameter_mm;
}
double distance_to(const CylinderFit& f, const Eigen::Vector3d& p) {
  return f.axis_direction.cross(p - f.axis_point_mm).norm() - 0.5 * f.diameter_mm;
}

/// The vector in units of its largest element, so that no square leaves the range of double.
Eigen::VectorXd in_own_unit(const Eigen::VectorXd& v, double* unit) {
  *unit = v.cwiseAbs().maxCoeff();
  return *unit > 0.0 ? Eigen::VectorXd(v / *unit) : v;
}

/// The cosine between the residuals and each column of the Jacobian: zero at a stationary point, whatever the scale.
double worst_cosine(const std::vector<Eigen::VectorXd>& columns, const Eigen::VectorXd& d, double floor) {
  double worst = 0.0, d_unit = 0.0, unit = 0.0;
  const Eigen::VectorXd e = in_own_unit(d, &d_unit);
  if (!(d_unit > 0.0)) return 0.0;
  for (const Eigen::VectorXd& column : columns) {
    const Eigen::VectorXd c = in_own_unit(column, &unit);
    if (unit > 0.0) worst = std::max(worst, std::abs(c.dot(e)) / (c.norm() * (e.norm() + floor / d_unit)));
  }
  return worst;
}

// A fit is compared in its own parameters, whose digits limit what a distance can be. With L the largest of the
// coordinates, the centre's and the diameter: the answer's point is rounded by eps/2 L in each coordinate, sqrt(3)/2 eps L
// together; the difference from it by as much again; a norm or product of three terms by 2 eps L; the radius and its
// difference by eps/2 L each: below 5 eps L, and they may all lie along one column. A direction rounded by eps/2 in each
// component turns by eps: another eps L. So 6 eps L a point must be allowed beyond the limit of the cosine:
constexpr double kRoundings = 6.0;
// The residuals beyond that are orthogonal to 1e-4: a Newton step that is left would change them by 1e-4 of their size,
// F by 1e-8.
constexpr double kCosine = 1e-4;

/// What is wrong with a fit; empty: nothing.
template <class Fit, class Columns>
std::string why_not_stationary(const Cloud& cloud, const Fit& fit, double size, const Columns& columns_of) {
  const auto n = static_cast<Eigen::Index>(cloud.size());
  Eigen::VectorXd d(n);
  double largest = size;
  for (Eigen::Index i = 0; i < n; ++i) {
    d[i] = distance_to(fit, cloud[static_cast<std::size_t>(i)]);
    largest = std::max(largest, cloud[static_cast<std::size_t>(i)].cwiseAbs().maxCoeff());
    if (!std::isfinite(d[i])) return "a distance is not finite";
  }
  const double floor =
      kRoundings / kCosine * std::numeric_limits<double>::epsilon() * largest * std::sqrt(static_cast<double>(n));
  const double cosine = worst_cosine(columns_of(), d, floor);
  if (cosine < kCosine) return {};
  return fmt::format("cosine {:.1e}, {} points, size {:.3g}, largest {:.3g}, |d| {:.3g}, floor {:.3g}", cosine, n, size,
                     largest, d.norm(), floor);
}

std::string problem_of(const Cloud& cloud, Rejection rejection) {
  const auto n = static_cast<Eigen::Index>(cloud.size());
  const auto plane = fit_plane(cloud, {.rejection = rejection});
  const auto sphere = fit_sphere(cloud, {.rejection = rejection});
  const auto cylinder = fit_cylinder(cloud, {.rejection = rejection});
  const auto line = fit_line(cloud);
  const auto circle = fit_circle(cloud);
  if (line && !(std::isfinite(line->quality.rms_mm) && line->direction.allFinite())) return "line: not finite";
  if (circle && !(std::isfinite(circle->quality.rms_mm) && std::isfinite(circle->diameter_mm)))
    return "circle: not finite";
  if (rejection != Rejection::none) return {};
  if (plane) {
    std::string why = why_not_stationary(cloud, *plane, 0.0, [&] {
      std::vector<Eigen::VectorXd> columns(3, Eigen::VectorXd::Ones(n));
      const Eigen::Matrix3d axes = axes_with(plane->normal, 2);
      for (Eigen::Index i = 0; i < n; ++i) {
        const Eigen::Vector3d u = cloud[static_cast<std::size_t>(i)] - plane->point_mm;
        for (Eigen::Index c = 0; c < 2; ++c) columns[static_cast<std::size_t>(c) + 1][i] = axes.col(c).dot(u);
      }
      return columns;
    });
    if (!why.empty()) return "plane: " + why;
  }
  if (sphere) {
    if (!(sphere->diameter_mm > 0.0 && std::isfinite(sphere->diameter_mm))) return "sphere: no diameter";
    std::string why =
        why_not_stationary(cloud, *sphere, sphere->center_mm.cwiseAbs().maxCoeff() + sphere->diameter_mm, [&] {
          std::vector<Eigen::VectorXd> columns(4, Eigen::VectorXd::Ones(n));
          for (Eigen::Index i = 0; i < n; ++i) {
            const Eigen::Vector3d u = (cloud[static_cast<std::size_t>(i)] - sphere->center_mm).normalized();
            for (Eigen::Index c = 0; c < 3; ++c) columns[static_cast<std::size_t>(c) + 1][i] = u[c];
          }
          return columns;
        });
    if (!why.empty()) return "sphere: " + why;
  }
  if (cylinder) {
    if (!(cylinder->diameter_mm > 0.0 && std::isfinite(cylinder->diameter_mm))) return "cylinder: no diameter";
    std::string why = why_not_stationary(
        cloud, *cylinder, cylinder->axis_point_mm.cwiseAbs().maxCoeff() + cylinder->diameter_mm, [&] {
          std::vector<Eigen::VectorXd> columns(5, Eigen::VectorXd::Ones(n));
          const Eigen::Matrix3d axes = axes_with(cylinder->axis_direction, 2);
          for (Eigen::Index i = 0; i < n; ++i) {
            const Eigen::Vector3d v = cloud[static_cast<std::size_t>(i)] - cylinder->axis_point_mm;
            const Eigen::Vector2d u = (axes.leftCols<2>().transpose() * v).normalized();
            for (Eigen::Index c = 0; c < 2; ++c) {
              columns[static_cast<std::size_t>(c) + 1][i] = u[c];
              columns[static_cast<std::size_t>(c) + 3][i] = axes.col(2).dot(v) * u[c];
            }
          }
          return columns;
        });
    if (!why.empty()) return "cylinder: " + why;
  }
  return {};
}

struct Input {
  Cloud cloud;
  Rejection rejection = Rejection::none;
};
Input input_of(int number) {
  Random random(1000003ull * static_cast<std::uint64_t>(number) + 17);
  Input out{random_cloud(random)};
  if (random.below(200) == 0) {
    out.rejection = Rejection::robust;
  } else if (random.below(20) == 0) {
    out.rejection = Rejection::vdi_2634;
  }
  return out;
}

// Cylinders of ten to twenty points beyond the first two thousand inputs: an axis open to the first order; a plane with one
// point far off (twice), where the sum of squares no longer shows the step along a bent valley; a radius that is hardly
// above rounding.
TEST(FitAll, ReturnStationaryPointsOrReasonsWhereTheShapeIsHardlyDetermined) {
  for (const int number : {21517, 23040, 136392, 29261, 816260}) {
    const Input input = input_of(number);
    EXPECT_EQ(problem_of(input.cloud, input.rejection), "") << "input " << number;
  }
}

TEST(FitAll, ReturnStationaryPointsOrReasonsForRandomInputs) {
  const char* set = std::getenv("FRINGECAL_LONG");
  const int inputs = !set ? 2000 : std::atoi(set) > 1 ? std::atoi(set) : 1000000;
  double longest_s = 0.0;
  int failures = 0;
  for (int i = 0; i < inputs; ++i) {
    const auto [cloud, rejection] = input_of(i);
    const std::clock_t start = std::clock();  // processor time: a busy machine is no hang
    const std::string problem = problem_of(cloud, rejection);
    longest_s = std::max(longest_s, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
    if (problem.empty()) continue;
    if (++failures <= 20) ADD_FAILURE() << "input " << i << ": " << problem;
  }
  std::printf("%d inputs, %d problems, the longest took %.3f s for five fits\n", inputs, failures, longest_s);
  EXPECT_LT(longest_s, 1.0);  // the requirement, for one fit
}

}  // namespace
}  // namespace fringecal::fitting

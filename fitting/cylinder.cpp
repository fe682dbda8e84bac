#include "fitting/algebraic.h"
#include "fitting/associate.h"
#include "fitting/surface.h"

#include <algorithm>
#include <array>
#include <numbers>

namespace fringecal::fitting {
namespace {

// The start. For an axis direction a, the points projected along a should lie on a circle. Its algebraic sum of squares
// is a function of moments of degree four alone, so each direction costs the same however many points there are (the
// idea of [Eberly2019], with Pratt's normalisation instead of his, which prefers small radii on short sectors):
//   w = (xx, yy, zz, 2xy, 2xz, 2yz, x, y, z, 1),  z = (|x'|^2, x', 1) = L(a) w,  M(a) = L (sum w w^T) L^T (1)

using Moments = MatrixN<10>;

Moments moments_of(Points normalised) {
  return blocked_sum(normalised, Moments::Zero().eval(), [](const Eigen::Vector3d& p, Moments& sum) {
    VectorN<10> w;
    w << p.cwiseAbs2(), 2.0 * p.x() * p.y(), 2.0 * p.x() * p.z(), 2.0 * p.y() * p.z(), p, 1.0;
    sum += w * w.transpose();
  });
}

std::optional<AlgebraicRound<2>> circle_along(const Eigen::Matrix3d& axes, const Moments& moments) {
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - axes.col(2) * axes.col(2).transpose();
  Eigen::Matrix<double, 4, 10> L = Eigen::Matrix<double, 4, 10>::Zero();
  L.row(0) << across(0, 0), across(1, 1), across(2, 2), across(0, 1), across(0, 2), across(1, 2), 0.0, 0.0, 0.0, 0.0;
  L.block<1, 3>(1, 6) = axes.col(0).transpose();
  L.block<1, 3>(2, 6) = axes.col(1).transpose();
  L(3, 9) = 1.0;
  return pratt<2>(L * moments * L.transpose());  // eq. 1
}

/// As circle_along, from the points themselves: exact where the radius is small against the length.
std::optional<AlgebraicRound<2>> circle_along(const Eigen::Matrix3d& axes, Points normalised) {
  return pratt<2>(blocked_sum(normalised, MatrixN<4>::Zero().eval(), [&](const Eigen::Vector3d& p, MatrixN<4>& sum) {
    VectorN<4> z;
    const double x = axes.col(0).dot(p), y = axes.col(1).dot(p);
    z << x * x + y * y, x, y, 1.0;
    sum += z * z.transpose();
  }));
}

CylinderSurface lifted(const AlgebraicRound<2>& circle, const Eigen::Matrix3d& axes) {
  CylinderSurface out;
  const double sign = circle.k < 0.0 ? -1.0 : 1.0;
  out.anchor = axes.leftCols<2>() * circle.anchor;
  out.axes.col(2) = axes.col(2);
  out.axes.col(0) = sign * axes.leftCols<2>() * circle.normal;
  out.axes.col(1) = out.axes.col(2).cross(out.axes.col(0));
  out.k = sign * circle.k;
  return out;
}

struct Candidate {
  Eigen::Vector3d direction;
  double f;
};

/// Downhill over directions: eight neighbours, the step halved where none is lower.
Candidate refined(Candidate at, const Moments& moments, double step_rad) {
  for (int evaluations = 0; step_rad > 1e-5 && evaluations < 400;) {
    const Eigen::Matrix3d axes = axes_with(at.direction, 2);
    Candidate best = at;
    for (int k = 0; k < 8; ++k, ++evaluations) {
      const double turn = k * std::numbers::pi / 4.0;
      const Eigen::Vector3d direction =
          (at.direction + std::tan(step_rad) * (std::cos(turn) * axes.col(0) + std::sin(turn) * axes.col(1)))
              .normalized();
      const auto circle = circle_along(axes_with(direction, 2), moments);
      if (circle && circle->f < best.f) best = {direction, circle->f};
    }
    if (best.f < at.f) {
      at = best;
    } else {
      step_rad *= 0.5;
    }
  }
  return at;
}

/// Directions worth a descent: distinct low places of the algebraic sum over the hemisphere, and the principal axes.
std::vector<Candidate> candidate_directions(const Moments& moments, const SymmetricEigen<3>& principal) {
  constexpr int kDirections = 500;               // 6.5 degrees apart
  constexpr double kStep = 0.06, kApart = 0.98;  // rad; cosine of 11 degrees
  constexpr std::size_t kLow = 6;
  std::vector<Candidate> all;
  for (int i = 0; i < kDirections; ++i) {  // a spiral of equal area per direction
    const double z = (i + 0.5) / kDirections, turn = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
    const double across = std::sqrt(1.0 - z * z);
    const Eigen::Vector3d direction(across * std::cos(turn), across * std::sin(turn), z);
    if (const auto circle = circle_along(axes_with(direction, 2), moments)) all.push_back({direction, circle->f});
  }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) { return a.f < b.f; });
  std::vector<Candidate> low;
  for (const Candidate& c : all) {
    const auto near = [&](const Candidate& other) { return std::abs(c.direction.dot(other.direction)) > kApart; };
    if (low.size() < kLow && std::none_of(low.begin(), low.end(), near)) low.push_back(c);
  }
  for (Candidate& c : low) c = refined(c, moments, kStep);
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d direction = principal.vectors.col(k);
    const auto circle = circle_along(axes_with(direction, 2), moments);
    if (!circle) continue;
    low.push_back({direction, circle->f});
    low.push_back(refined({direction, circle->f}, moments, kStep));
  }
  return low;
}

/// The lowest minimum of F over all starts.
std::optional<CylinderSurface> start_without_guess(Points normalised, const SymmetricEigen<3>& principal) {
  constexpr std::size_t kPoints = 3000;  // enough to tell the minima apart; the descent on all points follows
  constexpr int kIterations = 40;
  Random random(5);
  const std::vector<Eigen::Vector3d> some = random_subset(normalised, kPoints, random);
  std::optional<CylinderSurface> best;
  double best_f = 0.0;
  for (const Candidate& c : candidate_directions(moments_of(some), principal)) {
    const Eigen::Matrix3d axes = axes_with(c.direction, 2);
    const auto circle = circle_along(axes, some);
    if (!circle) continue;
    const auto minimum = gauss_newton(lifted(*circle, axes), some, kIterations);
    if (minimum && (!best || minimum->f < best_f)) {
      best = minimum->surface;
      best_f = minimum->f;
    }
  }
  return best;
}

CylinderSurface convex(const CylinderSurface& c) {
  if (c.k >= 0.0) return c;
  CylinderSurface out = c;
  out.axes.col(0) = -c.axes.col(0);
  out.axes.col(1) = -c.axes.col(1);
  out.k = -c.k;
  return out;
}

struct CylinderShape {
  using Surface = CylinderSurface;
  static constexpr const char* kName = "cylinder";

  static Result<Minimum<CylinderSurface>> solve(Points points_mm, int max_iterations,
                                                const std::optional<CylinderSurface>& start_mm) {
    const Normalised frame = normalise(points_mm);
    const double n = static_cast<double>(points_mm.size());
    const SymmetricEigen<3> principal = principal_axes(frame.points);
    const double plane_f = std::max(0.0, principal.values[0]);
    const double thickness_mm = frame.scale_mm * std::sqrt(plane_f / n);
    if (!(std::sqrt(plane_f / n) > 4.0 * frame.rounding)) {
      return unanswerable(
          fmt::format("the {} points lie in one plane (within {:.3g} mm rms), which determines no cylinder; measure "
                      "more of its circumference and length",
                      points_mm.size(), thickness_mm));
    }
    std::optional<CylinderSurface> start;
    if (start_mm) {
      start = start_mm->transformed(1.0 / frame.scale_mm, -frame.origin_mm / frame.scale_mm);
    } else {
      start = start_without_guess(frame.points, principal);
    }
    if (!start) return unanswerable(why_no_minimum(Descent::singular, kName, max_iterations));
    auto minimum = gauss_newton(convex(start->anchored_beside(Eigen::Vector3d::Zero())), frame.points, max_iterations);
    if (!minimum) return unanswerable(why_no_minimum(minimum.error(), kName, max_iterations));
    minimum->surface = convex(minimum->surface);
    // Two parameters more than a plane must gain more than 4 standard deviations; else radius and axis are open.
    const double s2 = n > 5 ? minimum->f / (n - 5.0) : 0.0;
    if (!(plane_f - minimum->f > 2.0 * 16.0 * s2)) {
      return unanswerable(
          fmt::format("the {} points are as flat as a plane ({:.3g} mm rms from it, {:.3g} mm from the best "
                      "cylinder), so radius and axis are open; measure more of its circumference",
                      points_mm.size(), thickness_mm, frame.scale_mm * std::sqrt(minimum->f / n)));
    }
    const double u_axis = std::sqrt(s2 * std::max(minimum->inverse_jtj(2, 2), minimum->inverse_jtj(3, 3)));
    if (!(u_axis < 0.3)) {
      return unanswerable(
          fmt::format("the {} points leave the direction of the cylinder's axis open by {:.2g} rad (standard "
                      "uncertainty); measure more of its length",
                      points_mm.size(), u_axis));
    }
    return in_mm(*minimum, frame, {frame.scale_mm, 1.0, 1.0, 1.0, 1.0 / frame.scale_mm});
  }

  /// From two points with normals: the axis is normal to both; or, where a scan is too coarse for normals, from six
  /// points.
  static std::optional<CylinderSurface> propose(const Sample& sample, Random& random) {
    const std::size_t n = sample.points.size();
    const std::size_t i = random.below(n), j = random.below(n);
    const Eigen::Vector3d direction = sample.normals[i].cross(sample.normals[j]);
    if (!(direction.norm() > 0.05)) return std::nullopt;
    const Eigen::Matrix3d axes = axes_with(direction, 2);
    const auto flat = [&](const Eigen::Vector3d& v) { return Eigen::Vector2d(axes.col(0).dot(v), axes.col(1).dot(v)); };
    const Eigen::Vector2d a = flat(sample.points[i]), b = flat(sample.points[j]);
    const Eigen::Vector2d m = flat(sample.normals[i]).normalized(), l = flat(sample.normals[j]).normalized();
    const double sine = m.x() * l.y() - m.y() * l.x();
    if (!(std::abs(sine) > 0.05)) return std::nullopt;
    const Eigen::Vector2d u = b - a;
    const double s = (u.x() * l.y() - u.y() * l.x()) / sine;  // a + s m = b + t l
    const Eigen::Vector2d center = a + s * m;
    const double radius = 0.5 * (std::abs(s) + (center - b).norm());
    if (!(radius > 1e-9) || !(std::abs(radius - std::abs(s)) < 0.1 * radius)) return std::nullopt;
    AlgebraicRound<2> circle;
    circle.normal = (center - a).normalized();
    circle.anchor = center - radius * circle.normal;
    circle.k = 1.0 / radius;
    return lifted(circle, axes);
  }

  static bool is_round(Points near, const CylinderSurface& cylinder) {
    if (near.size() < 6) return false;
    double f = 0.0;
    for (const Eigen::Vector3d& p : near) f += std::pow(cylinder.distance(p), 2);
    return principal_axes(near).values[0] > 9.0 * f;
  }
};

}  // namespace

Result<CylinderFit> fit_cylinder(Points points_mm, const FitOptions& options) {
  const auto found = associate<CylinderShape>(points_mm, options);
  if (!found) return tl::unexpected(found.error());
  const CylinderSurface& cylinder = found->minimum.surface;
  const double r = 1.0 / cylinder.k;
  CylinderFit out;
  out.axis_point_mm = cylinder.anchor + r * cylinder.axes.col(0);
  out.axis_direction = largest_positive(cylinder.axes.col(2));
  out.diameter_mm = 2.0 * r;
  // axis point = o + n / k, o beside the centroid: n d(shift) + b r d(turn) - n r^2 dk
  VectorN<5> along_n = VectorN<5>::Unit(0);
  along_n[4] = -r * r;
  out.u_axis_point_mm = worse_uncertainty<5>(along_n, r * VectorN<5>::Unit(1), found->covariance);
  out.u_axis_direction_rad = worse_uncertainty<5>(VectorN<5>::Unit(2), VectorN<5>::Unit(3), found->covariance);
  out.u_diameter_mm = standard_uncertainty<5>(2.0 * r * r * VectorN<5>::Unit(4), found->covariance);
  out.quality = found->quality;
  return out;
}

}  // namespace fringecal::fitting

#include "fitting/algebraic.h"
#include "fitting/associate.h"
#include "fitting/surface.h"

namespace fringecal::fitting {
namespace {

/// The circle while it is being fitted: a point of it, axes n (towards the centre), t (along it), z (across its plane),
/// and its curvature, as surface.h has surfaces. Parameters: shifts along n and z, turns about n, t and z, k.
struct Circle {
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double k = 0.0;

  Circle moved(const VectorN<6>& s) const {
    const Eigen::Vector3d w = axes * s.segment<3>(2);
    return {anchor + s[0] * axes.col(0) + s[1] * axes.col(2), turned(axes, w), k + s[5]};
  }
};

struct Linearized {
  MatrixN<6> jtj = MatrixN<6>::Zero();
  VectorN<6> jtd = VectorN<6>::Zero();
  double f = 0.0;
  Linearized& operator+=(const Linearized& o) {
    jtj += o.jtj;
    jtd += o.jtd;
    f += o.f;
    return *this;
  }
};

Linearized linearize(const Circle& circle, Points normalised) {
  return blocked_sum(normalised, Linearized{}, [&](const Eigen::Vector3d& p, Linearized& sum) {
    const Eigen::Vector3d u = circle.axes.transpose() * (p - circle.anchor);
    const double k = circle.k, q = u.x() * u.x() + u.y() * u.y(), A = k * q - 2.0 * u.x();
    const double root = std::sqrt(std::max(0.0, 1.0 + k * A)), D = std::max(root, 1e-150), in = A / (1.0 + root);
    const double gx = (k * u.x() - 1.0) / D, gy = k * u.y() / D;  // of surface.h, eq. 1
    const double dd_dk = q / (1.0 + root) - A * (A + k * q) / (2.0 * D * (1.0 + root) * (1.0 + root));
    VectorN<6> radial, across;
    // a turn by w changes u by u x w, a shift by its opposite
    radial << -gx, 0.0, gy * u.z(), -gx * u.z(), gx * u.y() - gy * u.x(), dd_dk;
    across << 0.0, -1.0, -u.y(), u.x(), 0.0, 0.0;
    sum.jtj += radial * radial.transpose() + across * across.transpose();
    sum.jtd += radial * in + across * u.z();
    sum.f += in * in + u.z() * u.z();
  });
}

std::optional<Circle> start_of(Points normalised, const Eigen::Matrix3d& axes) {
  const auto found =
      pratt<2>(blocked_sum(normalised, MatrixN<4>::Zero().eval(), [&](const Eigen::Vector3d& p, MatrixN<4>& sum) {
        VectorN<4> z;
        const double x = axes.col(0).dot(p), y = axes.col(1).dot(p);
        z << x * x + y * y, x, y, 1.0;
        sum += z * z.transpose();
      }));
  if (!found) return std::nullopt;
  const double sign = found->k < 0.0 ? -1.0 : 1.0;
  Circle out;
  out.anchor = axes.leftCols<2>() * found->anchor;
  out.axes.col(0) = sign * axes.leftCols<2>() * found->normal;
  out.axes.col(2) = axes.col(2);
  out.axes.col(1) = out.axes.col(2).cross(out.axes.col(0));
  out.k = std::abs(found->k);
  return out;
}

struct CircleMinimum {
  Circle circle;
  MatrixN<6> inverse;
  double f;
  int iterations;
};

/// As gauss_newton() of least_squares.h, for two distances per point.
std::optional<CircleMinimum> descend(Circle circle, Points normalised) {
  constexpr int kIterations = 100, kHalvings = 30;
  const double n = static_cast<double>(normalised.size());
  Linearized at = linearize(circle, normalised);
  auto newton = solve_normal_equations<6>(at.jtj, -at.jtd);
  for (int iteration = 0; newton; ++iteration) {
    const double length2 = -newton->x.dot(at.jtd);
    const CircleMinimum here{circle, newton->inverse, at.f, iteration};
    if (!(length2 > 1e-32 * n)) return here;
    const bool at_the_end = !(length2 > std::max(1e-11 * at.f, 2e-15 * std::sqrt(at.f * n)));
    bool better = false;
    VectorN<6> step = newton->x;
    for (int halving = 0; !better && halving <= (at_the_end ? 2 : kHalvings); ++halving, step *= 0.5) {
      const Circle trial = circle.moved(step);
      const Linearized there = linearize(trial, normalised);
      if (!at_the_end && !(there.f < at.f)) continue;
      auto next = solve_normal_equations<6>(there.jtj, -there.jtd);
      better = !at_the_end || (next && -next->x.dot(there.jtd) < 0.5 * length2);
      if (!better) continue;
      circle = trial;
      at = there;
      newton = std::move(next);
    }
    if (!better && at_the_end) return here;
    if (!better || iteration >= kIterations) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

Result<CircleFit> fit_circle(Points points_mm) {
  const std::size_t count = points_mm.size();
  if (std::string why = why_too_few(count, 3, "circle"); !why.empty()) return unanswerable(std::move(why));
  const CentredPoints points = centred(points_mm, {}, count);
  if (!points.finite) return unanswerable(why_not_finite(points_mm));
  const double n = points.framed.n, scale_mm = points.framed.scale_mm;
  const double line_f = points.axes.values[0] + points.axes.values[1];
  const auto straight = [&](double f) {
    return unanswerable(fmt::format(
        "the {} points are as straight as a line ({:.3g} mm rms from it, {:.3g} mm from the best circle), so "
        "the circle is open; measure a longer arc",
        count, scale_mm * std::sqrt(line_f / n), scale_mm * std::sqrt(f / n)));
  };
  if (!(std::sqrt(line_f / n) > 4.0 * points.rounding)) return straight(0.0);
  std::vector<Eigen::Vector3d> normalised;
  normalised.reserve(count);
  for (const Eigen::Vector3d& p : points_mm) normalised.push_back(points.framed.in_frame(p));
  Eigen::Matrix3d axes;
  axes << points.axes.vectors.col(2), points.axes.vectors.col(1),
      points.axes.vectors.col(2).cross(points.axes.vectors.col(1));
  const auto start = start_of(normalised, axes);
  if (!start) return unanswerable(why_no_minimum(Descent::singular, "circle", 0));
  auto found = descend(*start, normalised);
  if (!found) {
    // On straight points the descent wanders: the circle it started from gains nothing on the line either.
    const double f = linearize(*start, normalised).f;
    if (!(line_f - f > 2.0 * 16.0 * f / (2.0 * n - 6.0))) return straight(f);
    return unanswerable(why_no_minimum(Descent::not_converged, "circle", 100));
  }
  Circle& circle = found->circle;
  if (circle.k < 0.0) {
    circle.axes.col(0) *= -1.0;
    circle.axes.col(1) *= -1.0;
    circle.k = -circle.k;
  }
  // Two parameters more than a line must gain more than 4 standard deviations.
  const double s2 = count > 3 ? found->f / (2.0 * n - 6.0) : 0.0;
  if (!(line_f - found->f > 2.0 * 16.0 * s2 && circle.k > 0.0)) return straight(found->f);
  const double u_axis = std::sqrt(s2 * std::max(found->inverse(2, 2), found->inverse(3, 3)));
  if (!(u_axis < 0.3)) {
    return unanswerable(
        fmt::format("the {} points leave the plane of the circle open by {:.2g} rad (standard uncertainty); "
                    "measure a longer arc",
                    count, u_axis));
  }
  CircleFit out;
  const double r = 1.0 / circle.k;
  const Eigen::Vector3d center = circle.anchor + r * circle.axes.col(0);
  out.center_mm = scale_mm * center + points.framed.origin_mm;
  out.normal = largest_positive(circle.axes.col(2));
  out.diameter_mm = 2.0 * r * scale_mm;
  FitQuality& quality = out.quality;
  quality.distances_mm.reserve(count);
  for (const Eigen::Vector3d& p : normalised) {
    const Eigen::Vector3d u = circle.axes.transpose() * (p - circle.anchor);
    const double in = detail::curved_distance(circle.k * (u.x() * u.x() + u.y() * u.y()) - 2.0 * u.x(), circle.k);
    quality.distances_mm.push_back(scale_mm * std::hypot(in, u.z()));  // eq. 5
  }
  const auto [low, high] = std::minmax_element(quality.distances_mm.begin(), quality.distances_mm.end());
  quality.min_mm = *low;
  quality.max_mm = *high;
  quality.n_used = count;
  quality.rejected.assign(count, false);
  quality.iterations = found->iterations;
  quality.rms_mm = scale_mm * std::sqrt(found->f / n);
  quality.standard_deviation_mm = scale_mm * standard_deviation(found->f, 2.0 * n, 6);
  const double s = standard_deviation(found->f, 2.0 * n, 6);
  const MatrixN<6> covariance = s * s * found->inverse;
  // centre = anchor + n / k: its parts along n, t and z
  Eigen::Matrix<double, 3, 6> local = Eigen::Matrix<double, 3, 6>::Zero();
  local(0, 0) = local(2, 1) = 1.0;
  local(0, 5) = -r * r;
  local(1, 4) = r;
  local(2, 3) = -r;
  const Eigen::Matrix<double, 3, 6> gradient = circle.axes * local;
  for (int c = 0; c < 3; ++c) {
    out.u_center_mm[c] = scale_mm * standard_uncertainty<6>(gradient.row(c).transpose(), covariance);
  }
  out.u_normal_rad = worse_uncertainty<6>(VectorN<6>::Unit(2), VectorN<6>::Unit(3), covariance);
  out.u_diameter_mm = scale_mm * standard_uncertainty<6>(2.0 * r * r * VectorN<6>::Unit(5), covariance);
  return out;
}

}  // namespace fringecal::fitting

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
    const double x = p.x(), y = p.y(), z = p.z();
    const VectorN<10> w{{x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z, x, y, z, 1.0}};
    for (int c = 0; c < 10; ++c) sum.col(c) += w[c] * w;
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

/// Directions over a hemisphere, each with the same area, and axes across them.
const std::vector<Eigen::Matrix3d>& directions(int count) {
  const auto spiral = [](int n) {
    std::vector<Eigen::Matrix3d> out;
    for (int i = 0; i < n; ++i) {
      const double z = (i + 0.5) / n, turn = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
      const double across = std::sqrt(1.0 - z * z);
      out.push_back(axes_with({across * std::cos(turn), across * std::sin(turn), z}, 2));
    }
    return out;
  };
  static const std::vector<Eigen::Matrix3d> coarse = spiral(150), fine = spiral(500);  // 12 and 6.5 degrees apart
  return count == 150 ? coarse : fine;
}

/// The quick measure of a direction: linear regression of |x'|^2 on x' [Kasa1976], its sum of squares divided by the
/// mean squared gradient 4 |x' - centre|^2. It prefers small radii on short noisy sectors, so it only proposes.
double quick_f(const Eigen::Matrix3d& axes, const Moments& moments) {
  const Eigen::Vector3d a = axes.col(2);
  VectorN<6> w;
  w << 1.0 - a.x() * a.x(), 1.0 - a.y() * a.y(), 1.0 - a.z() * a.z(), -a.x() * a.y(), -a.x() * a.z(), -a.y() * a.z();
  const double n = moments(9, 9);
  const Eigen::Vector3d to_x = moments.block<6, 3>(0, 6).transpose() * w / n;
  const Eigen::Vector3d mean = moments.block<3, 1>(6, 9) / n;
  const double s = w.dot(moments.block<6, 1>(0, 9)) / n;
  const Eigen::Vector2d m = axes.leftCols<2>().transpose() * mean;
  const Eigen::Vector2d c = axes.leftCols<2>().transpose() * to_x - s * m;
  const Eigen::Matrix2d C =
      axes.leftCols<2>().transpose() * (moments.block<3, 3>(6, 6) / n) * axes.leftCols<2>() - m * m.transpose();
  const double determinant = C(0, 0) * C(1, 1) - C(0, 1) * C(0, 1);
  if (!(determinant > 0.0)) return std::numeric_limits<double>::infinity();
  const Eigen::Vector2d b =
      Eigen::Vector2d(C(1, 1) * c.x() - C(0, 1) * c.y(), C(0, 0) * c.y() - C(0, 1) * c.x()) / determinant;
  const double residual = w.dot(moments.block<6, 6>(0, 0) * w) / n - s * s - c.dot(b);
  const double gradient = 4.0 * (s - b.dot(m) + 0.25 * b.squaredNorm());
  return gradient > 0.0 ? n * std::max(0.0, residual) / gradient : std::numeric_limits<double>::infinity();
}

/// Downhill over directions: eight neighbours, the step halved where none is lower.
template <class Measure>
Candidate refined(Candidate at, double step_rad, double last_step_rad, const Measure& measure) {
  for (int evaluations = 0; step_rad > last_step_rad && evaluations < 400;) {
    const Eigen::Matrix3d axes = axes_with(at.direction, 2);
    Candidate best = at;
    for (int k = 0; k < 8; ++k, ++evaluations) {
      const double turn = k * std::numbers::pi / 4.0;
      const Eigen::Vector3d direction =
          (at.direction + std::tan(step_rad) * (std::cos(turn) * axes.col(0) + std::sin(turn) * axes.col(1)))
              .normalized();
      const double f = measure(axes_with(direction, 2));
      if (f < best.f) best = {direction, f};
    }
    if (best.f < at.f) {
      at = best;
    } else {
      step_rad *= 0.5;
    }
  }
  return at;
}

/// The distinct low places of the measure, the lowest first.
template <class Measure>
std::vector<Candidate> low_directions(const std::vector<Eigen::Matrix3d>& all_axes, std::size_t most,
                                      const Measure& measure) {
  constexpr double kApart = 0.98;  // cosine of 11 degrees
  std::vector<Candidate> all;
  for (const Eigen::Matrix3d& axes : all_axes) {
    const double f = measure(axes);
    if (f < std::numeric_limits<double>::infinity()) all.push_back({axes.col(2), f});
  }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) { return a.f < b.f; });
  std::vector<Candidate> low;
  for (const Candidate& c : all) {
    const auto near = [&](const Candidate& other) { return std::abs(c.direction.dot(other.direction)) > kApart; };
    if (low.size() < most && std::none_of(low.begin(), low.end(), near)) low.push_back(c);
  }
  return low;
}

constexpr double kFirstStep_rad = 0.06;

/// Directions worth a descent: low places of the measure over the hemisphere, and the principal axes.
template <class Measure>
std::vector<Candidate> candidate_directions(const std::vector<Eigen::Matrix3d>& all_axes, std::size_t most,
                                            double last_step_rad, const SymmetricEigen<3>& principal,
                                            const Measure& measure) {
  std::vector<Candidate> low = low_directions(all_axes, most, measure);
  for (Candidate& c : low) c = refined(c, kFirstStep_rad, last_step_rad, measure);
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d direction = principal.vectors.col(k);
    const double f = measure(axes_with(direction, 2));
    if (!(f < std::numeric_limits<double>::infinity())) continue;
    low.push_back({direction, f});
    low.push_back(refined({direction, f}, kFirstStep_rad, last_step_rad, measure));
  }
  return low;
}

CylinderSurface convex_cylinder(const CylinderSurface& c) {
  if (c.k >= 0.0) return c;
  CylinderSurface out = c;
  out.axes.col(0) = -c.axes.col(0);
  out.axes.col(1) = -c.axes.col(1);
  out.k = -c.k;
  return out;
}

/// The descent over the sample from an axis direction; k: a curvature that is held.
tl::expected<Minimum<CylinderSurface>, Descent> descend(Points sample, const Eigen::Vector3d& direction,
                                                        const std::optional<double>& k, double enough) {
  const Eigen::Matrix3d axes = axes_with(direction, 2);
  const auto circle = circle_along(axes, sample);
  if (!circle) return tl::unexpected(Descent::singular);
  CylinderSurface start = convex_cylinder(lifted(*circle, axes));
  if (k) start.k = *k;
  auto minimum = gauss_newton(start, as_they_are(sample),
                              {.max_iterations = 40, .hold_curvature = k.has_value(), .enough = enough});
  if (minimum) minimum->surface = convex_cylinder(minimum->surface);
  return minimum;
}

/// The quick way: few directions, the first descent that ends below `limit`, else the lowest.
std::optional<Minimum<CylinderSurface>> quick_minimum(Points sample, const CentredPoints& centre,
                                                      const std::optional<double>& k, double limit) {
  constexpr std::size_t kLow = 3;
  constexpr double kLastStep_rad = 0.01;
  const Moments moments = moments_of(sample);
  const auto measure = [&](const Eigen::Matrix3d& axes) { return quick_f(axes, moments); };
  std::vector<Eigen::Matrix3d> all = directions(150);
  for (int c = 0; c < 3; ++c) all.push_back(axes_with(centre.axes.vectors.col(c), 2));
  std::optional<Minimum<CylinderSurface>> best;
  for (const Candidate& low : low_directions(all, kLow, measure)) {
    const auto minimum = descend(sample, refined(low, kFirstStep_rad, kLastStep_rad, measure).direction, k, 1e-7);
    if (minimum && (!best || minimum->f < best->f)) best = *minimum;
    if (best && best->f < limit) break;
  }
  return best;
}

/// Believed where it leaves a scatter small against the thickness of the points: so many points on so thin a shell have
/// no second cylinder.
std::optional<CylinderSurface> quick_start(Points sample, const CentredPoints& centre, const std::optional<double>& k) {
  constexpr std::size_t kFewest = 30;
  constexpr double kScatter = 0.1;
  if (sample.size() < kFewest) return std::nullopt;
  const double limit = kScatter * kScatter * centre.plane_f();
  const auto minimum = quick_minimum(sample, centre, k, limit);
  if (!minimum || !(minimum->f < limit)) return std::nullopt;
  return minimum->surface;
}

bool is_distinct(const CylinderSurface& a, const CylinderSurface& b) {
  constexpr double kAngle = 0.02, kPart = 0.02;
  if (a.axes.col(2).cross(b.axes.col(2)).norm() > kAngle) return true;
  if (std::abs(a.k - b.k) > kPart * std::max(a.k, b.k)) return true;
  // The same direction and radius: the distance of the axes in radii.
  const double k = std::max(a.k, 1e-6);
  const Eigen::Vector3d between = b.anchor + b.axes.col(0) / k - a.anchor - a.axes.col(0) / k;
  return k * a.axes.col(2).cross(between).norm() > kPart;
}

/// The thorough way: many directions, the lowest minimum of F over all of them; no start where a second one is as good.
Result<CylinderSurface> thorough_start(const std::vector<Eigen::Vector3d>& all, const CentredPoints& centre,
                                       const std::optional<double>& k) {
  constexpr std::size_t kPoints = 3000, kLow = 6;  // points: enough to tell the minima apart
  constexpr std::size_t kSome = 100, kMany = 20;
  constexpr std::size_t kFew = 8;  // up to here every direction is descended from: minima are many
  Random random(5);
  const std::vector<Eigen::Vector3d> sample = spread_sample(all, {}, kPoints, random);
  const Moments moments = moments_of(sample);
  const auto pratt_f = [&](const Eigen::Matrix3d& axes) {
    const auto circle = circle_along(axes, moments);
    return circle ? circle->f : std::numeric_limits<double>::infinity();
  };
  // Few points cost little to descend with, so that the cheap measure of a direction will do.
  auto candidates = sample.size() <= kSome
                        ? candidate_directions(directions(150), kMany, 0.03, centre.axes,
                                               [&](const Eigen::Matrix3d& axes) { return quick_f(axes, moments); })
                        : candidate_directions(directions(500), kLow, 1e-5, centre.axes, pratt_f);
  if (sample.size() <= kFew) {
    for (const Eigen::Matrix3d& axes : directions(150)) candidates.push_back({axes.col(2), 0.0});
  }
  std::vector<Minimum<CylinderSurface>> minima;
  for (const Candidate& c : candidates) {
    const auto minimum = descend(sample, c.direction, k, sample.size() <= kFew ? 1e-16 : 1e-10);
    if (minimum) minima.push_back(*minimum);
  }
  if (minima.empty()) return unanswerable(why_no_minimum(Descent::singular, "cylinder", 0));
  std::stable_sort(minima.begin(), minima.end(), [](const auto& a, const auto& b) { return a.f < b.f; });
  const Minimum<CylinderSurface>& best = minima.front();
  const double n = static_cast<double>(sample.size());
  const double freedom = n - (k ? 4.0 : 5.0);
  const double s2 = freedom > 0.0 ? best.f / freedom : 0.0;
  const double plane_f = centre.plane_f();
  if (!(plane_f - best.f > 2.0 * 16.0 * s2)) return best.surface;  // a plane; said by why_undetermined()
  // A second minimum within 4 standard deviations, 16 s^2, of the first, or both within rounding.
  for (const Minimum<CylinderSurface>& other : minima) {
    if (other.f - best.f > 16.0 * s2 + 1e-24 * n || !is_distinct(best.surface, other.surface)) continue;
    return unanswerable(
        fmt::format("the {} points lie equally well on two cylinders, with axes {:.3g} degrees apart and radii in the "
                    "ratio {:.3g}; "
                    "measure more of its length and circumference",
                    n,
                    std::asin(std::min(1.0, best.surface.axes.col(2).cross(other.surface.axes.col(2)).norm())) * 180.0 /
                        std::numbers::pi,
                    best.surface.k / other.surface.k));
  }
  return best.surface;
}

struct CylinderShape {
  using Surface = CylinderSurface;
  static constexpr const char* kName = "cylinder";

  static std::string why_flat(const CentredPoints& points) {
    const double thickness = std::sqrt(points.axes.values[0] / points.framed.n);
    if (thickness > 4.0 * points.rounding) return {};
    return fmt::format(
        "the {} points lie in one plane (within {:.3g} mm rms), which determines no cylinder; measure "
        "more of its circumference and length",
        points.framed.n, thickness * points.framed.scale_mm);
  }

  static Result<CylinderSurface> start(const CentredPoints& points, std::size_t most, const FitOptions& options) {
    std::optional<double> k;
    if (options.fixed_diameter_mm) k = 2.0 * points.framed.scale_mm / *options.fixed_diameter_mm;
    // Cylinders through five points come in pairs [Devillers2003].
    if (points.framed.n == 5.0 && !k) {
      return unanswerable(
          "five points lie on two, four or six cylinders; measure at least one point more, better fifty");
    }
    Random random(5);
    const std::vector<Eigen::Vector3d> sample = sample_in_frame(points.framed, most, random);
    if (sample.size() < 4) return unanswerable(why_no_minimum(Descent::singular, kName, 0));
    const CentredPoints centre = centred(sample, {}, sample.size());
    if (auto quick = quick_start(sample, centre, k)) return *quick;
    return thorough_start(sample, centre, k);
  }

  static std::optional<CylinderSurface> rough_start(Points points) {
    constexpr std::size_t kPoints = 200;
    Random random(11);
    const std::vector<Eigen::Vector3d> some = spread_sample(points, {}, kPoints, random);
    const CentredPoints centre = centred(some, {}, some.size());
    const auto minimum = quick_minimum(some, centre, std::nullopt, 0.01 * centre.plane_f());
    if (!minimum) return std::nullopt;
    return minimum->surface;
  }

  static std::string why_undetermined(const CentredPoints& points, const Minimum<CylinderSurface>& minimum,
                                      const FitOptions& options) {
    const double n = points.framed.n, plane_f = points.axes.values[0], scale_mm = points.framed.scale_mm;
    const double freedom = n - (options.fixed_diameter_mm ? 4.0 : 5.0);
    const double s2 = freedom > 0.0 ? minimum.f / freedom : 0.0;
    // Two parameters more than a plane must gain more than 4 standard deviations; else radius and axis are open.
    if (!(plane_f - minimum.f > 2.0 * 16.0 * s2 && minimum.surface.k > 0.0)) {
      return fmt::format(
          "the {} points are as flat as a plane ({:.3g} mm rms from it, {:.3g} mm from the best "
          "cylinder), so radius and axis are open; measure more of its circumference",
          n, scale_mm * std::sqrt(plane_f / n), scale_mm * std::sqrt(minimum.f / n));
    }
    const double u_axis = std::sqrt(s2 * std::max(minimum.inverse_jtj(2, 2), minimum.inverse_jtj(3, 3)));
    if (!(u_axis < 0.3)) {
      return fmt::format(
          "the {} points leave the direction of the cylinder's axis open by {:.2g} rad (standard "
          "uncertainty); measure more of its length",
          n, u_axis);
    }
    return {};
  }

  static CylinderSurface convex(const CylinderSurface& s) { return convex_cylinder(s); }
  static CylinderSurface with_curvature(const CylinderSurface& s, double k) { return {s.anchor, s.axes, k}; }
  static CylinderSurface beside_origin(const CylinderSurface& s) { return s.anchored_beside(Eigen::Vector3d::Zero()); }
  /// The same minimum with the anchor at the height of the points' centroid, and so its parameters: with the anchor at h
  /// along the axis the shift is that of before + h tilt towards n, the turn that of before + h k tilt towards b.
  static Minimum<CylinderSurface> beside_centroid(const Minimum<CylinderSurface>& m) {
    Minimum<CylinderSurface> out = m;
    out.surface.anchor += m.along * m.surface.axes.col(2);
    MatrixN<5> from_before = MatrixN<5>::Identity();
    from_before(0, 2) = m.along;
    from_before(1, 3) = m.along * m.surface.k;
    out.inverse_jtj = from_before * m.inverse_jtj * from_before.transpose();
    return out;
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
    return centred(near, {}, near.size()).plane_f() > 9.0 * f;
  }
};

}  // namespace

Result<CylinderFit> fit_cylinder(Points points_mm, const FitOptions& options) {
  auto found = associate<CylinderShape>(points_mm, options);
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
  out.amplification = r * r * std::sqrt(found->minimum.inverse_jtj(4, 4) * static_cast<double>(found->quality.n_used));
  out.quality = std::move(found->quality);
  return out;
}

}  // namespace fringecal::fitting

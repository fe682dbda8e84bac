#include "fitting/algebraic.h"
#include "fitting/associate.h"
#include "fitting/surface.h"

namespace fringecal::fitting {
namespace {

std::optional<SphereSurface> algebraic_sphere(Points normalised) {
  const auto moments =
      blocked_sum(normalised, MatrixN<5>::Zero().eval(), [](const Eigen::Vector3d& p, MatrixN<5>& sum) {
        VectorN<5> z;
        z << p.squaredNorm(), p, 1.0;
        sum += z * z.transpose();
      });
  const auto found = pratt<3>(moments);
  if (!found) return std::nullopt;
  return SphereSurface{found->anchor, axes_with(found->normal, 2), found->k};
}

/// The same sphere with a curvature that is not negative.
SphereSurface convex(const SphereSurface& s) {
  if (s.k >= 0.0) return s;
  return {s.anchor, axes_with(-s.axes.col(2), 2), -s.k};
}

/// The sphere through four points.
std::optional<SphereSurface> sphere_through(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                            const Eigen::Vector3d& c, const Eigen::Vector3d& d) {
  // |x - centre|^2 equal for all four: (b - a) . u = |b - a|^2 / 2, ..., u = centre - a
  const Eigen::Vector3d p = b - a, q = c - a, r = d - a;
  const double determinant = p.dot(q.cross(r));
  if (!(std::abs(determinant) > 1e-12 * p.norm() * q.norm() * r.norm())) return std::nullopt;
  const Eigen::Vector3d u =
      0.5 / determinant * (p.squaredNorm() * q.cross(r) + q.squaredNorm() * r.cross(p) + r.squaredNorm() * p.cross(q));
  return SphereSurface{a, axes_with(u, 2), 1.0 / u.norm()};
}

struct SphereShape {
  using Surface = SphereSurface;
  static constexpr const char* kName = "sphere";

  static Result<Minimum<SphereSurface>> solve(Points points_mm, int max_iterations,
                                              const std::optional<SphereSurface>&) {
    const Normalised frame = normalise(points_mm);
    const double n = static_cast<double>(points_mm.size());
    const double plane_f = std::max(0.0, principal_axes(frame.points).values[0]);
    const double thickness_mm = frame.scale_mm * std::sqrt(plane_f / n);
    if (!(std::sqrt(plane_f / n) > 4.0 * frame.rounding)) {
      return unanswerable(
          fmt::format("the {} points lie in one plane (within {:.3g} mm rms), which determines no sphere; measure "
                      "points above and below it too",
                      points_mm.size(), thickness_mm));
    }
    const auto start = algebraic_sphere(frame.points);
    if (!start) return unanswerable(why_no_minimum(Descent::singular, kName, max_iterations));
    auto minimum = gauss_newton(convex(*start), frame.points, max_iterations);
    if (!minimum) return unanswerable(why_no_minimum(minimum.error(), kName, max_iterations));
    minimum->surface = convex(minimum->surface);
    // One parameter more than a plane must gain more than 4 standard deviations, 16 s^2; else the radius is open.
    const double s2 = n > 4 ? minimum->f / (n - 4.0) : 0.0;
    if (!(plane_f - minimum->f > 16.0 * s2)) {
      return unanswerable(fmt::format(
          "the {} points are as flat as a plane ({:.3g} mm rms from it, {:.3g} mm from the best sphere), so "
          "the radius is open; measure a larger part of the sphere",
          points_mm.size(), thickness_mm, frame.scale_mm * std::sqrt(minimum->f / n)));
    }
    return in_mm(*minimum, frame, {frame.scale_mm, 1.0, 1.0, 1.0 / frame.scale_mm});
  }

  /// Through four points, or where the normals of two points meet.
  static std::optional<SphereSurface> propose(const Sample& sample, Random& random) {
    const std::size_t n = sample.points.size();
    const std::size_t i = random.below(n), j = random.below(n);
    const Eigen::Vector3d &a = sample.points[i], &b = sample.points[j];
    if (random.below(2) == 0)
      return sphere_through(a, b, sample.points[random.below(n)], sample.points[random.below(n)]);
    const Eigen::Vector3d &m = sample.normals[i], &l = sample.normals[j];
    const double cosine = m.dot(l), sine2 = 1.0 - cosine * cosine;
    if (!(sine2 > 1e-3)) return std::nullopt;
    const Eigen::Vector3d u = b - a;
    const double s = (m.dot(u) - cosine * l.dot(u)) / sine2, t = (cosine * m.dot(u) - l.dot(u)) / sine2;
    const Eigen::Vector3d to_center = 0.5 * (a + s * m + b + t * l) - a;
    const double radius = to_center.norm();
    if (!(radius > 1e-9) || !(std::abs(radius - std::abs(t)) < 0.1 * radius)) return std::nullopt;
    return SphereSurface{a, axes_with(to_center, 2), 1.0 / radius};
  }

  /// A wall or floor is a sphere of large radius too: the points must leave a plane clearly more than they leave the
  /// sphere.
  static bool is_round(Points near, const SphereSurface& sphere) {
    if (near.size() < 5) return false;
    double f = 0.0;
    for (const Eigen::Vector3d& p : near) f += std::pow(sphere.distance(p), 2);
    return principal_axes(near).values[0] > 9.0 * f;
  }
};

}  // namespace

Result<SphereFit> fit_sphere(Points points_mm, const FitOptions& options) {
  const auto found = associate<SphereShape>(points_mm, options);
  if (!found) return tl::unexpected(found.error());
  const SphereSurface& sphere = found->minimum.surface;
  const double r = 1.0 / sphere.k;
  SphereFit out;
  out.center_mm = sphere.anchor + r * sphere.axes.col(2);
  out.diameter_mm = 2.0 * r;
  // centre = o + n / k: d(centre) = n d(shift) + r (e1 d(tilt1) + e2 d(tilt2)) - n r^2 dk
  Eigen::Matrix<double, 3, 4> gradient;
  gradient << sphere.axes.col(2), r * sphere.axes.col(0), r * sphere.axes.col(1), -r * r * sphere.axes.col(2);
  for (int c = 0; c < 3; ++c)
    out.u_center_mm[c] = standard_uncertainty<4>(gradient.row(c).transpose(), found->covariance);
  out.u_diameter_mm = standard_uncertainty<4>(2.0 * r * r * VectorN<4>::Unit(3), found->covariance);
  out.quality = found->quality;
  return out;
}

}  // namespace fringecal::fitting

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

  static std::string why_flat(const CentredPoints& points) {
    const double thickness = std::sqrt(points.axes.values[0] / points.framed.n);
    if (thickness > 4.0 * points.rounding) return {};
    return fmt::format(
        "the {} points lie in one plane (within {:.3g} mm rms), which determines no sphere; measure "
        "points above and below it too",
        points.framed.n, thickness * points.framed.scale_mm);
  }

  static Result<SphereSurface> start(const CentredPoints& points, std::size_t most, const FitOptions&) {
    Random random(5);
    const std::vector<Eigen::Vector3d> sample = sample_in_frame(points.framed, most, random);
    const auto found = algebraic_sphere(sample);
    if (!found) return unanswerable(why_no_minimum(Descent::singular, kName, 0));
    // The descent over the sample brings the start to where that over all points needs two or three steps.
    const auto minimum = gauss_newton(convex(*found), as_they_are(sample), {.max_iterations = 30, .enough = 1e-7});
    return minimum ? minimum->surface : *found;
  }

  static std::optional<SphereSurface> rough_start(Points points) {
    const auto found = algebraic_sphere(points);
    if (!found) return std::nullopt;
    const auto minimum =
        gauss_newton(fitting::convex(*found), as_they_are(points), {.max_iterations = 10, .enough = 1e-4});
    return fitting::convex(minimum ? minimum->surface : *found);
  }

  static std::string why_undetermined(const CentredPoints& points, const Minimum<SphereSurface>& minimum,
                                      const FitOptions& options) {
    const double n = points.framed.n, plane_f = points.axes.values[0], scale_mm = points.framed.scale_mm;
    // One parameter more than a plane must gain more than 4 standard deviations, 16 s^2; else the radius is open. With
    // the radius held it is the side of the centre that is open: the sphere on the other side must be as much worse.
    const double s2 = n > 4 ? minimum.f / (n - 4.0) : 0.0;
    if (options.fixed_diameter_mm) {
      SphereSurface other = minimum.surface;
      other.axes = axes_with(-other.axes.col(2), 2);
      const auto mirrored = gauss_newton(other, points.framed, {.hold_curvature = true});
      if (!mirrored || mirrored->surface.axes.col(2).dot(minimum.surface.axes.col(2)) > 0.0 ||
          mirrored->f - minimum.f > 16.0 * s2) {
        return {};
      }
      return fmt::format(
          "the {} points are so flat that a sphere of {} mm fits them from either side ({:.3g} and {:.3g} mm rms); "
          "measure a larger part of the sphere",
          n, *options.fixed_diameter_mm, scale_mm * std::sqrt(minimum.f / n), scale_mm * std::sqrt(mirrored->f / n));
    }
    if (plane_f - minimum.f > 16.0 * s2 && minimum.surface.k > 0.0) return {};
    return fmt::format(
        "the {} points are as flat as a plane ({:.3g} mm rms from it, {:.3g} mm from the best sphere), so "
        "the radius is open; measure a larger part of the sphere",
        n, scale_mm * std::sqrt(plane_f / n), scale_mm * std::sqrt(minimum.f / n));
  }

  static SphereSurface convex(const SphereSurface& s) { return fitting::convex(s); }
  static SphereSurface with_curvature(const SphereSurface& s, double k) { return {s.anchor, s.axes, k}; }
  static SphereSurface beside_origin(const SphereSurface& s) { return s; }
  static Minimum<SphereSurface> beside_centroid(const Minimum<SphereSurface>& m) { return m; }

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
    return centred(near, {}, near.size()).plane_f() > 9.0 * f;
  }
};

}  // namespace

Result<SphereFit> fit_sphere(Points points_mm, const FitOptions& options) {
  auto found = associate<SphereShape>(points_mm, options);
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
  out.amplification = r * r * std::sqrt(found->minimum.inverse_jtj(3, 3) * static_cast<double>(found->quality.n_used));
  out.quality = std::move(found->quality);
  return out;
}

}  // namespace fringecal::fitting

#include "fitting/associate.h"
#include "fitting/surface.h"

namespace fringecal::fitting {

std::string why_no_minimum(Descent descent, const char* shape, int max_iterations) {
  if (descent == Descent::singular) {
    return fmt::format("the points do not determine a {}: several fit them equally well; measure a larger part of it",
                       shape);
  }
  return fmt::format("the fit of a {} did not settle within {} iterations; the points are hardly one {}", shape,
                     max_iterations, shape);
}

namespace {

struct PlaneShape {
  using Surface = PlaneSurface;
  static constexpr const char* kName = "plane";

  static std::string why_flat(const CentredPoints& points) {
    const double n = points.framed.n, scale_mm = points.framed.scale_mm;
    const double width_mm = scale_mm * std::sqrt(points.axes.values[1] / n);
    const double thickness_mm = scale_mm * std::sqrt(points.axes.values[0] / n);
    // A line's scatter is as wide in one direction as in the other, up to 4 standard deviations of the ratio of two
    // equal variances, 1 +- 2 / sqrt(n) each. Exactly three points have no scatter.
    const double chance = n > 3.0 ? std::sqrt(1.0 + 8.0 / std::sqrt(n)) : 1.0;
    const double limit_mm = std::max(thickness_mm * chance, 4.0 * points.rounding * scale_mm);
    if (width_mm > limit_mm) return {};
    return fmt::format(
        "the {} points lie on one line (within {:.3g} mm rms), which determines no plane; measure "
        "points to its sides too",
        n, std::hypot(width_mm, thickness_mm));
  }
  static Result<PlaneSurface> start(const CentredPoints& points, std::size_t, const FitOptions&) {
    PlaneSurface out;
    out.axes.col(2) = points.axes.vectors.col(0);
    out.axes.col(0) = points.axes.vectors.col(2);
    out.axes.col(1) = out.axes.col(2).cross(out.axes.col(0));
    return out;
  }
  /// The anchor is the centroid and the axes are principal, so that J^T J is diagonal.
  static Minimum<PlaneSurface> minimum_of(const CentredPoints& points) {
    const Eigen::Vector3d squares(points.framed.n, points.axes.values[2], points.axes.values[1]);
    return {*start(points, 0, {}), squares.cwiseInverse().asDiagonal(), points.axes.values[0]};
  }
  static std::optional<PlaneSurface> rough_start(Points points) {
    const CentredPoints centre = centred(points, {}, points.size());
    return surface_in_mm(*start(centre, points.size(), {}), centre.framed);
  }
  static std::string why_undetermined(const CentredPoints&, const Minimum<PlaneSurface>&, const FitOptions&) {
    return {};
  }
  static PlaneSurface convex(const PlaneSurface& s) { return s; }
  static PlaneSurface with_curvature(const PlaneSurface& s, double) { return s; }
  /// The anchor at the foot of the origin, so that shift and tilts are hardly correlated.
  static PlaneSurface beside_origin(const PlaneSurface& s) {
    return {s.axes.col(2).dot(s.anchor) * s.axes.col(2), s.axes};
  }

  static Minimum<PlaneSurface> beside_centroid(const Minimum<PlaneSurface>& m) { return m; }

  static std::optional<PlaneSurface> propose(const Sample& sample, Random& random) {
    const std::size_t n = sample.points.size();
    const Eigen::Vector3d a = sample.points[random.below(n)], b = sample.points[random.below(n)],
                          c = sample.points[random.below(n)];
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    if (!(normal.norm() > 1e-9)) return std::nullopt;
    return PlaneSurface{a, axes_with(normal, 2)};
  }
  static bool is_round(Points, const PlaneSurface&) { return true; }
};

}  // namespace

Result<PlaneFit> fit_plane(Points points_mm, const FitOptions& options) {
  auto found = associate<PlaneShape>(points_mm, options);
  if (!found) return tl::unexpected(found.error());
  const PlaneSurface& plane = found->minimum.surface;
  PlaneFit out;
  // The anchor lies on the plane at the foot of the centroid, which lies on the plane itself.
  out.point_mm = plane.anchor;
  out.normal = largest_positive(plane.axes.col(2));
  out.u_offset_mm = standard_uncertainty<3>(VectorN<3>::Unit(0), found->covariance);
  out.u_tilt_rad = worse_uncertainty<3>(VectorN<3>::Unit(1), VectorN<3>::Unit(2), found->covariance);
  out.quality = std::move(found->quality);
  if (out.normal.dot(plane.axes.col(2)) < 0.0) {
    for (double& d : out.quality.distances_mm) d = -d;
    std::swap(out.quality.max_mm, out.quality.min_mm);
    for (auto* limit : {&out.quality.max_mm, &out.quality.min_mm}) {
      if (*limit) **limit = -**limit;
    }
  }
  return out;
}

}  // namespace fringecal::fitting

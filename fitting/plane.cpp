#include "fitting/associate.h"
#include "fitting/surface.h"

namespace fringecal::fitting {

SymmetricEigen<3> principal_axes(Points normalised) {
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const double n = static_cast<double>(normalised.size());
  const Eigen::Vector3d mean =
      blocked_sum(normalised, zero, [](const Eigen::Vector3d& p, Eigen::Vector3d& sum) { sum += p; }) / n;
  const auto scatter = [&](const Eigen::Vector3d& p, Eigen::Matrix3d& sum) {
    sum += (p - mean) * (p - mean).transpose();
  };
  SymmetricEigen<3> axes = symmetric_eigen<3>(blocked_sum(normalised, Eigen::Matrix3d::Zero().eval(), scatter));
  // An eigenvalue is good to eps of the largest one, so a thickness only to 1e-8 of the size; along the axes it is
  // exact.
  axes.values = blocked_sum(normalised, zero, [&](const Eigen::Vector3d& p, Eigen::Vector3d& sum) {
    sum += (axes.vectors.transpose() * (p - mean)).cwiseAbs2();
  });
  return axes;
}

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

  static Result<Minimum<PlaneSurface>> solve(Points points_mm, int max_iterations, const std::optional<PlaneSurface>&) {
    const Normalised frame = normalise(points_mm);
    const SymmetricEigen<3> axes = principal_axes(frame.points);
    const double n = static_cast<double>(points_mm.size());
    const double width_mm = frame.scale_mm * std::sqrt(std::max(0.0, axes.values[1]) / n);
    const double thickness_mm = frame.scale_mm * std::sqrt(std::max(0.0, axes.values[0]) / n);
    // A line's scatter is as wide in one direction as in the other, up to 4 standard deviations of the ratio of two
    // equal variances, 1 +- 2 / sqrt(n) each.
    const double limit_mm =
        std::max(thickness_mm * std::sqrt(1.0 + 8.0 / std::sqrt(n)), 4.0 * frame.rounding * frame.scale_mm);
    if (!(width_mm > limit_mm)) {
      return unanswerable(
          fmt::format("the {} points lie on one line (within {:.3g} mm rms), which determines no plane; measure "
                      "points to its sides too",
                      points_mm.size(), std::hypot(width_mm, thickness_mm)));
    }
    PlaneSurface start;
    start.axes.col(2) = axes.vectors.col(0);
    start.axes.col(0) = axes.vectors.col(2);
    start.axes.col(1) = start.axes.col(2).cross(start.axes.col(0));
    const auto minimum = gauss_newton(start, frame.points, max_iterations);
    if (!minimum) return unanswerable(why_no_minimum(minimum.error(), kName, max_iterations));
    return in_mm(*minimum, frame, {frame.scale_mm, 1.0, 1.0});
  }

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
  const auto found = associate<PlaneShape>(points_mm, options);
  if (!found) return tl::unexpected(found.error());
  const PlaneSurface& plane = found->minimum.surface;
  PlaneFit out;
  // The anchor lies on the plane at the foot of the centroid, which lies on the plane itself.
  out.point_mm = plane.anchor;
  out.normal = largest_positive(plane.axes.col(2));
  out.u_offset_mm = standard_uncertainty<3>(VectorN<3>::Unit(0), found->covariance);
  out.u_tilt_rad = worse_uncertainty<3>(VectorN<3>::Unit(1), VectorN<3>::Unit(2), found->covariance);
  out.quality = found->quality;
  if (out.normal.dot(plane.axes.col(2)) < 0.0) {
    for (double& d : out.quality.distances_mm) d = -d;
    out.quality.max_mm = -std::exchange(out.quality.min_mm, -out.quality.max_mm);
  }
  return out;
}

}  // namespace fringecal::fitting

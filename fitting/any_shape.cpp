#include "fitting/any_shape.h"

namespace fringecal::fitting {

Eigen::Vector3d AnyShape::outward(const Eigen::Vector3d& p_mm) const {
  const Eigen::Vector3d u = p_mm - place_mm;
  if (kind == ShapeKind::plane) return direction;
  return kind == ShapeKind::sphere ? u : Eigen::Vector3d(u - u.dot(direction) * direction);
}

double AnyShape::distance(const Eigen::Vector3d& p_mm) const {
  if (kind == ShapeKind::plane) return direction.dot(p_mm - place_mm);
  return outward(p_mm).norm() - 0.5 * diameter_mm;
}

Result<AnyShape> fit_any(ShapeKind kind, Points points_mm, const FitOptions& options) {
  if (kind == ShapeKind::plane) {
    auto fit = fit_plane(points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    return AnyShape{kind, fit->point_mm, fit->normal, 0.0, 0.0, std::move(fit->quality)};
  }
  if (kind == ShapeKind::sphere) {
    auto fit = fit_sphere(points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    return AnyShape{
        kind, fit->center_mm, Eigen::Vector3d::Zero(), fit->diameter_mm, fit->u_diameter_mm, std::move(fit->quality)};
  }
  auto fit = fit_cylinder(points_mm, options);
  if (!fit) return tl::unexpected(fit.error());
  return AnyShape{
      kind, fit->axis_point_mm, fit->axis_direction, fit->diameter_mm, fit->u_diameter_mm, std::move(fit->quality)};
}

}  // namespace fringecal::fitting

// A plane, sphere or cylinder where the kind is known at run time only: its fit, and distances and normals of points.
#pragma once

#include "fitting/fit.h"

namespace fringecal::fitting {

enum class ShapeKind { plane, sphere, cylinder };

struct AnyShape {
  ShapeKind kind = ShapeKind::plane;
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();   // centroid; centre; point of the axis
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // the normal; zero; of the axis
  double diameter_mm = 0, u_diameter_mm = 0;            // zero for a plane
  FitQuality quality;

  /// From the surface to the point, across it: p - c, or its part across the axis; the plane's normal.
  Eigen::Vector3d outward(const Eigen::Vector3d& p_mm) const;
  /// Signed: eqs. 1 to 3 of fit.h.
  double distance(const Eigen::Vector3d& p_mm) const;
};

Result<AnyShape> fit_any(ShapeKind kind, Points points_mm, const FitOptions& options);

}  // namespace fringecal::fitting

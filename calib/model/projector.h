// The projector: a camera acting in reverse, seen through the coordinate(s) that its fringes code.
//
// Frame `proj`: origin in the entrance pupil, z along the projection, x and y the pattern's axes; mm. A scene point
// (X, Y, Z) in proj, Z > 0, is lit by the place of the pattern with
//   u = f_x xd + u0_x   on a pattern coded along x,     v = f_y yd + u0_y   coded along y          (1)
// where (xd, yd) follow from (X/Z, Y/Z) by eqs. 1 to 3 of camera.h: distortion acts *from the scene to the pattern*, as
// in a camera. The paper's eqs. 19, 20 act the other way (from the pattern to the reference plane), so their kp1, kp2
// have the other sign to first order; see chen2008.h. u counts from the edge of the first stripe (core/pattern_plan.h),
// in the code's unit; on a display, u = 0.5 px is the centre of the first pixel.
//
// With one code axis only, (1) is a one-dimensional camera: f, u0, the attitude, and the position in the plane across
// the fringes are determined; the position *along* the fringes enters only through the lens distortion. [Chen2008, eqs.
// 19, 20] [Zhang2006]
#pragma once

#include "calib/model/camera.h"
#include "core/pattern_plan.h"

namespace fringecal::model {

struct ProjectorAxis {
  FringeCode code;
  double f = 0;   // focal length in the code's unit
  double u0 = 0;  // where the optical axis meets the pattern, in the code's unit
};

struct Projector {
  std::optional<ProjectorAxis> x, y;  // at least one
  Distortion distortion{};

  const std::optional<ProjectorAxis>& axis(CodeAxis a) const { return a == CodeAxis::x ? x : y; }
  /// The axis that measures: x where it is coded, else y.
  CodeAxis main_axis() const { return x ? CodeAxis::x : CodeAxis::y; }
  /// Eq. 1. Empty for a point that is not in front of the projector, or an axis that is not coded.
  std::optional<double> project(CodeAxis a, const Eigen::Vector3d& point_in_proj_mm) const;
};

Value to_value(const Projector& projector);
Projector projector_from(Fields fields);

}  // namespace fringecal::model

// Triangulation: the point of a camera ray that the projector lights with a given coordinate u.
//
// With d = (x, y, 1) the ray of the pixel in cam, Z = 1 / w the depth and (R, t) = proj_from_cam, the point is Z d, and
//   q(w) = R d + t w                       the same direction in proj, scaled by w                          (1)
//   g(w) = u_proj(q(w)) - u = 0            projector.h, eq. 1                                               (2)
// is solved for w by Newton's method from the solution without projector distortion, which is linear in w. In w the
// function is nearly a straight line (it is one where t_z = 0 and nothing is distorted), so 3 to 5 steps reach
// rounding. A coded projector of one axis needs the place of the ray along the fringes too, for the distortion: (1)
// supplies it. Lengths in mm, pixels with (0, 0) in the centre of the top-left one, u in the code's unit.
#pragma once

#include "calib/model/projector.h"
#include "core/rigid.h"

#include <Eigen/Core>

#include <optional>

namespace fringecal::model {

/// The point in cam. Empty where there is none: the pixel has no ray, the axis is not coded, ray and fringe plane are
/// parallel, they meet behind the camera or the projector, or the projector's distortion has turned over there.
std::optional<Eigen::Vector3d> triangulate(const Camera& camera, const Projector& projector,
                                           const Rigid3& proj_from_cam, CodeAxis axis, const Eigen::Vector2d& pixel,
                                           double u);

/// The same from a ray (x, y, 1) in cam, where many values of u belong to one pixel or the rays are kept.
std::optional<Eigen::Vector3d> triangulate_ray(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis,
                                               const Eigen::Vector3d& ray_in_cam, double u);

}  // namespace fringecal::model

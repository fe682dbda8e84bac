// Triangulation of many pixels at once: eqs. 1 and 2 of triangulate.h, vectorised (Highway, run-time dispatch), over a
// table of the camera's rays that is made once per camera.
//
// The table holds the x, y of every pixel's ray (x, y, 1) in double precision as Camera::ray gives them, one entry per
// pixel: there is nothing to interpolate, its error is zero. Newton takes kSteps = 4 steps for every pixel, the last of
// which moves w by no more than rounding; a pixel for which it does, or whose ray meets the plane of light nowhere in
// front of both, is left to triangulate_ray(). Beside the point its change with u along the ray:
//   du/dl = f (du_d/dw) w^2 / |d|,  u_d the distorted coordinate, l = |d| / w in mm along the ray             (1)
// The bytes do not depend on the width of the vectors, nor on how the range is cut. Points in cam, mm.
#pragma once

#include "calib/model/projector.h"
#include "core/image.h"
#include "core/rigid.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>

namespace fringecal::model {

/// The x and y of every pixel's ray; quiet NaN where it has none.
struct RayTable {
  Image<double> x, y;
};
RayTable ray_table(const Camera& camera);

struct SpanTask {
  const double *ray_x = nullptr, *ray_y = nullptr;
  const float* phase_rad = nullptr;  // absolute
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();
  Distortion distortion{};
  int across = 0;  // 0: coded along x, 1: along y
  // The distorted normalised coordinate is per_rad phi + at_zero; |f| in the code's unit.
  double per_rad = 0, at_zero = 0, f = 0;

  Eigen::Vector3d* points_mm = nullptr;  // zero where left to triangulate_ray()
  double* du_per_mm = nullptr;           // |eq. 1|
};

SpanTask span_task(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis);

/// The pixels first .. first + count - 1.
void triangulate_span(const SpanTask& task, std::size_t first, std::size_t count);

/// |Eq. 1| at one point in cam and along any direction; empty where triangulate_ray() would not stand either.
std::optional<double> du_per_mm(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis,
                                const Eigen::Vector3d& point_in_cam_mm, const Eigen::Vector3d& direction_in_cam);

}  // namespace fringecal::model

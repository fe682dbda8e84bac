// Tsai's two-stage calibration of a camera from tilted planes. [Tsai1987] [Chen2008, section 3]
//
// Frames: board (X, Y, 0), cam; (xd, yd) a pixel's place from the principal point, which is taken as the image's middle
// (or given), pixels square. With R = (r_ij), t the pose,
//   x = r11 X + r12 Y + tx,   y = r21 X + r22 Y + ty,   w = r31 X + r32 Y,   z = w + tz
// Stage 1, the radial alignment constraint: distortion, f and tz move a point along its radius only, so
//   xd y - yd x = 0                                                                                              (1)
// is linear and homogeneous in (r11, r12, tx, r21, r22, ty): six numbers up to a factor from at least five points. The
// upper left 2 x 2 block of a rotation is U diag(1, cos tilt) V^T, which gives the factor, and the rest of R:
//   (r13, r23) = +- sin(tilt) U.col(2),   third row = first x second                                             (2)
// Tsai divides by ty instead, which fails where the board's origin is on the image's x axis; the result is the same. The
// sign of (2) is the one with f > 0.
// Stage 2, f and tz of each pose: linear without distortion, then with k1, k2 by least squares of the pixels,
//   f x - xd tz = xd w,   f y - yd tz = yd w;      sum |pi(x, y, w + tz; f, k1, k2) - pixel|^2                      (3)
// k1, k2 act from the scene to the image (model/camera.h), Tsai's the other way; (1) holds for both.
// R, tx, ty stay as stage 1 gives them: the method is fast and linear, not the optimum of all pixels, and its covariance is
// of stage 2 alone. From one pose, or several.
// A board parallel to the image has w = 0: (3) then holds only f / tz. No result below 3 degrees of tilt in every pose, or
// where u(f) is over a tenth of f; with fewer than 8 corners in a pose. px, mm, rad.
#pragma once

#include "calib/camera_solve.h"

#include <span>

namespace fringecal::calib {

struct TsaiSolution {
  model::Camera camera;  // fx = fy, k1, k2
  std::vector<Rigid3> cam_from_board;
  std::vector<double> tilt_rad;  // of each pose against the image
  double rms_px = 0;             // per coordinate
  Eigen::Matrix3d covariance;    // of f, k1, k2, stage 2
  int iterations = 0;
};

Result<TsaiSolution> calibrate_tsai(std::span<const PlanarView> views, int width_px, int height_px,
                                    const std::optional<Eigen::Vector2d>& principal_point_px = {});

}  // namespace fringecal::calib

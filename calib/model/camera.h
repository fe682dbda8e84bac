// The camera: pinhole with radial and tangential distortion, what a CCD behind a lens *is*.
//
// Frame `cam`: origin in the entrance pupil, z along the view, x with the columns, y with the rows; mm.
// For a point (X, Y, Z) in cam, Z > 0, with x = X/Z, y = Y/Z, r^2 = x^2 + y^2:
//   s   = 1 + k1 r^2 + k2 r^4 + k3 r^6                                                    (1)
//   xd  = x s + 2 p1 x y + p2 (r^2 + 2 x^2)                                               (2)
//   yd  = y s + p1 (r^2 + 2 y^2) + 2 p2 x y                                               (3)
//   px  = fx xd + cx,  py = fy yd + cy                                                    (4)
// These are OpenCV's plumb_bob (and, with k3 = 0, mrcal's LENSMODEL_OPENCV4) to the letter; pixel (0, 0) is the centre
// of the top-left pixel. The paper's eq. 18 writes the inverse direction: it corrects a *measured* pixel by kc1 r^2 +
// kc2 r^4 with r in mm on the sensor; see chen2008.h for the conversion. [Brown1966] [OpenCV] [Chen2008, eq. 18]
#pragma once

#include "core/fields.h"
#include "core/result.h"
#include "core/value.h"

#include <Eigen/Core>

#include <array>
#include <optional>

namespace fringecal::model {

/// k1, k2, p1, p2, k3: OpenCV's order. Zero where a term is not part of the model.
using Distortion = std::array<double, 5>;

/// Eqs. 1 to 3 on normalised coordinates. T is double or an automatic-differentiation type.
template <class T>
inline void distort(const T* k, const T& x, const T& y, T& xd, T& yd) {
  const T r2 = x * x + y * y;
  const T s = T(1.0) + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));         // eq. 1
  xd = x * s + T(2.0) * k[2] * x * y + k[3] * (r2 + T(2.0) * x * x);  // eq. 2
  yd = y * s + k[2] * (r2 + T(2.0) * y * y) + T(2.0) * k[3] * x * y;  // eq. 3
}

/// Inverts eqs. 1 to 3 by Newton's method from the distorted point. Empty where the model has no inverse there (the
/// radial polynomial has turned over) or Newton does not reach 1e-14.
std::optional<Eigen::Vector2d> undistort(const Distortion& k, const Eigen::Vector2d& distorted);

struct Camera {
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  Distortion distortion{};
  std::optional<double> pixel_mm;  // s, the side of a pixel; needed only to print the paper's parameters in mm

  /// Eq. 4. Empty for a point that is not in front of the camera.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_cam_mm) const;
  /// The ray of a pixel as (x, y, 1) in cam.
  std::optional<Eigen::Vector3d> ray(const Eigen::Vector2d& pixel) const;
};

Value to_value(const Camera& camera);
Camera camera_from(Fields fields);

}  // namespace fringecal::model

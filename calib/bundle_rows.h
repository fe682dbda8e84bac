// Residuals of one sight and their derivatives, written out.
//
//   camera      r = pi_cam(R_j B + t_j) - pixel                     two rows                                   (1)
//   projector   r = u_proj(R_p (R_j B + t_j) + t_p) + o_j - u - G r_camera   one row per coded axis            (2)
// G = d(u)/d(pixel) along the board's face (Sight::u_by_pixel): the phase is read at the pixel where the corner was found,
// and there it is another than at the corner, by G times the pixel's error. Without this term the error of the pixel, and
// that of printing, would stand in both residuals and be taken for independent in each.
// B the corner on its board (bundle.h, eq. 1), the lenses those of calib/model, o_j the offset of the capture's phase.
// A rotation's parameter is w of exp(w) R at w = 0, the perturbation on the left that scanner.h speaks of: with q = R B,
//   d(exp(w) q)/dw = -[q]x,  dq/dB = R                                                                         (3)
// and for the lens (camera.h, eqs. 1 to 3) with x = X/Z, y = Y/Z, s' = ds/d(r^2):
//   dxd/dx = s + 2 s' x^2 + 2 p1 y + 6 p2 x,  dxd/dy = 2 s' x y + 2 p1 x + 2 p2 y = dyd/dx,
//   dyd/dy = s + 2 s' y^2 + 6 p1 y + 2 p2 x                                                                    (4)
// With D = (ex, ey) the corner's place on its face,
//   G = du/dD (dpixel/dD)^-1,                                                                                  (5)
// which a solve holds while it steps, so that (2) has the derivatives of its terms.
// A sight on a flat (bundle.h, eq. 2) has the rows of (2) alone. Its place is where the pixel's ray meets the flat, so that
// r_1 = 0 whatever the unknowns are: with P, C the derivatives of (2) and (1) by the place,
//   r_flat = r_2,   dr_flat = dr_2 - P C^-1 dr_1                                                               (6)
// Residuals and derivatives are not whitened. mm, rad, px, the code's unit. A point that is not in front of a lens has
// no rows.
#pragma once

#include "calib/bundle.h"

#include <array>

namespace fringecal::calib::rows {

// Columns of a row. The first kDense are shared by all sights, then those of the pose, then those of the target.
inline constexpr int kCamera = 0, kCameraK = 4, kAxis = 9, kProjectorK = 13, kProjectorW = 18, kProjectorT = 21,
                     kPitch = 24, kBow = 25, kFlatBow = 28, kDense = 31;
inline constexpr int kPoseW = 31, kPoseT = 34, kOffset = 37, kBend = 39, kPoseEnd = 42;
inline constexpr int kPrint = 42, kColumns = 45;

struct Row {
  double residual = 0;
  std::array<double, kColumns> by{};
};

/// What the sights of one pose share.
struct Frame {
  Eigen::Matrix3d rotation, projector_rotation;
  Eigen::Vector3d translation, projector_translation;
  Eigen::Vector3d bow;  // b + c_j
  Eigen::Vector2d offset;
};
Frame frame_of(const Bundle& bundle, std::size_t pose);

/// phi of bundle.h, eq. 1, per target; one more at the end, for sights on flats, which have their own.
std::vector<Eigen::Vector3d> bow_shapes(const Bundle& bundle);
/// Which of them is a sight's.
inline std::size_t shape_index(const Bundle& bundle, const Sight& sight) {
  return sight.target == kOnFlat ? bundle.targets_mm.size() : static_cast<std::size_t>(sight.target);
}

enum class With { residuals, derivatives };

/// Rows of a sight: [0], [1] the camera's, [2] the projector's along x, [3] along y; has[k] says which exist.
struct SightRows {
  std::array<Row, 4> row;
  std::array<bool, 4> has{};
};

/// False where the point is not in front of a lens, or the pixel's ray misses the flat.
bool evaluate(const Bundle& bundle, const Frame& frame, const Eigen::Vector3d& shape, const Sight& sight, With with,
              SightRows& out);

/// Eq. 5 at the bundle, for every sight; zero where the board is seen edge on.
void set_slopes(Bundle& bundle);

}  // namespace fringecal::calib::rows

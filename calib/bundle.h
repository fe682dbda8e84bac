// What the joint solve works on, as plain data: target places, sights of them, and everything that is estimated.
//
// The place of a corner on its board in pose j, frame `board`, mm:
//   X = (1 + s) (x + ex),  Y = (1 + s) (y + ey),  Z = ez + sum_m (b_m + c_jm) phi_m(xi, eta)                     (1)
//   phi = (xi^2, eta^2, xi eta)
// A flat plate of unknown pose says something too: at a pixel of it only the fringes are read, and the place on the plate is
// where the pixel's ray meets
//   Z = sum_m f_m phi_m(X / h, Y / h)                                                                           (2)
// f the flat's own bow, the same in every view of it, h half of the seen part's diagonal. Such a view is a pose without
// corners; where it stands in the plate's own plane and how it is turned there is nobody's business, and stays as it is.
// (x, y) nominal, s the relative error of the pitch, (ex, ey) the printing error of this corner and ez its height over
// the smooth board (a crease, a bubble under the paper), the same in every pose, b the bow of the board, c_j what it is
// bent further in this pose (a board held or leant differently), xi and eta the corner's place from the middle of the
// field in its half sides.
#pragma once

#include "calib/model/projector.h"
#include "core/rigid.h"
#include "core/uncertain.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace fringecal::calib {

/// Of a sight on a flat plate.
inline constexpr int kOnFlat = -1;

/// One target seen in one pose; target kOnFlat: a pixel of a flat, taken as exact.
struct Sight {
  int pose = 0, target = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double u_pixel_px = 1;
  std::optional<Uncertain> x, y;
  bool used = true;
  // d(u_x, u_y)/d(pixel) along the board: u is read where the corner was found, not where it is (bundle_rows.h, eq. 5).
  Eigen::Matrix2d u_by_pixel = Eigen::Matrix2d::Zero();
};

/// What is solved for, and what from. On entry of a solve the start, on return the solution. The vectors of the board's
/// and the poses' errors may be empty: zero.
struct Bundle {
  std::vector<Eigen::Vector2d> targets_mm;  // nominal, frame board
  std::vector<Sight> sights;

  model::Camera camera;
  std::optional<model::Projector> projector;
  Rigid3 proj_from_cam;
  std::vector<Rigid3> cam_from_board;                     // the flats' views last
  int flats = 0;                                          // how many of them are views of a flat
  double flat_half_mm = 1;                                // h of eq. 2
  Eigen::Vector3d flat_bow_mm = Eigen::Vector3d::Zero();  // f of eq. 2
  double pitch_error = 0;                                 // s of eq. 1
  Eigen::Vector3d bow_mm = Eigen::Vector3d::Zero();       // b
  std::vector<Eigen::Vector3d> print_mm;                  // (ex, ey, ez), per target
  std::vector<Eigen::Vector3d> bend_mm;                   // c_j, per pose
  std::vector<Eigen::Vector2d> phase_offset;              // per pose: what u (x, y) is off in the whole capture

  /// A corner with its bow and printing error, frame board (eq. 1 without c, and without the pitch's relative error, of
  /// which the views say nothing).
  Eigen::Vector3d corner_mm(std::size_t target) const;
  bool is_flat(std::size_t pose) const { return pose + static_cast<std::size_t>(flats) >= cam_from_board.size(); }
};

}  // namespace fringecal::calib

// The phase that a flat board shows in the reference capture, at any pixel: the paper's reference phase map, read where the
// board's print does not disturb it. [Chen2008, eq. 5]
//
// A pixel on an edge of the print sees the light of its brighter side: the camera's blur shifts its phase by up to the
// blur's width times the phase's slope, and on the dark squares only such pixels have modulation enough. So the pixels used
// are those whose surroundings (2 kReach + 1 square) are of one brightness, min A >= kEven max A; between them the phase of
// a smooth surface is smooth,
//   phi(p) = sum over i + j <= kDegree of c_ij T_i(x) T_j(y)                                                   (1)
// T Chebyshev's polynomials over the box of the pixels used. c is fitted to means over tiles of kTile pixels - of the phase
// and of the right side of (1), so that the mean is exact - weighted with 1 / u^2 of the pixels; tiles beyond 5 standard
// deviations are left out. Errors in the phase that repeat with the fringes average out over a tile and over tiles; what
// they leave is in the scatter of the tiles, which gives the covariance
//   C = s^2 (sum w t t^T)^-1                                                                                   (2)
// Truncation: perspective and lenses over a board of 0.25 of its distance, tilted by 25 degrees, leave less than 1e-4 rad of
// 300 rad at degree 7. px, rad. No result: too few tiles.
#pragma once

#include "calib/decode/decode.h"

#include <Eigen/Core>

namespace fringecal::calib {

class ReferencePhase {
 public:
  static Result<ReferencePhase> fit(const decode::PhaseMap& map);

  /// Whether a pixel is where tiles are: nowhere else is (1) to be trusted.
  bool covers(const Eigen::Vector2d& pixel) const;
  double at_rad(const Eigen::Vector2d& pixel) const { return row(pixel).dot(c_); }
  /// t L of a pixel, C = L L^T of eq. 2: phases at several pixels have the covariances of these rows' products.
  Eigen::VectorXd error_rad(const Eigen::Vector2d& pixel) const { return root_.transpose() * row(pixel); }

 private:
  Eigen::VectorXd row(const Eigen::Vector2d& pixel) const;

  Eigen::Vector2d middle_ = {0, 0}, half_ = {1, 1};
  Eigen::VectorXd c_;
  Eigen::MatrixXd root_;
  double widest_rad_ = 0;  // the standard uncertainty of (1) in the tile where it is largest
};

}  // namespace fringecal::calib

// A calibration board as it was really made: scale error, printing errors, bow.
//
// Frame `part`: the middle of the corner field, x with the columns, y with the rows, z = x cross y; mm. With g = (i, j)
// the place in corners, G0 its middle, q the true pitch and e the printing error, bilinear between the corners' own
// errors and constant outside their field, the ink that was meant for g stands at
//   (x, y) = q (g - G0) + e(g),   z = bow (x^2 + y^2) / R^2,   R the distance of the outermost corner from the middle
//   (1)
// Chessboard: square (floor(i), floor(j)) is black where the sum is even, from -1 to columns-1; circles: a dot at each
// place. Eq. 1 is inverted by two fixed-point steps; e changes by at most 1e-3 per mm, so 10 um of error leave 1e-8 mm.
#pragma once

#include "core/rigid.h"
#include "hw/virtual/point_spread.h"
#include "hw/virtual/preset.h"
#include "hw/virtual/scene.h"

#include <cstdint>
#include <vector>

namespace fringecal::virt {

class PrintedBoard {
 public:
  PrintedBoard(const PatternBoard& shape, const Preset& preset, std::uint64_t instrument_seed);

  /// Where corner (column, row) really is, eq. 1.
  Eigen::Vector3d corner_mm(int column, int row) const;
  /// Relative albedo at a place (x, y) of the board: 1 on the white, less on the print.
  double albedo(const Eigen::Vector2d& place_mm) const { return albedo_at(grid(place_mm)); }
  /// Mean albedo over a pixel's point spread around the place, whose columns and rows go along dx and dy, and the first
  /// two moments, in px, of the light that comes from there.
  struct Seen {
    double albedo;
    Eigen::Vector2d centroid;
    Eigen::Matrix2d covariance;
  };
  Seen seen(const Eigen::Vector2d& place_mm, const Eigen::Vector2d& dx, const Eigen::Vector2d& dy,
            const PointSpread& spread) const;
  /// Whether an edge of the print may lie within reach_mm of the place.
  bool near_edge(const Eigen::Vector2d& place_mm, double reach_mm) const;

  const Eigen::Vector2d& half_size_mm() const { return half_size_mm_; }
  double bow_per_mm2() const { return bow_per_mm2_; }

 private:
  Eigen::Vector2d grid(const Eigen::Vector2d& place_mm) const;
  Eigen::Vector2d error_mm(const Eigen::Vector2d& g) const;
  double albedo_at(const Eigen::Vector2d& g) const;

  model::Board board_;
  Eigen::Vector2d pitch_mm_, middle_, half_size_mm_;
  std::vector<Eigen::Vector2d> errors_mm_;  // per corner, row after row
  double bow_per_mm2_ = 0, black_ = 0, dot_radius_ = 0;
};

}  // namespace fringecal::virt

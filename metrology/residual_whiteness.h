// Whether what is left of a calibration's corners is noise: residuals grouped by pose, by place in the image and by place
// on the board.
//
// With e the camera's residuals of the corners in use (x and y), s^2 their mean square, and the mean e_g of the n_g of a
// group (pose; cell of a grid over the image; corner of the board), for G groups
//   q = 1/G sum_g n_g |e_g|^2 / (2 s^2)                                                                         (1)
// is 1 for noise, with a standard deviation of 1 / sqrt(G), and below 1 where the solve has fitted what the group has in
// common (poses always). Above 1 + 4 / sqrt(G) the residuals have something in common there that the model lacks, of the
// size sqrt((q - 1) 2 s^2 G / n). px. No result: fewer than 50 corners.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace fringecal::metrology {

/// What is left of a corner in use: measured minus projected, px.
struct CornerResidual {
  int pose = 0, column = 0, row = 0;  // of the observations; of the board
  Eigen::Vector2d pixel_px = Eigen::Vector2d::Zero(), residual_px = Eigen::Vector2d::Zero();
};
std::vector<CornerResidual> corner_residuals(const model::Scanner& scanner);

struct Whiteness {
  std::string over;  // "pose", "image", "board"
  int groups = 0;
  double q = 0, limit = 0;  // eq. 1
  double common_px = 0;     // what the groups have in common; 0 where q is below its limit
  bool white() const { return !(q > limit); }
};

Result<std::vector<Whiteness>> residual_whiteness(const model::Scanner& scanner);
std::string words_of(const Whiteness& whiteness);

}  // namespace fringecal::metrology

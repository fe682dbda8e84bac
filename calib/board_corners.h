// What board_detection.h is made of: the raw places of a board's corners in an image, in OpenCV's order or any of its
// mirror images; sorted and judged by board_detection.cpp.
#pragma once

#include "calib/model/board.h"
#include "core/image.h"
#include "core/result.h"

#include <Eigen/Core>

#include <vector>

namespace fringecal::calib {

/// Saddle points of a chessboard, row by row.
/// Found by OpenCV's detector on a copy of 8 bit, then refined on the picture itself by fitting to a window around each
///   I(p) = m + g . p + a tanh(n1 . (p - c) / s) tanh(n2 . (p - c) / s)                                        (1)
/// over m, g, a, c, the directions of n1 and n2, and the blur s: the product of two blurred edges that cross in c.
Result<std::vector<Eigen::Vector2d>> find_chessboard(const Image<float>& image, const model::Board& board);

/// Centres of the circles of a grid, row by row, dark on light or light on dark.
/// The centre of gravity of a circle's picture is not the picture of its centre: with H the homography from the board
/// and Q the circle's conic, the ellipse is H^-T Q H^-1, and its centre minus H(centre) is taken off. [Heikkila2000]
Result<std::vector<Eigen::Vector2d>> find_circle_grid(const Image<float>& image, const model::Board& board);

}  // namespace fringecal::calib

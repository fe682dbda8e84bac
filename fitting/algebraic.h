// Pratt's algebraic circle and sphere: the start of the orthogonal fits, without a guess. [Pratt1987]
//
//   A |x|^2 + B . x + C = 0,  |B|^2 - 4 A C = 1                                                                (1)
// minimising the sum of the squared left sides, which to first order are the orthogonal distances. With v = (A, B, C)
// and the moments M = sum z z^T, z = (|x|^2, x, 1):
//   M v = eta N v,  v^T N v = |B|^2 - 4 A C                                                                    (2)
// and the smallest eta that is not negative is the sum. A = 0 is a plane (line): flat caps need no special treatment.
// Coordinates centred, of any size.
#pragma once

#include "fitting/least_squares.h"

#include <Eigen/Core>

#include <optional>

namespace fringecal::fitting {

/// Dim = 2 or 3. The curve in the anchored form of surface.h: a point of it near the origin, the unit normal there
/// towards the centre, the curvature (its sign belongs to the normal's), and the sum of squares.
template <int Dim>
struct AlgebraicRound {
  Eigen::Matrix<double, Dim, 1> anchor, normal;
  double k = 0.0;
  double f = 0.0;
};

/// moments: eq. 2's M. nullopt where the points do not determine a curve.
template <int Dim>
std::optional<AlgebraicRound<Dim>> pratt(const MatrixN<Dim + 2>& moments);

}  // namespace fringecal::fitting

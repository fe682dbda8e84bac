// The fits certify themselves: points whose Gaussian solution is known exactly, over the whole range of conditions, and
// the largest deviations of what the fits answer.
//
// Null-space construction: on a chosen surface, points p_i with outward normals n_i and rows J_i of the Jacobian; random
// residuals e are made orthogonal to its columns,
//   e <- e - J (J^T J)^-1 J^T e,   q_i = p_i + e_i n_i                                                         (1)
// and the chosen surface is the stationary point of the q_i: the rows do not change along the normals (for the centre and
// axis parameters). It is the minimum as long as e is small against the radius. What is left is the rounding of the
// coordinates themselves, eps (offset + size), times the condition of the shape.
#pragma once

#include "fitting/fit.h"

#include <string>
#include <vector>

namespace fringecal::fitting {

/// Largest deviations of a class of conditions. Lengths relative to the radius (plane, line: the size) times 25 mm: as
/// they were for an artefact of this instrument's scale.
struct CheckedClass {
  std::string shape, condition;
  int cases = 0, refused = 0;  // refused: the fit gave no result; a failure here, for every case has one
  double position_mm = 0, direction_rad = 0, size_mm = 0;
  /// The largest of position and size at the scale of the case, in units of the rounding of its coordinates.
  double roundings = 0;
};

struct CheckOptions {
  int cases_per_class = 20;
  std::uint64_t seed = 1;
};

std::vector<CheckedClass> check_fits(const CheckOptions& options = {});

/// One reference pair: the deviation of our fit from the reference. Kind by the number of figures in the reference:
/// 6 a plane (point, normal), 4 a sphere (centre, diameter), 7 a cylinder (point, direction, diameter).
struct CheckedPair {
  std::string name, shape, failure;  // failure: why there is no result, else empty
  double position_mm = 0, direction_rad = 0, size_mm = 0;
};
CheckedPair check_pair(const std::string& name, Points points_mm, const std::vector<double>& reference);

}  // namespace fringecal::fitting

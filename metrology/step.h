// The height of a step: two planes, parallel in the artefact, fitted with one common normal.
//   min over n, c_k of  sum_k sum_i (n . (p_ki - c_k))^2:  c_k the centroids, n the eigenvector to the smallest eigenvalue of
//   S = sum_k sum_i (p_ki - c_k)(p_ki - c_k)^T                                                                    (1)
//   h = |n . (c_1 - c_0)|                                                                                        (2)
//   u^2(h) = s^2 (1/n_0 + 1/n_1) + sum over the two other eigenvectors e of  s^2 (e . (c_1 - c_0))^2 / lambda_e    (3)
// s the standard deviation of the distances, n_0 + n_1 - 4 degrees of freedom: noise independent from point to point; the second
// part is the common normal's, the longer the farther the planes stand apart sideways.
// Planes fitted each by itself that stand more than 1 degree to each other are no step: no result. mm.
#pragma once

#include "core/result.h"

#include <Eigen/Core>

#include <span>

namespace fringecal::metrology {

struct StepFit {
  double height_mm = 0, u_noise_mm = 0;
  double angle_rad = 0;  // between the two planes, each fitted by itself
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
};

Result<StepFit> fit_step(std::span<const Eigen::Vector3d> lower_mm, std::span<const Eigen::Vector3d> upper_mm);

}  // namespace fringecal::metrology

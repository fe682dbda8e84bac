// A star-shaped body with a gentle relief, as a plaster model has it. With D = diag(half axes), q = p mapped by 1 / D:
//   f(p) = |q| - 1 - g(q / |q|),  g(u) = sum_k a_k cos(k_k . u + phase_k);  the surface is f = 0            (1)
// Rays are followed by steps that cannot reach beyond the surface: |grad f| <= (1 + G / |q|) / h with G = sum a_k |k_k|
// and h the smallest half axis, so where |q| > 1/2 a step of f h / (1 + 2 G) is safe; the last part is a bisection
// to 1e-10 of the ray's parameter.                                                                              (2)
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <optional>

namespace fringecal::virt {

class FreeFormSurface {
 public:
  /// relief: sum of the waves' amplitudes, relative to the half axes; below 1/4.
  FreeFormSurface(const Eigen::Vector3d& half_mm, double relief, std::uint64_t seed);

  double value(const Eigen::Vector3d& point) const;  // eq. 1
  Eigen::Vector3d normal(const Eigen::Vector3d& point) const;
  /// f / |grad f|: the distance from the surface to first order, positive outside.
  double distance_mm(const Eigen::Vector3d& point) const;
  /// t of the first hit of o + t d with t > t_min.
  std::optional<double> hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double t_min) const;

 private:
  struct Wave {
    Eigen::Vector3d k;
    double amplitude, phase;
  };
  Eigen::Vector3d gradient(const Eigen::Vector3d& point) const;

  std::array<Wave, 4> waves_;
  Eigen::Vector3d half_, inverse_half_;
  double bound_, safe_step_;  // bound_: the body lies within |q| <= bound_
};

}  // namespace fringecal::virt

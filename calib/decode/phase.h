// N-step phase shifting of one row of pixels [Chen2008, eq. 3 for N = 4; Creath1988 for any N].
//
//   S = sum I_k sin(2 pi k / N),  C = sum I_k cos(2 pi k / N),  phi' = atan2(S, C) in (-pi, pi]     (1)
//   B = (2 / N) sqrt(S^2 + C^2),  A = (1 / N) sum I_k                                               (2)
// for I_k = A + B cos(phi - 2 pi k / N), N >= 3, k = 0 .. N-1. Grey levels in, grey levels and radians out.
#pragma once

#include <cmath>
#include <numbers>
#include <span>
#include <vector>

namespace fringecal::decode {

/// std::remainder(angle, 2 pi) to the last bit: within 3 pi the one subtraction is exact, and several times as fast.
inline double wrapped_angle(double angle) {
  constexpr double kPi = std::numbers::pi;
  if (!(std::abs(angle) < 3 * kPi)) return std::remainder(angle, 2 * kPi);
  return angle > kPi ? angle - 2 * kPi : angle < -kPi ? angle + 2 * kPi : angle;
}

struct PhaseRow {
  std::vector<float> wrapped, modulation, mean;
  std::vector<float> brightest, darkest;  // of the N frames
  explicit PhaseRow(std::size_t width)
      : wrapped(width), modulation(width), mean(width), brightest(width), darkest(width) {}
};

class PhaseSteps {
 public:
  explicit PhaseSteps(int steps);
  /// frames: N rows of equal length, in the order of the steps.
  void evaluate(std::span<const std::vector<float>> frames, PhaseRow& out) const;

 private:
  std::vector<float> sine_, cosine_;
};

}  // namespace fringecal::decode

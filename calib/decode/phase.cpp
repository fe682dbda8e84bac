#include "calib/decode/phase.h"

#include "core/error.h"

#include <cmath>
#include <numbers>

namespace fringecal::decode {
namespace {

/// Sines of multiples of 2 pi / N that are 0, 1/2 or 1 in mathematics are exactly that here: with N = 4 and integer
/// grey levels S and C are then exact.
float cleaned(double s) {
  const double doubled = std::round(2 * s);
  return static_cast<float>(std::abs(2 * s - doubled) < 1e-12 ? doubled / 2 : s);
}

}  // namespace

PhaseSteps::PhaseSteps(int steps) {
  require(steps >= 3, "N-step phase shifting has at least three steps");
  for (int k = 0; k < steps; ++k) {
    const double angle = 2.0 * std::numbers::pi * k / steps;
    sine_.push_back(cleaned(std::sin(angle)));
    cosine_.push_back(cleaned(std::cos(angle)));
  }
}

void PhaseSteps::evaluate(std::span<const std::vector<float>> frames, PhaseRow& out) const {
  require(frames.size() == sine_.size(), "one row per phase step");
  const std::size_t width = out.wrapped.size();
  const float per_frame = 1.0f / static_cast<float>(frames.size());
  constexpr float kPi = std::numbers::pi_v<float>;
  for (std::size_t x = 0; x < width; ++x) {
    float s = 0, c = 0, sum = 0, low = frames[0][x], high = low;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const float value = frames[k][x];
      s += value * sine_[k];
      c += value * cosine_[k];
      sum += value;
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
    const float phi = std::atan2(s, c);  // (1)
    out.wrapped[x] = phi <= -kPi ? kPi : phi;
    out.modulation[x] = 2 * per_frame * std::sqrt(s * s + c * c);  // (2)
    out.mean[x] = per_frame * sum;                                 // (2)
    out.brightest[x] = high;
    out.darkest[x] = low;
  }
}

}  // namespace fringecal::decode

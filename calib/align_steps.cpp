#include "calib/align_steps.h"

#include "calib/decode/modulation_ripple.h"
#include "core/parallel.h"

#include <fmt/format.h>

#include <cmath>
#include <complex>
#include <numbers>

namespace fringecal::calib {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kModelShare = 0.02;

/// The plain map with its wrapped phase unwrapped along each line; a step of more than a quarter period ends a run.
decode::ModulationMap even_surface(const decode::PhaseMap& map) {
  decode::ModulationMap out{.axis = map.axis,
                            .phase_steps = map.code.phase_steps,
                            .log_ratio = Image<float>(map.width(), map.height()),
                            .phase_rad = Image<float>(map.width(), map.height()),
                            .wrapped_rad = map.wrapped_rad,
                            .usable = Image<std::uint8_t>(map.width(), map.height())};
  const bool rows = map.axis == CodeAxis::x;
  parallel_for(out.lines(), [&](int line) {
    double phase = 0, before = 0;
    bool running = false;
    for (int i = 0; i < (rows ? map.width() : map.height()); ++i) {
      const int x = rows ? i : line, y = rows ? line : i;
      const double wrapped = map.wrapped_rad(x, y);
      const bool usable = map.valid(x, y);
      const double step = std::remainder(wrapped - before, kTwoPi);
      // A gap in the usable pixels ends the run by itself.
      phase = running ? phase + step : wrapped;
      running = usable;
      before = wrapped;
      if (!usable) continue;
      out.usable(x, y) = std::abs(step) < 0.5 * std::numbers::pi || phase == wrapped;
      out.phase_rad(x, y) = static_cast<float>(phase);
      out.log_ratio(x, y) = std::log(map.modulation(x, y));
    }
  });
  return out;
}

/// Im q of eq. 1.
double conjugate_part(double sine, double pitch_per_period, const std::vector<double>& slots) {
  std::complex<double> first, second;
  for (std::size_t k = 0; k < slots.size(); ++k) {
    const double e = -kTwoPi * (slots[k] - slots[0]) * pitch_per_period * sine;
    first += std::polar(1.0, -e);
    second += (k % 2 == 0 ? 1.0 : -1.0) * std::polar(1.0, e);
  }
  return (second / std::conj(first)).imag();
}

}  // namespace

std::vector<double> step_weights(double pattern_pitch_mm, const std::vector<double>& phase_slots) {
  double M = 0;
  for (std::size_t k = 0; k < phase_slots.size(); ++k) {
    M -= (k % 2 == 0 ? 1.0 : -1.0) * phase_slots[k] * pattern_pitch_mm / 4.0;
  }
  std::vector<double> out;
  if (!(std::abs(M) > 1e-6 * pattern_pitch_mm)) return out;
  for (std::size_t k = 0; k < phase_slots.size(); ++k) out.push_back((k % 2 == 0 ? 1.0 : -1.0) / (4.0 * M));  // (2)
  return out;
}

Result<StepsReading> angle_from_steps(const decode::PhaseMap& plain, double pattern_pitch_mm,
                                      const std::vector<double>& phase_slots) {
  if (phase_slots.size() != 4) {
    return unanswerable(
        fmt::format("the steps' own ripple is read from four phase steps; this plan has {}", phase_slots.size()));
  }
  const std::vector<double> weights = step_weights(pattern_pitch_mm, phase_slots);
  if (weights.empty()) {
    return unanswerable("the phase patterns stand on the slide so that an angle makes no ripple of the steps");
  }
  const auto ripple = decode::fit_modulation_ripple(even_surface(plain));
  if (!ripple) return tl::unexpected(ripple.error());
  const double measured = ripple->ellipse.conjugate.imag(), per_period = pattern_pitch_mm / plain.code.period;
  // Newton from the linear solution, d(Im q) = (2 pi / p) M d(sin theta).
  const double slope = kTwoPi / (4.0 * weights.front() * plain.code.period);
  double sine = measured / slope;
  for (int i = 0; i < 20; ++i) {
    const double h = 1e-7, here = conjugate_part(sine, per_period, phase_slots);
    const double derivative = (conjugate_part(sine + h, per_period, phase_slots) - here) / h;
    if (!(std::abs(derivative) > 0.1 * std::abs(slope))) return unanswerable("the steps' ripple fits no angle");
    sine -= (here - measured) / derivative;
  }
  if (!(std::abs(sine) < 0.1)) return unanswerable("the steps' ripple fits no angle");
  StepsReading out;
  out.theta_rad = {std::asin(sine),
                   std::hypot(ripple->ellipse.u_conjugate / std::abs(slope), kModelShare * std::asin(sine))};
  return out;
}

}  // namespace fringecal::calib

#include "calib/align_loop.h"

#include "core/error.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

struct Adjuster {
  Uncertain gain, backlash_rad;
  double last_turn_rad = 0;
};

/// Eq. 2 over the moves made.
Adjuster learn(std::span<const AlignmentReading> history, const AlignmentLoopOptions& options) {
  double sense = 1.0, last = 0;
  for (std::size_t i = 1; i < history.size(); ++i) {
    const double moved = history[i].theta_rad.value - history[i - 1].theta_rad.value, t = history[i].turn_before_rad;
    const double u = std::hypot(history[i].theta_rad.u, history[i - 1].theta_rad.u);
    // Five standard uncertainties and more than the backlash could do: the scale counts the other way.
    if (moved * t < 0 && std::abs(moved) > 5 * u + 3 * options.backlash_rad) sense = -1.0;
  }
  Eigen::Matrix2d M = Eigen::Matrix2d::Zero();
  Eigen::Vector2d r = Eigen::Vector2d::Zero();
  M(0, 0) = 1.0 / (options.u_gain * options.u_gain);
  r[0] = sense * M(0, 0);
  M(1, 1) = 1.0 / (options.backlash_rad * options.backlash_rad);
  r[1] = options.backlash_rad * M(1, 1);
  for (std::size_t i = 1; i < history.size(); ++i) {
    const double t = history[i].turn_before_rad;
    if (t == 0) continue;
    const bool reverses = last * t < 0;
    double u2 = std::pow(history[i].theta_rad.u, 2) + std::pow(history[i - 1].theta_rad.u, 2);
    if (last == 0) u2 += std::pow(options.backlash_rad, 2);  // on which side the thread lay before is not known
    const Eigen::Vector2d f(t, reverses ? -sense * std::copysign(1.0, t) : 0.0);
    M += f * f.transpose() / u2;
    r += f * (history[i].theta_rad.value - history[i - 1].theta_rad.value) / u2;
    last = t;
  }
  const Eigen::Matrix2d covariance = M.inverse();
  const Eigen::Vector2d x = covariance * r;
  return {.gain = {x[0], std::sqrt(covariance(0, 0))},
          .backlash_rad = {std::max(0.0, x[1]), std::sqrt(covariance(1, 1))},
          .last_turn_rad = last};
}

}  // namespace

std::string turn_words(double turn_rad, const AlignmentLoopOptions& options) {
  const char* direction = turn_rad > 0 ? "clockwise" : "anticlockwise";
  if (!options.rad_per_division) return fmt::format("turn the adjuster {:+.3f} mrad ({})", 1e3 * turn_rad, direction);
  return fmt::format("turn the adjuster {:+.3f} mrad = {:.1f} divisions {}", 1e3 * turn_rad,
                     std::abs(turn_rad / *options.rad_per_division), direction);
}

const char* name_of(AlignmentDecision decision) {
  switch (decision) {
    case AlignmentDecision::aligned:
      return "aligned";
    case AlignmentDecision::turn:
      return "turn";
    case AlignmentDecision::not_improving:
      return "not improving";
    case AlignmentDecision::needs_more_frames:
      return "needs more frames";
  }
  return "";
}

AlignmentStep next_step(std::span<const AlignmentReading> history, const Misalignment& latest, double period_mm,
                        const AlignmentLoopOptions& options) {
  require(!history.empty() && !latest.bits.empty(), "a next step needs a reading and its bits");
  const auto longest = std::max_element(latest.bits.begin(), latest.bits.end(), [](const auto& a, const auto& b) {
    return std::abs(a.lever_mm) < std::abs(b.lever_mm);
  });
  const double L = std::abs(longest->lever_mm);
  const Uncertain theta = history.back().theta_rad;
  const double k = options.coverage_factor;

  AlignmentStep step;
  step.bit = longest->bit;
  step.delta_mm = {longest->lever_mm * theta.value, L * theta.u};
  step.tolerance_mm = options.tolerance_of_period * period_mm;
  const Adjuster adjuster = learn(history, options);
  step.gain = adjuster.gain;
  step.backlash_rad = adjuster.backlash_rad;
  const std::string state =
      fmt::format("delta of bit {} is {:+.2f} +- {:.2f} um (k = {:g}) against a tolerance of {:.2f} um", step.bit,
                  1e3 * step.delta_mm.value, 1e3 * k * step.delta_mm.u, k, 1e3 * step.tolerance_mm);

  if (std::abs(step.delta_mm.value) + k * step.delta_mm.u <= step.tolerance_mm) {  // eq. 1
    step.decision = AlignmentDecision::aligned;
    step.sentence = "aligned: " + state;
    return step;
  }
  if (std::abs(theta.value) <= k * theta.u) {
    step.decision = AlignmentDecision::needs_more_frames;
    step.sentence =
        fmt::format("needs more frames: {}; the angle cannot be told from zero, take more captures and average", state);
    return step;
  }
  const auto turns = static_cast<std::size_t>(
      std::count_if(history.begin(), history.end(), [](const auto& r) { return r.turn_before_rad != 0; }));
  if (turns >= 3 && history.size() >= 4) {
    const double now = std::abs(theta.value), then = std::abs(history[history.size() - 4].theta_rad.value);
    if (now > 0.5 * then) {
      step.decision = AlignmentDecision::not_improving;
      step.sentence = fmt::format(
          "not improving: {:.3f} mrad after three turns that began at {:.3f} mrad; is the adjuster "
          "clamped, or does the board or the projector move?",
          1e3 * now, 1e3 * then);
      return step;
    }
  }

  const double g = adjuster.gain.value;
  double margin = 2.0 * adjuster.gain.u;
  if (margin * std::abs(theta.value) * L < 0.5 * step.tolerance_mm) margin = 0;
  double turn = -theta.value * (1.0 - margin) / g;  // eq. 3
  if (turn * adjuster.last_turn_rad < 0) turn += std::copysign(adjuster.backlash_rad.value / std::abs(g), turn);
  step.decision = AlignmentDecision::turn;
  step.turn_rad = turn;
  step.sentence = fmt::format("{}: {}", turn_words(turn, options), state);
  return step;
}

Result<SettingReading> read_setting(const std::function<Result<Misalignment>(int i)>& take,
                                    std::span<const AlignmentReading> history, const SettingOptions& options) {
  std::vector<Misalignment> stacks;
  std::vector<AlignmentReading> readings(history.begin(), history.end());
  readings.emplace_back();
  for (int i = 0;; ++i) {
    auto one = take(i);
    if (!one) return tl::unexpected(one.error());
    stacks.push_back(std::move(*one));
    SettingReading out{
        .measured = stacks.size() == 1 ? stacks.front() : average_of(stacks, options.layout, options.code), .step = {}};
    readings.back() = {out.measured.theta_rad, options.turn_before_rad};
    out.step = next_step(readings, out.measured, options.code.period, options.loop);
    if (out.step.decision != AlignmentDecision::needs_more_frames) return out;
    if (i + 1 < options.loop.max_captures) continue;
    const double stays = std::sqrt(std::max(0.0, out.measured.theta_rad.u * out.measured.theta_rad.u -
                                                     out.measured.u_noise_rad * out.measured.u_noise_rad));
    out.step.sentence += fmt::format(
        " ({} were averaged; {:.4f} mrad of u = {:.4f} mrad would stay with any number: a tolerance below that cannot "
        "be proved on this grating)",
        stacks.size(), 1e3 * stays, 1e3 * out.measured.theta_rad.u);
    return out;
  }
}

}  // namespace fringecal::calib

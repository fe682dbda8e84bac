// Frames of a fringe projector by the formulas of core/pattern_plan.h, written independently of the decoder.
//
// The pattern coordinate grows along the camera's columns (axis x) or rows (axis y): u / p = start + c / px_per_period.
//   phase step k   A + B cos(2 pi u / p - pi - 2 pi k / N)
//   Gray bit b     A + a s,  s = -1 or +1: bright where cos(2 pi u / (w 2^(n - b + 1))) < 0, w the stripe, because bit
//   b of a
//                  binary-reflected code has the period of 2^(n - b + 1) stripes and is 1 in its middle half
// Gray edges are box-blurred over `blur` periods and can be displaced, bit by bit. Noise: normal, variance read + gain
// I.
#pragma once

#include "core/capture.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

namespace fringecal::test {

struct FringeScene {
  FringeCode code;
  CodeAxis axis = CodeAxis::x;
  int along = 400, across = 300;  // pixels along u and along the fringes
  double start = 0.013, px_per_period = 20.37;
  double mean = 100, modulation = 60, gray_amplitude = 60;
  double blur = 0.05;
  double gray_shift = 0;                   // periods by which every Gray edge stands at larger u
  std::vector<double> step_error_rad;      // of each phase step
  double read_sd = 0, gain = 0;            // noise
  double fixed_pattern = 0;                // relative, rms
  std::function<double(int, int)> albedo;  // factor at (along, across); 1 where not given
  bool inverses = false, white_and_black = false;
  int bits = 8;
  unsigned seed = 1;
};

inline double true_u_over_p(const FringeScene& s, double c) { return s.start + c / s.px_per_period; }

inline double gray_signal(const FringeScene& s, int bit, double u_over_p) {
  const double period_in_p = std::ldexp(1.0, s.code.gray_bits - bit + 1) / s.code.stripes_per_period;
  // Rising edges at 1/4, falling edges at 3/4 of the bit's period; a box of width `blur` makes each a straight ramp.
  const double turns = (u_over_p - s.gray_shift) / period_in_p;
  const double place = turns - std::floor(turns);
  const double inside = period_in_p * (0.25 - std::abs(place - 0.5));  // signed distance to the nearest edge, periods p
  return std::clamp(2 * inside / s.blur, -1.0, 1.0);
}

inline Capture render(const FringeScene& s) {
  Capture capture;
  CaptureInfo& info = capture.info;
  const bool along_x = s.axis == CodeAxis::x;
  info.width_px = along_x ? s.along : s.across;
  info.height_px = along_x ? s.across : s.along;
  info.bits = s.bits;
  (along_x ? info.plan.x : info.plan.y) = s.code;
  auto& patterns = info.plan.patterns;
  for (int b = 0; b < s.code.gray_bits; ++b) {
    patterns.push_back({PatternKind::gray, s.axis, b});
    if (s.inverses) patterns.push_back({PatternKind::gray, s.axis, b, true});
  }
  for (int k = 0; k < s.code.phase_steps; ++k) patterns.push_back({PatternKind::phase, s.axis, k});
  if (s.white_and_black) {
    patterns.push_back({.kind = PatternKind::white});
    patterns.push_back({.kind = PatternKind::black});
  }
  std::mt19937_64 random(s.seed);
  std::normal_distribution<double> normal;
  Image<double> light(s.along, s.across, 1.0);
  for (int a = 0; a < s.across; ++a) {
    for (int c = 0; c < s.along; ++c) {
      light(c, a) = (s.albedo ? s.albedo(c, a) : 1.0) * (1 + s.fixed_pattern * normal(random));
    }
  }
  const double top = std::ldexp(1.0, s.bits) - 1;
  for (const Pattern& p : patterns) {
    info.frames.push_back({.file = "", .pattern = p, .sha256 = "", .time = ""});
    Image16 frame(info.width_px, info.height_px);
    for (int c = 0; c < s.along; ++c) {
      const double u = true_u_over_p(s, c);
      double ideal = s.mean;
      if (p.kind == PatternKind::phase) {
        const double error = s.step_error_rad.empty() ? 0 : s.step_error_rad[static_cast<std::size_t>(p.index)];
        const double step = 2 * std::numbers::pi * p.index / s.code.phase_steps + error;
        ideal += s.modulation * std::cos(2 * std::numbers::pi * u - std::numbers::pi - step);
      } else if (p.kind == PatternKind::gray) {
        ideal += (p.inverted ? -1 : 1) * s.gray_amplitude * gray_signal(s, p.index, u);
      } else {
        ideal += (p.kind == PatternKind::white ? 1 : -1) * s.gray_amplitude;
      }
      for (int a = 0; a < s.across; ++a) {
        const double level = ideal * light(c, a);
        const double noise = std::sqrt(s.read_sd * s.read_sd + s.gain * std::max(0.0, level)) * normal(random);
        const double value = std::clamp(std::round(level + noise), 0.0, top);
        (along_x ? frame(c, a) : frame(a, c)) = static_cast<std::uint16_t>(value);
      }
    }
    if (s.bits > 8) {
      capture.frames.emplace_back(std::move(frame));
    } else {
      Image8 narrow(frame.width(), frame.height());
      std::copy(frame.values().begin(), frame.values().end(), narrow.values().begin());
      capture.frames.emplace_back(std::move(narrow));
    }
  }
  return capture;
}

}  // namespace fringecal::test

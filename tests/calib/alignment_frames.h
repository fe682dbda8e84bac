// Frames of a misaligned grating from the formulas of paper.md alone, for the tests of the alignment: nothing of the
// program's own renderer or decoder is in here.
//
// Slot j of the slide arrives s_j = -j d sin(theta) + e_j off sideways, so the camera sees pattern_j(u - s_j): a Gray
// bit's edge stands at u = m p + s_j. Binary patterns are blurred by a Gaussian of `blur` periods.
#pragma once

#include "core/capture.h"

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace fringecal::test {

struct GratingCase {
  double theta_rad = 0;
  int gray_bits = 7, phase_steps = 4, stripes_per_period = 2;
  CodeAxis axis = CodeAxis::x;
  double direction = 1;  // -1: u falls with the pixel
  double period_mm = 0.24, pitch_mm = 12;
  double pixels_per_period = 24;
  double blur = 0.145;                                 // of a period: leaves 1.2 % of third harmonic
  double noise = 1.0;                                  // grey levels rms
  double light = 190, ambient = 12;                    // grey levels
  double bump_periods = 0;                             // height of a cylinder-like bump in u: a board that is not flat
  double covered = 1.0;                                // share of the line that the board covers
  int length = 720, lines = 64;                        // pixels along and across the code
  std::vector<double> placement_mm = {};               // e_j by slot, empty: none
  int askew_slot = -1;                                 // this pattern is turned on the glass: e grows by askew_mm
  double askew_mm = 0;                                 // from the first line to the last
  std::vector<int> gray_slots = {}, phase_slots = {};  // empty: GC0 .. PS(N-1)
  unsigned seed = 1;
};

inline double blurred_step(double x, double width) { return 0.5 * std::erfc(-x / (width * std::numbers::sqrt2)); }

/// Gray bit b at u, in periods of the phase patterns, 0 .. 1: dark before its first edge, edges at odd multiples.
inline double gray_pattern(const GratingCase& c, int bit, double u_periods) {
  const double spacing = std::ldexp(1.0, c.gray_bits - 1 - bit) / c.stripes_per_period;  // from 0 to the first edge
  const double edges = (u_periods / spacing - 1.0) / 2.0;  // edge number i stands at (2 i + 1) spacing
  const long nearest = std::lround(edges), last = (1L << bit) - 1;
  const long i = std::min(std::max(nearest, 0L), last);
  const double rise = blurred_step(u_periods - static_cast<double>(2 * i + 1) * spacing, c.blur);
  return i % 2 == 0 ? rise : 1.0 - rise;
}

/// A square wave that is bright around phi = 2 pi k / N, blurred: its odd harmonics with the Gaussian's attenuation.
inline double phase_pattern(const GratingCase& c, int step, double u_periods) {
  const double phi = 2 * std::numbers::pi * (u_periods - 0.5 - static_cast<double>(step) / c.phase_steps);
  double value = 0.5, sign = 1;
  for (int h = 1; h <= 9; h += 2, sign = -sign) {
    value += sign * 2.0 / (std::numbers::pi * h) * std::exp(-2.0 * std::pow(std::numbers::pi * c.blur * h, 2)) *
             std::cos(h * phi);
  }
  return value;
}

inline double u_periods_of(const GratingCase& c, double along, double across) {
  const double total = std::ldexp(1.0, c.gray_bits) / c.stripes_per_period;
  const double t = (along - 0.5 * c.length) / c.length, v = (across - 0.5 * c.lines) / c.lines;
  const double span = c.length / c.pixels_per_period;
  // Off-centre by a fraction so that edges fall on no particular pixel; 8 % change of scale along the line, as from a
  // tilt.
  double u = 0.5 * total + 0.137 + c.direction * span * (t + 0.08 * t * t + 0.01 * v);
  if (c.bump_periods != 0 && std::abs(t) < 0.2) u += c.bump_periods * std::sqrt(1.0 - 25.0 * t * t);
  return u;
}

inline Capture misaligned_capture(const GratingCase& c) {
  Capture capture;
  FringeCode code{c.gray_bits, c.phase_steps, c.stripes_per_period, c.period_mm, "mm"};
  (c.axis == CodeAxis::x ? capture.info.plan.x : capture.info.plan.y) = code;
  for (int b = 0; b < c.gray_bits; ++b) capture.info.plan.patterns.push_back({PatternKind::gray, c.axis, b});
  for (int k = 0; k < c.phase_steps; ++k) capture.info.plan.patterns.push_back({PatternKind::phase, c.axis, k});
  const int width = c.axis == CodeAxis::x ? c.length : c.lines, height = c.axis == CodeAxis::x ? c.lines : c.length;
  capture.info.width_px = width;
  capture.info.height_px = height;
  std::mt19937_64 random(c.seed);
  std::normal_distribution<double> normal;
  for (std::size_t j = 0; j < capture.info.plan.patterns.size(); ++j) {
    const Pattern& p = capture.info.plan.patterns[j];
    const auto& slots = p.kind == PatternKind::gray ? c.gray_slots : c.phase_slots;
    const int slot = slots.empty() ? static_cast<int>(j) : slots[static_cast<std::size_t>(p.index)];
    double shift_mm = -slot * c.pitch_mm * std::sin(c.theta_rad);
    if (!c.placement_mm.empty()) shift_mm += c.placement_mm[j];
    Image8 image(width, height);
    for (int across = 0; across < c.lines; ++across) {
      const double turned_mm = slot == c.askew_slot ? c.askew_mm * ((across + 0.5) / c.lines - 0.5) : 0.0;
      for (int along = 0; along < c.length; ++along) {
        const double u = u_periods_of(c, along, across) - (shift_mm + turned_mm) / c.period_mm;
        const double pattern = p.kind == PatternKind::gray ? gray_pattern(c, p.index, u) : phase_pattern(c, p.index, u);
        const double board = along < c.covered * c.length ? 1.0 : 0.0;
        const double value = c.ambient + board * c.light * pattern + c.noise * normal(random);
        const auto grey = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
        image(c.axis == CodeAxis::x ? along : across, c.axis == CodeAxis::x ? across : along) = grey;
      }
    }
    capture.frames.emplace_back(std::move(image));
    capture.info.frames.push_back({.file = "", .pattern = p, .sha256 = "", .time = ""});
  }
  return capture;
}

}  // namespace fringecal::test

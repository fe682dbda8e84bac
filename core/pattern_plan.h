// What was projected: the code of a fringe projector, and the list of patterns in the order of the frames.
//
// u is the coordinate on the projector's pattern across the fringes, counted from the edge of the first stripe, in the
// plan's unit (mm on a glass grating, px on a display). With p the period of the phase patterns,
//     phi = 2 pi u / p - pi            (absolute phase; wraps where u = m p, on a stripe edge)          [paper.md]
//     I_k = A + B cos(phi - 2 pi k / N)                                                     [Chen2008, eq. 3]
//     phi = 2 pi m + phi'                                                                   [Chen2008, eq. 4]
// A Gray code of n bits numbers 2^n stripes of width p / stripes_per_period; bit 0 is the coarsest; the code is binary
// reflected. stripes_per_period is 2 where the phase patterns are the (n+1)-th Gray bit shifted (the paper's grating),
// 1 where each stripe has its own period. A plan without phase patterns gives phase to the middle of a stripe only.
#pragma once

#include "core/fields.h"
#include "core/value.h"

#include <numbers>
#include <optional>
#include <string>
#include <vector>

namespace fringecal {

/// The projector coordinate along which a pattern varies.
enum class CodeAxis { x, y };

enum class PatternKind { gray, phase, white, black };

struct Pattern {
  PatternKind kind = PatternKind::white;
  CodeAxis axis = CodeAxis::x;  // gray and phase only
  int index = 0;                // Gray bit (0 = coarsest) or phase step
  bool inverted = false;        // Gray only

  friend bool operator==(const Pattern&, const Pattern&) = default;
};

/// "gray 3", "gray 3 inverted", "phase 2", "white", "black" - the words of plan files and messages ("y gray 3" on axis
/// y).
std::string describe(const Pattern& pattern);

/// The code along one axis.
struct FringeCode {
  int gray_bits = 0;           // n
  int phase_steps = 0;         // N, 0 where there are no phase patterns
  int stripes_per_period = 2;  // 1 or 2
  double period = 1.0;         // p, in `unit`
  std::string unit = "mm";     // "mm" on the grating, or "px" on a display

  double stripe_width() const { return period / stripes_per_period; }
  int stripes() const { return 1 << gray_bits; }

  /// phi = 2 pi u / p - pi, and its inverse.
  double phase_from_u(double u) const { return 2.0 * std::numbers::pi * u / period - std::numbers::pi; }
  double u_from_phase(double phase_rad) const {
    return period * (phase_rad + std::numbers::pi) / (2.0 * std::numbers::pi);
  }
};

struct PatternPlan {
  std::vector<Pattern> patterns;   // in frame order
  std::optional<FringeCode> x, y;  // the code along each axis that is coded

  const std::optional<FringeCode>& code(CodeAxis axis) const { return axis == CodeAxis::x ? x : y; }
  /// Frame of a pattern, if the plan has it.
  std::optional<std::size_t> find(const Pattern& pattern) const;
};

/// Empty, or the first thing that is wrong with the plan as one sentence (a missing bit, a step out of range, ...).
std::string defect_of(const PatternPlan& plan);

/// JSON and TOML share this form: {codes = {x = {gray_bits, phase_steps, ...}}, patterns = [...]}.
Value to_value(const FringeCode& code);
FringeCode fringe_code_from(Fields fields);
Value to_value(const Pattern& pattern);
Pattern pattern_from(Fields fields);

}  // namespace fringecal

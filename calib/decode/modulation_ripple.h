// The ellipse of calib/model/phase_linearisation.h, eq. 1, from the ripple it makes in the modulation: eq. 3 of
// stack_errors.h, solved over all lines of a map, corrected, and solved again.
#pragma once

#include "calib/decode/stack_errors.h"

#include <algorithm>

namespace fringecal::decode {

/// What takes part; images of one size.
struct ModulationMap {
  CodeAxis axis = CodeAxis::x;
  int phase_steps = 4;
  Image<float> log_ratio;    // ln(|Z| / D)
  Image<float> phase_rad;    // continuous along the lines
  Image<float> wrapped_rad;  // arg Z
  Image<std::uint8_t> usable;

  int lines() const { return axis == CodeAxis::x ? usable.height() : usable.width(); }
};

/// Pixels that are enough: u = 0.01 sqrt(2 / 3e5) = 0.03 mrad. Of more, every line_stride-th line is used.
inline constexpr std::size_t kEnoughPixels = 300'000;
inline int line_stride(std::size_t pixels) {
  return static_cast<int>(std::max<std::size_t>(1, pixels / kEnoughPixels));
}

Result<StackErrors> fit_modulation_ripple(const ModulationMap& map);

}  // namespace fringecal::decode

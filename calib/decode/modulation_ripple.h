// The ellipse of calib/model/phase_linearisation.h, eq. 1, from the ripple it makes in the modulation: eq. 3 of
// stack_errors.h, solved over all lines of a map, corrected, and solved again.
#pragma once

#include "calib/decode/stack_errors.h"

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

Result<StackErrors> fit_modulation_ripple(const ModulationMap& map);

}  // namespace fringecal::decode

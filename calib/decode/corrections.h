// A phase map for measuring: decoded with the code's redundancy, then freed of the periodic phase errors.
//
//   1. z0 and q of this stack (stack_errors.h); where the stack cannot tell them, or on request, the mean of the flat
//      stacks in the table (its `fixed`); without either, none.
//   2. Eq. 3 of calib/model/phase_linearisation.h with the table's a, b at the pixel.
// Never for measuring the grating's delta: alignment and jump count decode for themselves, plain. u(phi') stays what
// the noise gives: what the corrections leave (u of the amplitudes, some 0.1 mrad) is common to all pixels of a period
// and stated apart.
#pragma once

#include "calib/decode/stack_errors.h"

#include <string>

namespace fringecal::decode {

enum class Correct { yes, no };

struct CorrectionOptions {
  Correct linearisation = Correct::yes;  // from the table, where there is one
  Correct stack = Correct::yes;
};

struct MeasuringMap {
  PhaseMap map;
  std::optional<StackErrors> stack;  // as estimated and corrected
  bool linearised = false;           // eq. 3 applied
  std::vector<std::string> remarks;  // what could not be corrected, and why
};

/// table: of the Scanner; nullptr where it has none. Throws InputError where it belongs to another code or camera.
MeasuringMap decode_for_measuring(const Capture& capture, CodeAxis axis, const model::PhaseLinearisation* table,
                                  const CorrectionOptions& options = {});

/// What was done, in one sentence for people: "stack corrected (...), linearised".
std::string words_for(const MeasuringMap& map);

/// The steps themselves, on a map with phase patterns.
void undo_ellipse(PhaseMap& map, const model::StepEllipse& ellipse);
void linearise(PhaseMap& map, const model::PhaseLinearisation& table);

}  // namespace fringecal::decode

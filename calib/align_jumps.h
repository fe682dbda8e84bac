// The paper's own figure: whole pixels of jump in the plain absolute phase map, [Chen2008, eq. 21].
//
// Where a Gray edge and its phase wrap do not coincide, the pixels between them carry a wrong fringe number m: phi
// jumps by 2 pi and back. w_jump counts these pixels, w_period the pixels of one period; w_jump / w_period = |delta|
// / p to the nearest pixel. The continuous phase they are judged against is phi' unwrapped along the line.
// Which bit makes a jump follows from the boundary u = m p it belongs to: the number of times 2 divides m. Our sign:
// more late pixels (m too small) than early ones means delta > 0.
// A map with the redundancy correction has no jumps, whatever delta is: it is refused. The offset of
// the continuous phase is the majority's: where more than half of all pixels are wrong (every bit beyond half a
// period) the count means nothing, and the angle of align.h must be used instead.
#pragma once

#include "calib/decode/decode.h"
#include "core/result.h"

#include <vector>

namespace fringecal::calib {

struct JumpCount {
  int bit = 0;
  double jump_px = 0;    // median over the boundaries of that bit, signed as delta
  double period_px = 0;  // median over the same boundaries
  int n_boundaries = 0;
};

/// By bit, coarsest first; bits without a boundary in the picture are left out. No result: a map decoded with the
/// redundancy of the code, or one without phase patterns or Gray code.
Result<std::vector<JumpCount>> count_jumps(const decode::PhaseMap& map);

}  // namespace fringecal::calib

// delta over the field: what the edges say cell by cell, for people to see whether one angle explains all of it.
//
// Each Gray edge at (x, line) of bit b gives delta_b there (align_edges.h); divided by the bit's lever and multiplied by
// that of the finest bit that jumps, L_f, all bits say the same,
//   delta_f(cell) = median over the edges of the cell of  delta_b L_f / L_b                          (1)
// with half the difference of rising and falling edges of the bit taken off each (what shifts their threshold). An
// angle gives an even map; an askew pattern a slope along the fringes; the difference between columns is that of the
// patterns' places. um on the grating; NaN where a cell holds fewer than kMinEdgesInCell edges. For pictures only.
#pragma once

#include "calib/align.h"
#include "core/image.h"

namespace fringecal::calib {

inline constexpr int kMinEdgesInCell = 5;

/// measured: of this capture.
Image<float> delta_map_um(const Capture& capture, const Misalignment& measured, CodeAxis axis, int cell_px = 40);

}  // namespace fringecal::calib

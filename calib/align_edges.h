// Where the Gray bits cross their threshold and where the phase wraps, line by line, to a fraction of a pixel.
//
// A line runs along the coded axis: a row of the image for axis x, a column for axis y. With I_k the phase frames,
// psi_k = 2 pi k / N, S = sum I_k sin psi_k, C = sum I_k cos psi_k (decode.h, eq. 1):
//   wrap   phi' = pi  <=>  S = 0 with C < 0; located on the fitted S = a sin w(x - x0) + b cos w(x - x0)          (1)
//          S is odd about its zero whatever the angle and the odd harmonics are (N = 4), while phi' itself is curved
//          there by the ripple of wrong steps: a straight line through phi' would be off by 3 % of delta.
//   edge   G_b(x) = T(x), T(x) the mean of A over one local period centred on x                                   (2)
//          A = (1/N) sum I_k itself ripples with one cycle per period when the steps are wrong, which shifts rising
//          and falling edges apart; its mean over a whole period does not.
//   place  q(x): the fractional number of wraps passed, rising with u, by least squares over the wraps near x and the
//          zeros of S with C > 0 halfway between them: count = c0 + c1 x + c2 x^2 +- c3, q = c0 + c1 x + c2 x^2    (3)
//          The lamp flickers from frame to frame: unequal I_1 and I_3 leave an offset (g_1 - g_3) A in S, which moves
//          the two kinds of zeros apart (c3) and their mean nowhere. With 0.2 % that is 0.09 um of a 240 um period.
// The zeros of a kind are all at the same phase, so ripples of any number of cycles per period leave q untouched.
// Frames: pixel coordinates along the line, q in periods with an origin of its own for each segment.
// Only raw frames are read: nothing here has seen a redundancy correction.
#pragma once

#include "core/capture.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::calib {

/// One threshold crossing of one Gray bit.
struct GrayEdge {
  int bit = 0;
  bool rising = false;   // the bit goes from dark to bright with growing u
  double x_px = 0;       // place along the line, eq. 2
  double q_periods = 0;  // eq. 3
  double period_px = 0;  // local length of a period
};

/// A run of the line without gap in the fringes.
struct EdgeSegment {
  int line = 0;
  int direction = 1;               // +1: u grows with x; -1: u falls
  std::vector<double> wraps_px;    // eq. 1, in order of x
  std::vector<double> middles_px;  // the zero of S with C > 0 after each wrap but the last
  double nonflatness_periods =
      0;  // rms of the wraps about a cubic in x: a plane gives below 0.003, a curved part far more
  std::vector<GrayEdge> edges;
};

struct EdgeMap {
  std::vector<EdgeSegment> segments;  // by line, then by x
  double median_modulation = 0;       // B, grey levels, over all pixels
  double covered = 0;                 // share of the pixels with enough modulation
  double saturated = 0;               // share of the pixels that are saturated in a phase frame
  int lines = 0;
};

struct EdgeOptions {
  double min_modulation_8bit = 8.0;  // B below which a pixel is no fringe: edges need twice the 4 levels of decoding
  int min_wraps = 6;                 // a segment shorter than this is left out: eq. 3 has three unknowns
};

/// The capture must have Gray bits and phase patterns along the axis (std::logic_error).
EdgeMap find_edges(const Capture& capture, CodeAxis axis, const EdgeOptions& options = {});

/// Why this is no flat board that fills the field, well lit: the rest of a sentence that begins with the capture.
std::optional<std::string> defect_of(const EdgeMap& map, const Capture& capture);

}  // namespace fringecal::calib

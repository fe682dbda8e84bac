// Grating alignment: how far the fringe direction is off the slide direction, from one capture of a flat board.
//
// A pattern that sits k pitches d along the slide arrives k d sin(theta) off sideways. With bits b = 0 .. n-1 and the
// phase patterns after them, bit b jumps against the phase by
//   delta_b = (n + 2 - b) d sin(theta)   on the grating                                       (1)  [paper.md]
//   delta   = (w_jump / w_period) p                                                           (2)  [Chen2008, eq. 21]
// Gray edges and phase wraps are located to a fraction of a pixel along each row on *plain* quantities
// (align_edges.h); rising and falling edges are kept apart and averaged (what moves the threshold moves them
// oppositely). theta > 0 puts a Gray edge at larger u than its phase edge.
//
// The wrap of N steps sits at the mean slot sum w_k s_k of the phase patterns, w_k = (2/N) sin^2(2 pi k / N)      (3)
// (four steps: the mean of PS1 and PS3, exact at any angle). With L_b the distance along the slide from bit b to it,
//   delta_b = L_b sin(theta) + e_b - sum w_k e_k,   e the place of each pattern across the fringes              (4)
// is solved for theta by generalised least squares, with the prior
//   cov(e) = (u_lith^2 + u_slide^2 / n) I + (a^2 / 3.8) exp(-(s_i - s_j)^2 / 2 l^2),  l = T / pi
// n the stacks averaged; independent placement errors, and the slide's path, smooth over its travel T: near s_i = s_j it
// is the covariance of a half wave over T of any phase, cos(pi (s_i - s_j) / T), and 3.8 is the mean square of such
// paths' peak to peak over T in units of their variance (Monte Carlo), so that a is what a data sheet calls
// straightness. All bits share the phase patterns' errors, so no angle is known better than these allow. The scatter of
// the edges themselves (noise) comes from blocks of rows and is far smaller. Where the bits contradict eq. 4
// beyond chance (chi2), u is widened by sqrt(chi2/dof) and a remark says so.
// Fine bits decide first: a coarse bit may be off by more than half a period, so each bit's edges are matched to the
// wraps that the finer bits' angle predicts; the start is the difference of the two finest bits (one pitch only).
// u of a single bit's delta contains the placement errors, so that delta_b / L_b is a fair witness of theta.
// A pattern that lies askew on the glass, or a slide that yaws, makes delta_b grow along the fringes:
//   delta_b(line) = delta_b + tilt_b (line - middle) / lines                                      (5)
// delta_b is that of the middle line; a tilt beyond chance is reported.
// The four phase steps tell the angle a second time (align_steps.h). Both see PS1 and PS3, so their difference has the
// variance a^T cov(e) a, a the sum of the two weights of e; where it exceeds three of its standard uncertainties, that
// is a remark and not an average.
#pragma once

#include "calib/decode/decode.h"
#include "core/result.h"
#include "core/uncertain.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fringecal::calib {

/// The grating as the alignment needs it.
struct GratingLayout {
  double pattern_pitch_mm = 0;  // d along the slide
  /// Slot of each Gray bit and of each phase step along the slide, in pitches. Empty: GC0 .. GC(n-1), PS0 .. PS(N-1).
  std::vector<int> gray_slots = {}, phase_slots = {};
  /// Standard uncertainty of one pattern's place across the fringes: of the lithography, the same in every stack, and
  /// of the slide's positioning, new in every stack.
  double u_lithography_mm = 0.0002, u_slide_mm = 0.0003;
  /// Straightness of the slide across the fringes, peak to peak over the travel; 0 for none.
  double straightness_mm = 0.0005;
};

struct BitMisalignment {
  int bit = 0;
  Uncertain delta_mm;             // eq. 2 on the grating, signed
  double fraction_of_period = 0;  // delta / p
  double rising_mm = 0,
         falling_mm = 0;  // medians over edges of each kind; NaN-free: equal to delta where a kind is absent
  double u_noise_mm = 0;  // of delta, without the placement errors: how well this stack shows it
  double lever_mm = 0;    // L_b of eq. 4
  Uncertain tilt_mm;      // eq. 5: growth of delta from the first line to the last
  int n_edges = 0;        // edge crossings used, all rows
  double jump_px = 0, period_px = 0;  // the paper's figures: whole jump pixels and pixels of one period, medians
};

struct Misalignment {
  Uncertain theta_rad;            // from all bits, eq. 1
  Uncertain delta_mm;             // L_b sin(theta) of the finest bit that makes a jump: its own placement error is out
  double fraction_of_period = 0;  // of that bit
  std::vector<BitMisalignment> bits;  // finest first
  double chi2_per_dof = 0;            // of eq. 1 over the bits
  double u_noise_rad = 0;             // the part of u(theta) that more frames would lessen: noise and the slide
  int stacks = 1;                     // averaged
  /// The angle from the steps alone, its u with the patterns' places; absent: it cannot be told (a remark says why).
  std::optional<Uncertain> theta_from_steps_rad = {};
  double u_steps_noise_rad = 0;      // of it, without the patterns' places
  double u_difference_rad = 0;       // standard uncertainty of the difference between the two angles
  std::vector<std::string> remarks;  // what the bits leave open, what was left out and why
};

/// Throws InputError where the capture cannot serve by its plan (no phase patterns, no Gray bits). No result: too few
/// edges, too little modulation, not a flat board - with the reason.
Result<Misalignment> measure_misalignment(const Capture& capture, const GratingLayout& layout,
                                          CodeAxis axis = CodeAxis::x);

/// Several stacks at one setting of the adjuster as one: deltas and the steps' angle averaged, eq. 4 solved again.
Misalignment average_of(std::span<const Misalignment> stacks, const GratingLayout& layout, const FringeCode& code);

/// The profile of the paper's Fig. 5 along one row: Gray steps and absolute phase of the plain map.
struct AlignmentProfile {
  int row = 0;
  std::vector<double> column, gray_number, phase_rad, wrapped_rad;  // valid pixels only
};
AlignmentProfile alignment_profile(const Capture& capture, CodeAxis axis, int row);

}  // namespace fringecal::calib

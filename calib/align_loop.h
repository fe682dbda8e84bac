// The alignment loop's next step: is the grating aligned, and if not, how far to turn the adjuster.
//
// Aligned is what can be proved (an equivalence test): with L the longest lever of the bits that jump (the coarsest
// bit, which jumps most; with its tolerance kept every other bit's is),
//   |theta| L + k u(theta) L <= tolerance p                                                        (1)
// A turn t moves theta by
//   theta_i - theta_(i-1) = g t_i - beta r_i sign(t_i)                                              (2)
// g the adjuster's gain (1: its scale is right), beta its backlash, r_i = 1 where the turn goes against the one
// before, else 0. g and beta are learned from the moves made, by weighted least squares with the priors of the
// options. The next turn is
//   t = -theta (1 - m) / g, plus beta sign(t) / g where it reverses;  m = 2 u(g)                    (3)
// so that while the gain is still uncertain the angle is approached from one side and no turn has to reverse. m is
// dropped where what it leaves lies within half the tolerance.
// Positive: as the adjuster's scale counts, clockwise seen from its head. An adjuster that counts the other way is
// recognised by its first move and its gain taken as negative. Angles in rad.
#pragma once

#include "calib/align.h"

#include <functional>
#include <optional>
#include <span>
#include <string>

namespace fringecal::calib {

struct AlignmentReading {
  Uncertain theta_rad;
  double turn_before_rad = 0;  // asked of the adjuster just before this reading; 0 for the first
};

struct AlignmentLoopOptions {
  double tolerance_of_period = 0.01;       // 2.4 um on the default grating
  double coverage_factor = 2.0;            // k of eq. 1
  double u_gain = 0.05;                    // prior of g about 1: adjusters are good to some per cent
  double backlash_rad = 3e-5;              // prior of beta and its standard uncertainty
  std::optional<double> rad_per_division;  // of the adjuster's scale, for the operator's words
  int max_captures = 8;                    // at one setting: the slide's share of u falls to a third
};

enum class AlignmentDecision { aligned, turn, not_improving, needs_more_frames };

/// "aligned", "turn", "not improving", "needs more frames".
const char* name_of(AlignmentDecision decision);

struct AlignmentStep {
  AlignmentDecision decision = AlignmentDecision::turn;
  double turn_rad = 0;   // eq. 3; 0 unless decision is turn
  std::string sentence;  // for the operator: what to do, or why not
  int bit = 0;           // whose tolerance decides: the coarsest measured
  Uncertain delta_mm;    // L theta of that bit
  double tolerance_mm = 0;
  Uncertain gain, backlash_rad;  // eq. 2 as learned so far
};

/// The next step after the readings so far (at least one), the last being `latest`. period_mm: p.
AlignmentStep next_step(std::span<const AlignmentReading> history, const Misalignment& latest, double period_mm,
                        const AlignmentLoopOptions& options = {});

/// A setting of the adjuster, read with as many captures as it takes: while the step says needs_more_frames, another
/// capture is taken and all of the setting are averaged, up to options.max_captures. Where that does not decide, the
/// decision stays needs_more_frames and the sentence says how much of u further captures could still take away.
struct SettingReading {
  Misalignment measured;
  AlignmentStep step;
};

/// What to do with the adjuster: "turn the adjuster -0.713 mrad (anticlockwise)", in divisions where they are known.
std::string turn_words(double turn_rad, const AlignmentLoopOptions& options);

struct SettingOptions {
  double turn_before_rad = 0;
  GratingLayout layout;
  FringeCode code;
  AlignmentLoopOptions loop = {};
};
/// take(i): the i-th capture at this setting, measured. history: the readings of the settings before this one.
Result<SettingReading> read_setting(const std::function<Result<Misalignment>(int i)>& take,
                                    std::span<const AlignmentReading> history, const SettingOptions& options);

}  // namespace fringecal::calib

// The angle from the phase steps alone: the witness of align.h, independent of the Gray edges.
//
// The angle theta shifts step k, in slot s_k of the slide, by -s_k d sin(theta) across the fringes, e_k in phase. Four
// frames with steps off by e_k are the ellipse Z = w + q conj(w) (calib/model/phase_linearisation.h, eq. 1) with
//   q = sum (-1)^k exp(i e_k) / conj(sum exp(-i e_k)),   e_k = -2 pi s_k d sin(theta) / p                    (1)
// which for steps in a row is q = i tan(pi d sin(theta) / p): two ripples per period, in the modulation and in the
// phase. q is read from the modulation of the flat board (an even surface: its own reflectance is smooth or without
// relation to the fringes), from the wrapped phase unwrapped along the line, so that no Gray bit takes part. theta
// solves eq. 1 for Im q. Of the patterns' places e it sees
//   sin(theta) = sin(theta)_true + sum v_k e_k,  v_k = (-1)^k / (4 M),  M = -(d / 4) sum (-1)^k s_k  (M = d / 2)   (2)
// so it is some eight times less certain than the edges, and shares PS1 and PS3 with them; align.h compares the two
// with the covariance of both. The real part of q is the lamp's. u here: without places, from the pixels' scatter, and
// 2 % of theta for the third harmonic, which mixes with large steps.
// No result: N other than 4, steps whose slots cancel in M, too few pixels.
#pragma once

#include "calib/align.h"

namespace fringecal::calib {

struct StepsReading {
  Uncertain theta_rad;
};

/// v_k of eq. 2, 1/mm; empty where the slots cancel in M.
std::vector<double> step_weights(double pattern_pitch_mm, const std::vector<double>& phase_slots);

/// plain: the map of the capture without corrections. phase_slots: in pitches, one per step.
Result<StepsReading> angle_from_steps(const decode::PhaseMap& plain, double pattern_pitch_mm,
                                      const std::vector<double>& phase_slots);

}  // namespace fringecal::calib

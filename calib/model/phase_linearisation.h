// PhaseLinearisation: what N phase steps get wrong with the period of the fringes, measured on a flat board.
//
// With Z = sum I_k exp(i 2 pi k / N) = C + i S (calib/decode/decode.h, eq. 1), M = |Z| and w the Z of perfect steps,
//   Z = w + z0 |w| + q conj(w)                                                                     (1)
// z0: frames of unequal brightness, one cycle per period; q: wrong steps, two cycles. Both are the same over the whole
// field. Eq. 1 is an ellipse with an offset (Heydemann's correction of two sine signals [Heydemann1981]); its inverse
//   w = (Z' - q conj(Z')) / (1 - |q|^2),  Z' = Z - z0 M                                            (2)
// leaves |z0| (|z0| + |q|), 1e-4 rad at 0.01. With four steps and a third harmonic H of the pattern, wrong steps also
// make a term of exp(3 i arg w); with the one that eq. 2 makes of H it is -4 H i Im(q) w^3 / M^2, and is added back:
// without it 8 H |q| stay, a tenth of the two cycles at H = 0.0135. Harmonics of order N - 1 and N + 1 (the third and fifth of four steps:
// what the lens leaves of binary patterns) give N cycles per period:
//   phi' = arg w - (a cos N arg w + b sin N arg w)                                                 (3)
// a, b vary slowly over the field (the lens blurs more at the edge): values at the nodes of a grid over the picture,
// bilinear between them. Second order left out: 1.5 b^2 at 2 N cycles, 0.6 mrad at b = 20 mrad.
// Phase in rad as a function of the *measured* phase; pixels as everywhere.
#pragma once

#include "core/pattern_plan.h"
#include "core/value.h"

#include <cmath>
#include <complex>
#include <string>
#include <utility>
#include <vector>

namespace fringecal::model {

/// a b of finite numbers: the operator's care for infinities costs more than the rest of eq. 2.
inline std::complex<double> product(std::complex<double> a, std::complex<double> b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

/// Eq. 1.
struct StepEllipse {
  std::complex<double> offset{}, conjugate{};  // z0, q
  double u_offset = 0, u_conjugate = 0;        // standard uncertainty of each component
  double third = 0;                            // H; 0 unless N = 4

  /// w / M of eq. 2 for Z / M = (cosine, sine) of the measured wrapped phase.
  std::complex<double> undone(std::complex<double> measured) const {
    const std::complex<double> centred = measured - offset;
    const std::complex<double> w =
        (centred - product(conjugate, std::conj(centred))) / (1.0 - std::norm(conjugate));  // (2)
    return w + product({0.0, 4.0 * third * conjugate.imag()}, product(w, product(w, w)));
  }
};

struct PhaseLinearisation {
  CodeAxis axis = CodeAxis::x;
  int phase_steps = 4;              // N
  double period = 0;                // p, to recognise the grating
  int width_px = 0, height_px = 0;  // of the camera
  int columns = 0, rows = 0;        // nodes, row after row; the first and last on the picture's outermost pixels
  std::vector<std::complex<double>> ripple_rad;  // a + i b of eq. 3
  std::vector<double> u_ripple_rad;              // of each component, from the scatter of the pixels
  /// Mean over the flat stacks: placement errors, the last bit of angle. Its u: of this mean as the fixed part, from
  /// the scatter of the stacks.
  StepEllipse fixed;
  double sd_offset = 0, sd_conjugate = 0;  // of each component from stack to stack; 0 for a single stack
  int stacks = 0;
  std::vector<std::pair<std::string, std::string>> inputs;  // name and hash of each flat capture

  /// a + i b of eq. 3 at a pixel.
  std::complex<double> ripple_at(double x_px, double y_px) const;
  /// Eq. 3.
  double corrected(double phase_rad, std::complex<double> ripple) const {
    return phase_rad - ripple.real() * std::cos(phase_steps * phase_rad) -
           ripple.imag() * std::sin(phase_steps * phase_rad);
  }
};

Value to_value(const PhaseLinearisation& table);
PhaseLinearisation phase_linearisation_from(Fields fields);

}  // namespace fringecal::model

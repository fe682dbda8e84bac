// The errors that are new in every stack of frames - steps of the slide, brightness of the lamp - from the stack's own
// pixels.
//
// Frame k shows I_k = a + f_k (A0 + B cos(phi - 2 pi k / N - e_k)): f_k - 1 the lamp's flicker, e_k the step's error.
// Then Z = sum I_k exp(2 pi i k / N) is the ellipse of calib/model/phase_linearisation.h, eq. 1, with
//   z0 = (2 / N) (A0 / B) sum f_k exp(2 pi i k / N)          one cycle per period                  (1)
//   q  = sum f_k exp(4 pi i k / N) exp(i e_k) / conj(sum f_k exp(-i e_k))   two cycles             (2)
// What shows them. Four frames over-determine a pixel's A, B, phi once, by r = I0 - I1 + I2 - I3; to first order r has
// a constant, A0 (f0 - f1 + f2 - f3), and a cycle of B ((e0 - e2) sin phi + (e1 - e3) cos phi) and of the flicker's
// differences. The phase's own two cycles, e0 + e2 - e1 - e3, are *not* in it: no pixel alone can tell them, since they
// change phi and B as another surface would. So the pixels are taken together: eq. 1 of phase_linearisation.h also
// makes the modulation ripple,
//   |Z| / |w| = 1 + Re(z0 exp(-i phi)) + Re(q exp(-2 i phi)),                                      (3)
//   arg Z - phi = Im(z0 exp(-i phi)) + Im(q exp(-2 i phi)),                                        (4)
// the same two numbers in both. The modulation over the light that falls on the pixel is a slow function of the place,
// whatever the surface's shape or texture: |Z| / D, D = white - black level of the pixel in the Gray frames whose edge
// is farther than kClear periods away (D = 1 where the plan has no such frames: then texture is noise). Its logarithm's
// ripples (ripple.h) give z0 and q; corrected, estimated again until they stay. The surface's own smoothness is not used.
// Left open: the mean of all e_k (a shift of phi_O) and anything that ripples the reflected light itself in step with
// the fringes. A third harmonic H shows at N cycles; its product with q is taken into account.
// u: from the scatter of the pixels. No result: fewer than kMinPixels with a complete period around them.
#pragma once

#include "calib/decode/decode.h"
#include "calib/model/phase_linearisation.h"

namespace fringecal::decode {

inline constexpr double kClear = 0.45;   // periods: three blurs of an edge at the default grating
inline constexpr int kMinPixels = 2000;  // z0 to 0.01 sqrt(2 / 2000) = 0.3 mrad

struct StackErrors {
  model::StepEllipse ellipse;
  std::size_t n_pixels = 0;
};

/// map: of this capture, with phase patterns, not corrected.
Result<StackErrors> estimate_stack_errors(const Capture& capture, const PhaseMap& map);

}  // namespace fringecal::decode

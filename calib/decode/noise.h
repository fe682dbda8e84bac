// The camera's noise from the frames of one capture.
//
// Model: sigma^2(I) = read_variance + gain I, quantisation included (a photon-transfer line [EMVA1288]).
// N >= 4: the N frames of a pixel over-determine A, B and phi'. The component of highest frequency,
//   r = sum w_k I_k,  w_k = c cos(2 pi j k / N),  j = floor(N / 2),  sum w_k^2 = 1                              (1)
// (N = 4: (I0 - I1 + I2 - I3) / 2) contains neither A nor B, so texture and fixed-pattern gain cancel; what remains
// besides noise (step errors, flicker, the j-th harmonic) is smooth along the fringes and goes with the second
// difference
//   d = (r(-1) - 2 r(0) + r(+1)) / sqrt(6)  along the fringes,  var d = sigma^2(A)                              (2)
// N = 3 and plans without phase patterns have no such component: eq. 2 on the single frames, binned by their own level.
// Texture and fixed-pattern gain stay in it, so this sigma is an upper estimate.
// Per bin of grey level a variance from which outliers beyond four standard deviations (edges, dust) are clipped; then
// the weighted line through the bins, with neither coefficient negative, and not below the quantisation step's 1/12
// anywhere. Pixels at the ends of the grey scale do not take part.
#pragma once

#include "calib/decode/decode.h"
#include "calib/decode/rows.h"

namespace fringecal::decode {

/// Where too few pixels are usable (under kMinSamples) the source says so and one grey level at 8 bit is assumed.
NoiseModel estimate_noise(const Capture& capture, const AxisFrames& frames);

constexpr int kMinSamples = 500;  // sigma to 1 / sqrt(2 n) = 3 %

}  // namespace fringecal::decode

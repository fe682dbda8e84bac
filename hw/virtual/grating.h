// The patterns on glass as they leave the projector's lens.
//
// On glass a pattern is a binary function of u (core/pattern_plan.h): Gray bit b of n, with W = 2^(n-1-b) stripes,
//   bright where W < u mod 4 W < 3 W        (binary reflected: bit of i ^ (i >> 1))                             (1)
// and phase step k of N, the (n+1)-th bit's square wave where N = 4 and two stripes make a period,
//   bright where cos(2 pi u / p - pi - 2 pi k / N) > 0                                                         (2)
// The lens blurs with a Gaussian sigma(rho), rho the distance from the axis in half widths of the grating. Its third
// over first harmonic of (2) is (1/3) exp(-4 (2 pi sigma / p)^2) = h(rho), which fixes sigma:
//   h = h_centre + (h_edge - h_centre) rho^2,   E1 = exp(-(2 pi sigma / p)^2 / 2) = (3 h)^(1/8)                 (3)
//   (2) blurred = 1/2 + (2/pi) (E1 cos x - E1^9 cos(3x) / 3 + E1^25 cos(5x) / 5)                                (4)
//   (1) blurred = sum of normal distribution functions over its edges                                          (5)
// Errors, of full contrast: (4) leaves out E1^49 / 7 < 3e-5 at h <= 0.1 (1e-9 at the default); (5) takes the three
// nearest edges and reads Phi from a table with linear interpolation, 1.1e-6. Both are below 1e-4. A pattern displaced
// by `offset` shows at u what it has at u - offset. Dark glass passes 1 / contrast.
#pragma once

#include "hw/virtual/preset.h"

#include <cmath>
#include <span>

namespace fringecal::virt {

/// What the pixels of one row see of the projector; all spans of one length.
struct LightRow {
  std::span<const float> u_mm;
  std::span<const float> cosine, sine;    // of 2 pi u / p - pi
  std::span<const float> first_harmonic;  // E1
  std::span<const float> inverse_sigma;   // 1 / mm
  std::span<const float> light;           // grey levels under bright glass without blur
};

/// How the light of a row becomes grey levels.
struct Shine {
  double base = 0;    // light without the projector
  double factor = 1;  // on the projector's light
  double veil = 0;    // share of it that is scattered evenly: half of the glass is bright in every pattern
};

class Grating {
 public:
  explicit Grating(const Preset& preset);

  /// sigma at rho^2, eq. 3, mm.
  double sigma_mm(double rho2) const;
  /// E1 that belongs to a sigma, eq. 3.
  double first_harmonic(double sigma_mm) const;
  /// B over the light of bright glass, at the axis, before the camera's blur.
  double modulation_at_centre() const;
  /// out = base + light factor ((1 - veil) transmission of the pattern, displaced by offset_mm, + veil / 2).
  void project(const Pattern& pattern, double offset_mm, const LightRow& row, const Shine& shine,
               std::span<float> out) const;

 private:
  void project_gray(int bit, double offset_mm, const LightRow& row, std::span<float> transmission) const;
  void project_phase(int step, double offset_mm, const LightRow& row, std::span<float> transmission) const;

  FringeCode code_;
  double dark_, h_centre_, h_edge_;
};

/// Phi(x), exact, for the few places outside the pixel loops.
inline double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

}  // namespace fringecal::virt

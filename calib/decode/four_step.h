// Four phase steps and a Gray code in one pass over the frames, vectorised (Highway, run-time dispatch): the case of the
// paper's grating, 8 or 16 bit. The same equations as decode.h and gray.h, in this form:
//
//   S = I1 - I3,  C = I0 - I2,  4 A = I0 + I1 + I2 + I3,  4 t_b = 4 G_b - 4 A      integers, exact                  (1)
//   phi' = atan2(S, C): with a = min / max of |S|, |C|, reduced about pi / 4 above tan(pi / 8), and a polynomial of
//   degree 9 in a; off the true value by less than 3e-7 rad                                             [Moshier]  (2)
//   bit b is undecided where (4 t_b)^2 <= 16 sigma^2(A); limits of B are compared as 4 B^2 = S^2 + C^2              (3)
//   bit b of an n-bit code toggles within a stripe and a half of stripe s where, with h = 2^(n - 1 - b),
//   (h + 1 - s) mod 2 h <= 3; the finest two bits always do (gray.h, eq. 7)                                        (4)
//
// Every pixel stands alone, so the bytes do not depend on the width of the vectors, on the number of threads or on how
// the range is cut; no fused multiply-add. Equal to the general path of decode.cpp but for eq. 2's polynomial and the
// rounding of a value that lies on a limit.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace fringecal::decode {

/// How a fringe number follows from a stripe (gray.h): eq. 2, eqs. 3 and 4, eqs. 5 and 6.
enum class OrderRule { plain, half_stripe, whole_stripe };

struct FourStepTask {
  static constexpr int kMostBits = 14;  // a stripe number and its neighbours in 16 bits

  bool wide = false;  // frames of 16-bit values, else 8-bit
  std::array<const void*, 4> phase{};
  std::array<const void*, kMostBits> gray{};
  int bits = 7;
  OrderRule rule = OrderRule::half_stripe;
  int stripes_per_period = 2;
  // sigma^2 = max(1/12, read_variance + gain A); the limits of decode.cpp.
  float read_variance = 0, gain = 0;
  float saturation = 255, min_modulation = 4, shadow_modulation_per_sigma = 0;

  float* phase_rad = nullptr;
  std::uint8_t* validity = nullptr;
  // Null where not wanted.
  float *wrapped_rad = nullptr, *modulation = nullptr, *mean = nullptr, *u_phase_rad = nullptr;
};

/// Decodes the pixels first .. first + count - 1, counted over the frames row after row.
void decode_four_step(const FourStepTask& task, std::size_t first, std::size_t count);

}  // namespace fringecal::decode

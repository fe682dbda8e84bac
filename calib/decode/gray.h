// Gray bits to stripe numbers, and stripe numbers to fringe numbers m.
//
// Bits of one pixel: t_b = G_b - R_b with R_b the bit's reference (half the difference where it is the inverse); the
// Gray bit is 1 where t_b > 0. Binary-reflected: binary bit b is the sum modulo 2 of Gray bits 0 .. b, and stripe s is
// the binary number with bit 0 in front. (1)
//
// Plain fringe number: m = floor(s / stripes_per_period). With two stripes per period the finest bit toggles in
// mid-period and drops out. (2)
//
// Redundant, two stripes per period. The code says u_c = (s + 1/2) p / 2, at most p / 4 from the truth, so
//   q = u_c / p - 1/2 - phi' / 2 pi,  m = round(q) (3)
// and |q - m| = 1/4 + d, d the distance (in periods) by which the pixel lies on the wrong side of a Gray edge that it
// has crossed. m stays right up to d = 1/4. A pixel with |q - m| > 3/8 is inconsistent: edges up to p / 8 out of place
// are mended; of an edge further out the pixels from p / 8 to 3 p / 8 are flagged, and only an edge more than 3 p / 8
// out of place could give a wrong m without a flag. (4)
//
// Redundant, one stripe per period. Every period edge is a Gray edge. Where phi' > 0 the pixel is in the upper half of
// its period: m = s, or s - 1 if the edge s - 1 | s came too early or noise carried its bit over. In the first case that
// bit is full and the bit of the edge s | s + 1, the pixel's own, anything up to full; in the second the own bit is full
// and the neighbour's near its threshold. With F the mean of |t| over the other bits and s_t their deviation,
//   L = ((F - |t_neighbour|)^2 - (F - |t_own|)^2) / 2 s_t^2,   s_t^2 = 5/4 sigma^2 + (kLevelSpread F)^2
// is the logarithm of the likelihood ratio of the second to the first. Mirrored for phi' < 0 with s + 1. Within p / 8 of a
// period edge (|phi'| > 3 pi / 4) the neighbour is taken where |t_neighbour| < |t_own| and
//   L > min(kUnlikely, z (z + 2) / 2),   z = (pi - |phi'|) / u(phi') (5)
// The limit is the second case's improbability: next to the wrap the phase itself may be on the wrong side,
// ln((1 - Q(z)) / Q(z)) with Q the normal tail, which z (z + 2) / 2 follows within a quarter of it for z > 0.5; further out
// one bit in a thousand may be read wrongly. In the inner half of a period no bit may be near its threshold:
// less than kSurelyAtThreshold of the strongest there means an edge more than p / 4 out of place, inconsistent. (6)
//
// Either way, and without phase patterns too: a bit may be undecided, |t_b| <= sigma, only where it toggles, within a
// stripe and a half of the pixel. Undecided elsewhere (indirect light, a gloss) it may stand for any order:
// inconsistent. (7)
#pragma once

#include "calib/decode/rows.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace fringecal::decode {

constexpr float kLevelSpread = 0.07f;  // of the full levels of the bits, relative: blur and lamp
constexpr float kUnlikely = 7.0f;      // ln 1100
constexpr float kSurelyAtThreshold = 0.15f;
constexpr float kTurnsPerRadian = 0.5f * std::numbers::inv_pi_v<float>;

/// A row of bits. t is kept bit after bit: t[b * width + x].
struct BitRow {
  std::size_t width;
  std::vector<std::int32_t> stripe;
  std::vector<float> t;
  BitRow(std::size_t width_px, std::size_t bits) : width(width_px), stripe(width_px), t(width_px * bits) {}
};

/// Adds bit b (in the order 0, 1, ...): eq. 1 from t_b, already in `row`.
inline void append_bit(BitRow& row, std::size_t bit) {
  const float* t = row.t.data() + bit * row.width;
  if (bit == 0) std::fill(row.stripe.begin(), row.stripe.end(), 0);
  for (std::size_t x = 0; x < row.width; ++x) {
    const std::int32_t s = row.stripe[x];
    row.stripe[x] = 2 * s + ((s & 1) ^ static_cast<std::int32_t>(t[x] > 0));  // (1)
  }
}

struct FringeNumber {
  std::int32_t m = 0;
  bool consistent = true;
};

/// Eqs. 3 and 4. periods: how many the pattern holds.
inline FringeNumber fringe_of_half_stripe(std::int32_t stripe, float wrapped, std::int32_t periods) {
  const float q = 0.5f * (static_cast<float>(stripe) + 0.5f) - 0.5f - wrapped * kTurnsPerRadian;
  const float m = std::floor(q + 0.5f);                                                          // (3)
  FringeNumber out{.m = static_cast<std::int32_t>(m), .consistent = std::abs(q - m) <= 0.375f};  // (4)
  if (out.m < 0 || out.m >= periods) out.consistent = false;
  return out;
}

/// The Gray bit that toggles between the stripes `upper - 1` and `upper` of an n-bit code; -1 at the ends of the
/// pattern.
inline int toggling_bit(std::int32_t upper, int bits) {
  if (upper <= 0 || upper >= (1 << bits)) return -1;
  int zeros = 0;
  for (std::int32_t v = upper; (v & 1) == 0; v >>= 1) ++zeros;
  return bits - 1 - zeros;
}

struct WrappedPhase {
  float phi, u_phi;  // phi' and its standard uncertainty, rad
  float sigma;       // noise of one frame, grey levels
};

/// Eqs. 5 and 6 for pixel x of the row.
FringeNumber fringe_of_whole_stripe(const BitRow& row, std::size_t x, int bits, const WrappedPhase& phase);

/// Eq. 7 for pixel x of the row.
bool undecided_far_from_edges(const BitRow& row, std::size_t x, int bits, float sigma);

}  // namespace fringecal::decode

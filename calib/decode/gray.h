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
// its period: m = s, or s - 1 if the edge s - 1 | s came too early. If so, the bit that toggles there has only just
// crossed its threshold, |t| is small; at the true upper end of s that edge is most of a period away, |t| is full, and
// the small one is the bit on the pixel's own side. Mirrored for phi' < 0 with s + 1. So: within p / 8 of a period edge
// (|phi'| > 3 pi / 4) the neighbour is taken if |t| on its side is below kNearThreshold of |t| on the own side, or
// below kBelowFull of it and by kClearly sigma less. (5) The margins keep noise from deciding where edges are so sharp
// that both bits are full. t_full >= (pi / 4) B, B being the fundamental of the square wave: the first condition then
// fails by 0.5 B / sigma standard deviations (2 at B = 4 sigma, 4 at 8), the second by 3.5 (the difference of two
// frames has sqrt(2) sigma). Within 3 u(phi') of the wrap the phase itself cannot tell the side, but there the bit of
// the true edge is small for certain, and kClearlyAtWrap is enough. In the inner half of a period no bit may be near
// its threshold: less than kSurelyAtThreshold of the strongest there means an edge more than p / 4 out of place,
// inconsistent. (6)
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

constexpr float kNearThreshold = 0.3f;
constexpr float kBelowFull = 0.7f;
constexpr float kClearly = 5.0f;
constexpr float kClearlyAtWrap = 2.5f;
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

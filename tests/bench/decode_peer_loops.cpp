// What the compiler makes of plain loops at -O3 -ffast-math. Compiled three times (FRINGECAL_LOOPS is the namespace): for any
// x86-64, as a distribution compiles, for x86-64-v3, and with -march=native, its best, which runs on no other machine.
#include "tests/bench/decode_peers.h"

#include <cmath>

namespace fringecal::bench::FRINGECAL_LOOPS {

void touch_everything(const DecodePeerTask& task, std::size_t first, std::size_t count) {
  const std::uint8_t* const* f = task.frames.data();
  float* __restrict phase = task.phase_rad + first;
  std::uint8_t* __restrict mask = task.invalid + first;
  const std::uint8_t *a = f[0] + first, *b = f[1] + first, *c = f[2] + first, *d = f[3] + first, *e = f[4] + first,
                     *g = f[5] + first, *h = f[6] + first, *i = f[7] + first, *j = f[8] + first, *k = f[9] + first,
                     *l = f[10] + first;
  for (std::size_t x = 0; x < count; ++x) {
    const auto all =
        static_cast<std::uint8_t>(a[x] ^ b[x] ^ c[x] ^ d[x] ^ e[x] ^ g[x] ^ h[x] ^ i[x] ^ j[x] ^ k[x] ^ l[x]);
    mask[x] = all;
    phase[x] = static_cast<float>(all);
  }
}

void decode_by_float_loop(const DecodePeerTask& task) {
  const std::uint8_t* const* f = task.frames.data();
  const std::size_t pixels = static_cast<std::size_t>(task.width) * static_cast<std::size_t>(task.height);
  const std::uint8_t *i0 = f[0], *i1 = f[1], *i2 = f[2], *i3 = f[3], *g0 = f[4], *g1 = f[5], *g2 = f[6], *g3 = f[7],
                     *g4 = f[8], *g5 = f[9], *g6 = f[10];
  float* __restrict phase = task.phase_rad;
  std::uint8_t* __restrict invalid = task.invalid;
  constexpr float kPi = 3.14159265f;
#pragma omp simd
  for (std::size_t x = 0; x < pixels; ++x) {
    const float a = i0[x], b = i1[x], c = i2[x], d = i3[x];
    const float mean = 0.25f * (a + b + c + d), s = b - d, co = a - c;
    const float wrapped = atan2f(s, co), modulation = 0.5f * sqrtf(s * s + co * co);
    int bit = g0[x] > mean, stripe = bit;
    const auto add = [&](const std::uint8_t* g) {
      bit ^= static_cast<int>(static_cast<float>(g[x]) > mean);
      stripe = 2 * stripe + bit;
    };
    add(g1), add(g2), add(g3), add(g4), add(g5), add(g6);
    const float q = 0.5f * (static_cast<float>(stripe) + 0.5f) - 0.5f - wrapped * (0.5f / kPi);
    const float m = floorf(q + 0.5f);
    const bool good = modulation >= 4.0f && fabsf(q - m) <= 0.375f && fmaxf(fmaxf(a, b), fmaxf(c, d)) < 255.0f;
    phase[x] = 2 * kPi * m + wrapped;
    invalid[x] = static_cast<std::uint8_t>(!good);
  }
}

}  // namespace fringecal::bench::FRINGECAL_LOOPS

#include "hw/virtual/random.h"

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace fringecal::virt {
namespace {

const std::vector<float>& quantile_table() {
  static const std::vector<float> table = [] {
    constexpr int kSize = 65536;
    std::vector<double> exact(kSize);
    double variance = 0;
    for (int i = 0; i < kSize; ++i) {
      exact[static_cast<std::size_t>(i)] = normal_quantile((i + 0.5) / kSize);
      variance += exact[static_cast<std::size_t>(i)] * exact[static_cast<std::size_t>(i)] / kSize;
    }
    std::vector<float> out;
    out.reserve(exact.size());
    for (const double x : exact) out.push_back(static_cast<float>(x / std::sqrt(variance)));
    return out;
  }();
  return table;
}

}  // namespace

std::uint64_t key_of(std::uint64_t seed, std::string_view purpose) {
  std::uint64_t text = 0xCBF29CE484222325ULL;  // FNV-1a
  for (const char c : purpose) text = (text ^ static_cast<unsigned char>(c)) * 0x100000001B3ULL;
  return hash64(hash64(seed, 0), text);
}

double normal_quantile(double probability) {
  if (probability > 0.5) return -normal_quantile(1.0 - probability);
  // Start: the leading tail formula; then Newton on log Phi, which is concave, so it converges from either side.
  const double t = std::sqrt(-2.0 * std::log(probability));
  double x = -(t - (2.30753 + 0.27061 * t) / (1.0 + t * (0.99229 + 0.04481 * t)));  // [AbramowitzStegun, 26.2.22], 3e-3
  for (int iteration = 0; iteration < 4; ++iteration) {
    const double phi = std::exp(-0.5 * x * x) / std::sqrt(2.0 * std::numbers::pi);
    const double below = 0.5 * std::erfc(-x / std::numbers::sqrt2);
    x -= below / phi * std::log(below / probability);
  }
  return x;
}

void fill_normal(std::uint64_t key, int row, std::span<float> out) {
  const float* table = quantile_table().data();
  const std::uint64_t row_key = hash64(key, static_cast<std::uint64_t>(row));
  const std::size_t fours = out.size() / 4;
  for (std::size_t i = 0; i < fours; ++i) {
    const std::uint64_t h = hash64(row_key, i);
    out[4 * i] = table[h & 0xFFFF];
    out[4 * i + 1] = table[(h >> 16) & 0xFFFF];
    out[4 * i + 2] = table[(h >> 32) & 0xFFFF];
    out[4 * i + 3] = table[h >> 48];
  }
  std::uint64_t h = hash64(row_key, fours);
  for (std::size_t i = 4 * fours; i < out.size(); ++i, h >>= 16) out[i] = table[h & 0xFFFF];
}

}  // namespace fringecal::virt

// Random numbers of the virtual scanner: functions of (seed, purpose, counter), so that no result depends on the order
// of the calls or on the number of threads.
//
//   h(k) = splitmix64 finaliser of (key + k 0x9E3779B97F4A7C15)   [Steele2014]; key from seed and purpose     (1)
//   g    = q(h)   normal quantile of the hash                                                                  (2)
// Stream draws with 53 bits (tail beyond 8 sigma). Pixel noise takes 16 bits: q is then a table of 65536 quantiles at
// (i + 1/2) / 65536, scaled to unit variance (the scale is 1.00005); its tail ends at 4.33 sigma, where a normal noise
// would have 1.5e-5 of its samples further out: 20 pixels of a frame of 1.4 million.
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <string_view>

namespace fringecal::virt {

/// Eq. 1: 64 well mixed bits of (key, counter).
inline std::uint64_t hash64(std::uint64_t key, std::uint64_t counter) {
  std::uint64_t x = key + (counter + 1) * 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

/// A key of its own for each purpose of a seed.
std::uint64_t key_of(std::uint64_t seed, std::string_view purpose);

/// x with Phi(x) = probability, in (0, 1); relative error below 1e-12.
double normal_quantile(double probability);

/// A sequence of draws for one purpose.
class Stream {
 public:
  Stream(std::uint64_t seed, std::string_view purpose) : key_(key_of(seed, purpose)) {}
  double uniform() { return (static_cast<double>(hash64(key_, counter_++) >> 11) + 0.5) * 0x1p-53; }
  double normal() { return normal_quantile(uniform()); }
  Eigen::Vector3d normal3() {
    const double x = normal(), y = normal(), z = normal();
    return {x, y, z};
  }

 private:
  std::uint64_t key_, counter_ = 0;
};

/// Unit normal numbers for row `row` of a frame with this key.
void fill_normal(std::uint64_t key, int row, std::span<float> out);

}  // namespace fringecal::virt

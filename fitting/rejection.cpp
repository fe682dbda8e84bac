#include "fitting/rejection.h"

#include "fitting/selection.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>

namespace fringecal::fitting {

std::uint64_t Random::next() {
  std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ull);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

std::vector<Eigen::Vector3d> spread_sample(Points points, const PointWeights& weights, std::size_t count,
                                           Random& random) {
  constexpr std::size_t kAhead = 24;  // places asked of the memory before they are needed: it has some 100 ns to answer
  std::vector<Eigen::Vector3d> out;
  const std::size_t n = points.size();
  const auto is_free = [&](std::size_t i) { return !weights.used || (weights.used[i / 8] >> (i % 8) & 1) != 0; };
  if (n <= count) {
    out.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
      if (is_free(i)) out.push_back(points[i]);
    }
    return out;
  }
  struct Stretch {
    std::size_t start, end;
  };
  std::vector<Stretch> stretches(count);
  const std::size_t step = n / count, rest = n % count;
  for (std::size_t c = 0, first = 0, over = 0; c < count; ++c) {  // first = c n / count, without a division
    over += rest;
    const std::size_t end = first + step + (over >= count ? 1 : 0);
    if (over >= count) over -= count;
    stretches[c] = {first + random.below(end - first), end};
    first = end;
  }
  out.resize(count);
  std::size_t taken = 0;
  for (std::size_t c = 0; c < count; ++c) {
    if (c + kAhead < count) __builtin_prefetch(&points[stretches[c + kAhead].start]);
    std::size_t i = stretches[c].start;
    while (i < stretches[c].end && !is_free(i)) ++i;
    if (i < stretches[c].end) out[taken++] = points[i];
  }
  out.resize(taken);
  return out;
}

Sample make_sample(std::vector<Eigen::Vector3d> points) {
  constexpr std::size_t kNeighbours = 16;
  Sample sample;
  sample.points = std::move(points);
  const std::size_t n = sample.points.size(), near = std::min(kNeighbours, n);
  std::vector<std::pair<double, std::size_t>> by_distance(n);
  for (const Eigen::Vector3d& p : sample.points) {
    for (std::size_t j = 0; j < n; ++j) by_distance[j] = {(sample.points[j] - p).squaredNorm(), j};
    std::nth_element(by_distance.begin(), by_distance.begin() + static_cast<std::ptrdiff_t>(near - 1),
                     by_distance.end());
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t j = 0; j < near; ++j) mean += sample.points[by_distance[j].second] / static_cast<double>(near);
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (std::size_t j = 0; j < near; ++j) {
      const Eigen::Vector3d u = sample.points[by_distance[j].second] - mean;
      scatter += u * u.transpose();
    }
    sample.normals.push_back(symmetric_eigen<3>(scatter).vectors.col(0));
  }
  return sample;
}

Support support(std::span<const double> distances, int parameters) {
  // Counted in bins of a quarter octave of the tolerance, from 2^-40 to 1 (normalised lengths).
  constexpr int kPerOctave = 4, kOctaves = 40, kBins = kPerOctave * kOctaves;
  std::array<int, kBins + 1> bins{};
  for (const double d : distances) {
    const double size = std::abs(d);
    if (!(size < 1.0)) continue;
    int exponent = 0;
    const double mantissa = std::frexp(size, &exponent);  // [1/2, 1)
    const int bin = kPerOctave * (exponent + kOctaves - 1) + static_cast<int>((mantissa - 0.5) * 2.0 * kPerOctave);
    ++bins[static_cast<std::size_t>(size == 0.0 ? 0 : std::clamp(bin, 0, kBins - 1))];
  }
  const double n = static_cast<double>(distances.size());
  Support best;
  int k = 0;
  for (int bin = 0; bin < kBins; ++bin) {
    const int more = bins[static_cast<std::size_t>(bin)];
    k += more;
    if (more == 0 || k <= parameters) continue;
    const double tolerance = std::ldexp(1.0 + (bin % kPerOctave + 1.0) / kPerOctave, bin / kPerOctave - kOctaves);
    const double log_choose = std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0);
    const double log_nfa = log_choose + (k - parameters) * std::log(std::min(1.0, tolerance));  // eq. 1
    if (log_nfa < best.log_nfa) best = {log_nfa, tolerance};
  }
  return best;
}

UsedBits all_used(std::size_t n) {
  UsedBits out((n + 7) / 8, 0xff);
  if (n % 8) out.back() = static_cast<std::uint8_t>((1u << (n % 8)) - 1);
  return out;
}

std::size_t count_used(const UsedBits& bits) {
  // by words: without the processor's own instruction a count of bits is a call
  std::size_t n = 0, byte = 0;
  for (; byte + sizeof(std::uint64_t) <= bits.size(); byte += sizeof(std::uint64_t)) {
    std::uint64_t word = 0;
    std::memcpy(&word, bits.data() + byte, sizeof word);
    n += static_cast<std::size_t>(std::popcount(word));
  }
  for (; byte < bits.size(); ++byte) n += static_cast<std::size_t>(std::popcount(bits[byte]));
  return n;
}

bool is_settled(const UsedBits& now, const UsedBits& next) {
  UsedBits differing(now.size());
  std::transform(now.begin(), now.end(), next.begin(), differing.begin(),
                 [](std::uint8_t a, std::uint8_t b) { return static_cast<std::uint8_t>(a ^ b); });
  const double n = 8.0 * static_cast<double>(now.size());
  return static_cast<double>(count_used(differing)) <= 0.02 * std::sqrt(n);
}

UsedBits within(std::span<const double> distances_mm, double limit_mm) { return marked_within(distances_mm, limit_mm); }

namespace {

constexpr double kLimit = 3.5 * 1.4826;  // eq. 2, in medians

/// The median of |d| over the points used, if it lies between low and high; absent where it does not.
std::optional<double> median_between(std::span<const double> distances_mm, const UsedBits& used, std::size_t n_used,
                                     double low, double high) {
  SizesBetween found = sizes_between(distances_mm, used, low, high);
  if (found.below > n_used / 2 || n_used / 2 - found.below >= found.sizes.size()) return std::nullopt;
  const auto middle = found.sizes.begin() + static_cast<std::ptrdiff_t>(n_used / 2 - found.below);
  std::nth_element(found.sizes.begin(), middle, found.sizes.end());
  return *middle;
}

}  // namespace

double median_size(std::span<const double> distances_mm, const UsedBits& used, std::optional<double> expected) {
  constexpr double kAround = 0.03;
  constexpr std::size_t kFew = 2000, kLeast = 1024, kMost = 8192;
  constexpr double kAll = std::numeric_limits<double>::max();
  const std::size_t n = count_used(used);
  require(n > 0, "a median is taken of some points");
  if (n > kFew && expected) {
    const double low = (1.0 - kAround) * *expected, high = (1.0 + kAround) * *expected;
    if (const auto median = median_between(distances_mm, used, n, low, high)) return *median;
  }
  if (n > kFew) {
    // One pass: what lies below an interval that holds the median, by a sample, is counted and what lies in it
    // collected. Three standard deviations of the sample's quantile on either side.
    std::vector<double> some;
    const std::size_t step = distances_mm.size() / std::clamp(distances_mm.size() / 32, kLeast, kMost);
    some.reserve(distances_mm.size() / step + 1);
    for (std::size_t i = 0; i < distances_mm.size(); i += step) {
      if (is_used(used, i)) some.push_back(std::abs(distances_mm[i]));
    }
    const auto m = static_cast<std::ptrdiff_t>(some.size());
    const auto reach = static_cast<std::ptrdiff_t>(1.5 * std::sqrt(static_cast<double>(m)));
    if (m / 2 > reach && m / 2 + reach < m) {
      const auto at_low = some.begin() + (m / 2 - reach), at_high = some.begin() + (m / 2 + reach);
      std::nth_element(some.begin(), at_low, some.end());
      const double low = *at_low;
      std::nth_element(at_low, at_high, some.end());
      if (const auto median = median_between(distances_mm, used, n, low, *at_high)) return *median;
    }
  }
  const auto median = median_between(distances_mm, used, n, 0.0, kAll);
  require(median.has_value(), "distances are numbers");
  return *median;
}

UsedBits within_robust_deviation(std::span<const double> distances_mm, const UsedBits& used, double rounding_mm,
                                 std::optional<double> expected_sigma_mm) {
  if (expected_sigma_mm) *expected_sigma_mm /= 1.4826;
  const double median = median_size(distances_mm, used, expected_sigma_mm);
  return within(distances_mm, std::max(kLimit * median, rounding_mm));  // eq. 2
}

UsedBits settled_within_robust_deviation(std::span<const double> distances_mm, const UsedBits& used,
                                         double rounding_mm) {
  constexpr int kRounds = 20;
  constexpr double kAround = 0.02;
  const auto limit_of = [&](double median) { return std::max(kLimit * median, rounding_mm); };
  const double median = median_size(distances_mm, used);
  const double first_limit = limit_of(median);
  double limit = first_limit;
  // What is within a limit depends on the limit alone, so its median is a rank among all sizes: those near the first
  // median and near the first limit answer for all that follow.
  const UsedBits all = all_used(distances_mm.size());
  SizesBetween middle = sizes_between(distances_mm, all, (1.0 - kAround) * median, (1.0 + kAround) * median);
  SizesBetween outer = sizes_between(distances_mm, all, (1.0 - kAround) * limit, (1.0 + kAround) * limit);
  std::sort(outer.sizes.begin(), outer.sizes.end());
  const auto count_within = [&](double size) {
    const auto end = std::upper_bound(outer.sizes.begin(), outer.sizes.end(), size);
    return outer.below + static_cast<std::size_t>(end - outer.sizes.begin());
  };
  std::size_t count = count_within(limit);
  for (int round = 0; round < kRounds; ++round) {
    if (count / 2 < middle.below || count / 2 - middle.below >= middle.sizes.size()) break;
    const auto at = middle.sizes.begin() + static_cast<std::ptrdiff_t>(count / 2 - middle.below);
    std::nth_element(middle.sizes.begin(), at, middle.sizes.end());
    const double next = limit_of(*at);
    if (!(std::abs(next - first_limit) < kAround * first_limit)) break;
    const std::size_t next_count = count_within(next);
    limit = next;
    if (next_count == count) return within(distances_mm, limit);
    count = next_count;
  }
  // Farther off: one by one.
  UsedBits now = within(distances_mm, limit);
  for (int round = 0; round < kRounds; ++round) {
    UsedBits next = within_robust_deviation(distances_mm, now, rounding_mm);
    if (next == now) break;
    now = std::move(next);
  }
  return now;
}

UsedBits within_three_deviations(std::span<const double> distances_mm, double standard_deviation_mm) {
  const std::size_t most = distances_mm.size() * 3 / 1000;
  std::vector<std::size_t> out_of_limit;
  for (std::size_t i = 0; i < distances_mm.size(); ++i) {
    if (std::abs(distances_mm[i]) > 3.0 * standard_deviation_mm) out_of_limit.push_back(i);
  }
  std::stable_sort(out_of_limit.begin(), out_of_limit.end(),
                   [&](std::size_t a, std::size_t b) { return std::abs(distances_mm[a]) > std::abs(distances_mm[b]); });
  out_of_limit.resize(std::min(out_of_limit.size(), most));
  UsedBits out = all_used(distances_mm.size());
  for (const std::size_t i : out_of_limit) out[i / 8] &= static_cast<std::uint8_t>(~(1u << (i % 8)));
  return out;
}

std::string why_too_few(std::size_t n, int needed, const char* shape) {
  if (n >= static_cast<std::size_t>(needed)) return {};
  return fmt::format("a {} needs at least {} points and there are {}", shape, needed, n);
}

std::string why_not_finite(Points points_mm) {
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    // beyond 1e100 mm the squares of distances leave the range of double
    if (!(points_mm[i].cwiseAbs().maxCoeff() <= 1e100) || !points_mm[i].allFinite()) {
      return fmt::format("point {} of {} is not a finite position; remove invalid points before fitting", i + 1,
                         points_mm.size());
    }
  }
  return "the coordinates span more orders of magnitude than a number can hold; remove the points that are far off";
}

}  // namespace fringecal::fitting

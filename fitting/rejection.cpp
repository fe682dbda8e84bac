#include "fitting/rejection.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace fringecal::fitting {

std::uint64_t Random::next() {
  std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ull);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

std::vector<Eigen::Vector3d> random_subset(Points points, std::size_t count, Random& random) {
  if (points.size() <= count) return {points.begin(), points.end()};
  std::vector<std::size_t> index(points.size());
  std::iota(index.begin(), index.end(), std::size_t{0});
  for (std::size_t i = 0; i < count; ++i) std::swap(index[i], index[i + random.below(index.size() - i)]);
  index.resize(count);
  std::sort(index.begin(), index.end());
  std::vector<Eigen::Vector3d> out;
  out.reserve(count);
  for (const std::size_t i : index) out.push_back(points[i]);
  return out;
}

Sample make_sample(Points normalised, Random& random) {
  constexpr std::size_t kPoints = 2000;  // the search costs points x proposals; normals cost points squared
  constexpr std::size_t kNeighbours = 16;
  Sample sample;
  sample.points = random_subset(normalised, kPoints, random);
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

Support support(const std::vector<double>& distances, int parameters) {
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

std::vector<bool> beyond_robust_deviation(const std::vector<double>& distances_mm, const std::vector<bool>& rejected,
                                          double rounding_mm) {
  std::vector<double> sizes;
  sizes.reserve(distances_mm.size());
  for (std::size_t i = 0; i < distances_mm.size(); ++i) {
    if (!rejected[i]) sizes.push_back(std::abs(distances_mm[i]));
  }
  require(!sizes.empty(), "a robust deviation is taken of some points");
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  const double limit = std::max(3.5 * 1.4826 * *middle, rounding_mm);  // eq. 2
  std::vector<bool> out(distances_mm.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = std::abs(distances_mm[i]) > limit;
  return out;
}

std::vector<bool> beyond_three_deviations(const std::vector<double>& distances_mm, double standard_deviation_mm) {
  const std::size_t most = distances_mm.size() * 3 / 1000;
  std::vector<std::size_t> out_of_limit;
  for (std::size_t i = 0; i < distances_mm.size(); ++i) {
    if (std::abs(distances_mm[i]) > 3.0 * standard_deviation_mm) out_of_limit.push_back(i);
  }
  std::stable_sort(out_of_limit.begin(), out_of_limit.end(),
                   [&](std::size_t a, std::size_t b) { return std::abs(distances_mm[a]) > std::abs(distances_mm[b]); });
  out_of_limit.resize(std::min(out_of_limit.size(), most));
  std::vector<bool> out(distances_mm.size());
  for (const std::size_t i : out_of_limit) out[i] = true;
  return out;
}

std::string why_unusable(Points points_mm, int needed, const char* shape) {
  if (points_mm.size() < static_cast<std::size_t>(needed)) {
    return fmt::format("a {} needs at least {} points and there are {}", shape, needed, points_mm.size());
  }
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    // beyond 1e100 mm the squares of distances leave the range of double
    if (!(points_mm[i].cwiseAbs().maxCoeff() <= 1e100) || !points_mm[i].allFinite()) {
      return fmt::format("point {} of {} is not a finite position; remove invalid points before fitting", i + 1,
                         points_mm.size());
    }
  }
  return {};
}

}  // namespace fringecal::fitting

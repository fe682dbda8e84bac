// Which points belong to the surface: the consensus of a raw scan, and the rules of Rejection (fit.h).
//
// Consensus search (Rejection::robust): surfaces are proposed from few points of a random sample (fixed seed) and
// judged by how unlikely their support is: k of n points within tolerance t of a surface, where a point of no surface
// is so with probability p(t) = t / size of the scan. The best surface has the least
//   ln NFA = min over t of  ln C(n, k(t)) + (k(t) - m) ln p(t)                                                 (1)
// (a-contrario RANSAC [MoisanStival2004]): many points at a small tolerance, without a tolerance that must be given.
// Then, on all points, until the set is the same, or the one before the last, or changes by at most sqrt(n) / 50 points
// (each stands 3.5 sigma off, so together they move the surface by less than a tenth of its standard uncertainty):
//   sigma = 1.4826 median |d| over the points used;  used = { |d| <= 3.5 sigma }                               (2)
// (1.4826: the ratio of standard deviation and MAD of a normal distribution.)
#pragma once

#include "fitting/least_squares.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::fitting {

/// splitmix64: the same sequence on every machine, which the distributions of <random> do not promise.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(next() % n); }

 private:
  std::uint64_t state_;
};

/// A sample of a normalised scan with the normal of each point, estimated from its neighbours.
struct Sample {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> normals;  // unit, sign arbitrary
};
Sample make_sample(std::vector<Eigen::Vector3d> points);

/// Eq. 1.
struct Support {
  double log_nfa = 0.0;
  double tolerance = 0.0;
};
Support support(std::span<const double> distances, int parameters);

/// Which points are used: bit i % 8 of byte i / 8 (kernels.h).
using UsedBits = std::vector<std::uint8_t>;
inline bool is_used(const UsedBits& bits, std::size_t i) { return (bits[i / 8] >> (i % 8) & 1) != 0; }
UsedBits all_used(std::size_t n);
std::size_t count_used(const UsedBits& bits);

/// The points within `limit_mm`.
UsedBits within(std::span<const double> distances_mm, double limit_mm);

/// Median of |d| over the points used. expected: where it is found with the least work, if it is within 3 % of that.
double median_size(std::span<const double> distances_mm, const UsedBits& used,
                   std::optional<double> expected = std::nullopt);

/// The points within 3.5 sigma, eq. 2. rounding_mm: a distance that rounding explains is never beyond. expected_sigma_mm:
/// as in median_size().
UsedBits within_robust_deviation(std::span<const double> distances_mm, const UsedBits& used, double rounding_mm,
                                 std::optional<double> expected_sigma_mm = std::nullopt);

/// The same, repeated on these distances until the set stays as it is: as good as a descent for each, and less work.
UsedBits settled_within_robust_deviation(std::span<const double> distances_mm, const UsedBits& used,
                                         double rounding_mm);

/// Whether the sets differ by so few points that it is of no consequence.
bool is_settled(const UsedBits& now, const UsedBits& next);

/// VDI/VDE 2634: all but at most 0.3 % of the points, those farthest out, and only beyond 3 s.
UsedBits within_three_deviations(std::span<const double> distances_mm, double standard_deviation_mm);

/// About `count` of the points used, one at random of each of as many equal stretches of their order, fewer where a
/// stretch has none.
std::vector<Eigen::Vector3d> spread_sample(Points points, const PointWeights& weights, std::size_t count,
                                           Random& random);

/// Fewer points than `needed`: the sentence; empty where there are enough.
std::string why_too_few(std::size_t n, int needed, const char* shape);
/// The sentence that names the first point that is not finite.
std::string why_not_finite(Points points_mm);

}  // namespace fringecal::fitting

// Which points belong to the surface: the consensus of a raw scan, and the rules of Rejection (fit.h).
//
// Consensus search (Rejection::robust): surfaces are proposed from few points of a random sample (fixed seed) and
// judged by how unlikely their support is: k of n points within tolerance t of a surface, where a point of no surface
// is so with probability p(t) = t / size of the scan. The best surface has the least
//   ln NFA = min over t of  ln C(n, k(t)) + (k(t) - m) ln p(t)                                                 (1)
// (a-contrario RANSAC [MoisanStival2004]): many points at a small tolerance, without a tolerance that must be given.
// Then, on all points, until the set is the same:
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

/// At most `count` of the points, chosen at random without repetition, in the order of the points.
std::vector<Eigen::Vector3d> random_subset(Points points, std::size_t count, Random& random);

/// A sample of a normalised scan with the normal of each point, estimated from its neighbours.
struct Sample {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> normals;  // unit, sign arbitrary
};
Sample make_sample(Points normalised, Random& random);

/// Eq. 1.
struct Support {
  double log_nfa = 0.0;
  double tolerance = 0.0;
};
Support support(const std::vector<double>& distances, int parameters);

/// Flags of the points beyond 3.5 sigma, eq. 2, sigma from the points that are not flagged in `rejected`.
/// rounding_mm: a distance that rounding explains is never beyond.
std::vector<bool> beyond_robust_deviation(const std::vector<double>& distances_mm, const std::vector<bool>& rejected,
                                          double rounding_mm);

/// VDI/VDE 2634: flags of at most 0.3 % of the points, those farthest out, and only beyond 3 s.
std::vector<bool> beyond_three_deviations(const std::vector<double>& distances_mm, double standard_deviation_mm);

/// A point that is not finite, or fewer points than `needed`: the sentence; empty where the points can be used.
std::string why_unusable(Points points_mm, int needed, const char* shape);

}  // namespace fringecal::fitting

// The common way of fit_plane, fit_sphere and fit_cylinder: check the points, solve, reject, solve again, describe.
//
// A Shape has
//   Surface                       (surface.h)
//   kName                         for messages
//   why_flat(points)              the sentence, where the points lie in one plane (or line)
//   start(points, most, options)  a surface near the minimum, in the points' frame, without a guess, from at most `most`
//                                 points; or the sentence
//   rough_start(points)           the same, quickly, from points in their frame; absent where it is not sure to be near
//   why_undetermined(points, minimum, options)
//                                 the sentence, where the points leave the shape open; the minimum in the frame
//   convex(s), with_curvature(s, k), beside_origin(s)   the same surface described for a descent; another radius
//   propose(sample, random)       a surface through few points of a sample
//   is_round(points, surface)     whether the points show the surface's curvature at all
// and the plane minimum_of(points), its minimum without another look at the points.
#pragma once

#include "fitting/huge_pages.h"
#include "fitting/least_squares.h"
#include "fitting/rejection.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace fringecal::fitting {

template <class Surface>
struct Associated {
  Minimum<Surface> minimum;  // in mm
  FitQuality quality;
  /// Covariance of the surface's parameters: s^2 (J^T J)^-1, or (J^T W J)^-1 with the points' covariances.
  MatrixN<Surface::kParameters> covariance;
};

/// Distances of all points from a surface.
template <class Surface>
Distances distances(Points points, const Surface& surface) {
  Distances out(points.size());
  normal_equations(surface, as_they_are(points), out.data());
  return out;
}

/// s of the header of fit.h; infinite where there are only as many points as parameters.
inline double standard_deviation(double f, double n, int parameters) {
  const double freedom = n - parameters;
  return freedom > 0.0 ? std::sqrt(f / freedom) : std::numeric_limits<double>::infinity();
}

/// The frame's points, as a sample for the searches that need few.
inline std::vector<Eigen::Vector3d> sample_in_frame(const FramedPoints& framed, std::size_t count, Random& random) {
  std::vector<Eigen::Vector3d> out = spread_sample(framed.points_mm, framed.weights, count, random);
  for (Eigen::Vector3d& p : out) p = framed.in_frame(p);
  return out;
}

/// A surface of the frame's lengths in mm, and back.
template <class Surface>
Surface surface_in_mm(const Surface& surface, const FramedPoints& framed) {
  return surface.transformed(framed.scale_mm, framed.origin_mm);
}
template <class Surface>
Surface surface_in_frame(const Surface& surface_mm, const FramedPoints& framed) {
  return surface_mm.transformed(1.0 / framed.scale_mm, -framed.origin_mm / framed.scale_mm);
}

/// From here on a sample finds the frame and a start, and few passes over all points the minimum.
constexpr std::size_t kMany = 5000;

/// What a consensus gives: the surface, and how near to it a point belongs to it. In mm, or the frame's lengths.
template <class Surface>
struct Consensus {
  Surface surface;
  double tolerance;
};

/// A consensus of the frame's lengths, in mm, after a step with more of many points: so near to the end of a rejection that
/// it mostly needs one round over all points.
template <class Shape>
Consensus<typename Shape::Surface> nearer(Consensus<typename Shape::Surface> found, const FramedPoints& framed,
                                          Random& random) {
  using Surface = typename Shape::Surface;
  constexpr double kPart = 6.0, kMost = 5000.0;  // most: what memory that is kept between calls holds
  if (framed.n >= static_cast<double>(kMany)) {
    const auto sample = sample_in_frame(framed, static_cast<std::size_t>(std::min(framed.n / kPart, kMost)), random);
    Distances d(sample.size());
    FramedPoints kept = as_they_are(sample);
    lean_normal_equations(found.surface, kept, d.data(), KernelSumsWanted::all_but_matrix);
    const UsedBits used = within(d, found.tolerance);
    kept.weights.used = used.data();
    kept.n = static_cast<double>(count_used(used));
    const auto at = lean_normal_equations(found.surface, kept, nullptr, KernelSumsWanted::all);
    const auto newton = newton_step<Surface::kParameters>(at, false);
    // A step longer than the scatter is no refinement.
    if (newton && -newton->x.dot(at.jtd) < at.f) found.surface = Shape::convex(found.surface.moved(newton->x));
  }
  return {surface_in_mm(found.surface, framed), found.tolerance * framed.scale_mm};
}

/// The fast way for scans that show little else than the shape: least squares of a sample, or of a few points of it,
/// repeated without the points beyond 2.5 robust deviations. Believed only where three quarters of the sample agree with
/// a normal scatter that is small against the shape: no other surface can have as many points.
template <class Shape>
std::optional<Consensus<typename Shape::Surface>> quick_consensus(const CentredPoints& points) {
  using Surface = typename Shape::Surface;
  constexpr std::size_t kPoints = 400, kFewest = 100, kFew = 2 * Surface::kParameters + 4;
  constexpr int kTries = 10, kRounds = 20;
  constexpr double kShare = 0.75;
  constexpr double kTail = 3.2;     // of the quantiles 0.9 and 0.5 of |d|: 2.44 for a normal distribution
  constexpr double kScatter = 0.1;  // of the thickness; of a plane's width
  Random random(61);
  const std::vector<Eigen::Vector3d> sample = sample_in_frame(points.framed, kPoints, random);
  if (sample.size() < kFewest) return std::nullopt;
  const UsedBits all = all_used(sample.size());
  for (int attempt = 0; attempt < kTries; ++attempt) {
    std::vector<Eigen::Vector3d> few;
    for (std::size_t i = 0; attempt > 0 && i < kFew; ++i) few.push_back(sample[random.below(sample.size())]);
    std::optional<Surface> surface = Shape::rough_start(attempt == 0 ? sample : few);
    UsedBits used = all;
    Distances d;
    double sigma = 0.0;
    FramedPoints kept = as_they_are(sample);
    for (int round = 0; surface && round < kRounds; ++round) {
      d.resize(sample.size());
      lean_normal_equations(*surface, as_they_are(sample), d.data(), KernelSumsWanted::all_but_matrix);
      sigma = 1.4826 * median_size(d, all);
      UsedBits next = within(d, 2.5 * sigma);
      if (next == used) break;
      used = std::move(next);
      kept.weights.used = used.data();
      kept.n = static_cast<double>(count_used(used));
      if (round == 0) {
        const auto minimum = gauss_newton(*surface, kept, {.max_iterations = 4, .enough = 1e-3});
        if (minimum) surface = Shape::convex(minimum->surface);
        continue;
      }
      // Near by now: a step for each set.
      const auto at = lean_normal_equations(*surface, kept, nullptr, KernelSumsWanted::all);
      const auto newton = newton_step<Surface::kParameters>(at, false);
      if (!newton) break;
      surface = Shape::convex(surface->moved(newton->x));
    }
    if (!surface) continue;
    std::vector<double> sizes;
    std::vector<Eigen::Vector3d> near;
    for (std::size_t i = 0; i < d.size(); ++i) {
      if (!(std::abs(d[i]) <= 3.5 * sigma)) continue;
      sizes.push_back(std::abs(d[i]));
      near.push_back(sample[i]);
    }
    if (static_cast<double>(sizes.size()) < kShare * static_cast<double>(sample.size())) continue;
    std::sort(sizes.begin(), sizes.end());
    if (!(sizes[sizes.size() * 9 / 10] <= kTail * sizes[sizes.size() / 2])) continue;
    const CentredPoints centre = centred(near, {}, near.size());
    const double size2 = centre.axes.values[Surface::kParameters > 3 ? 0 : 1] / centre.framed.n;
    if (!(sigma <= kScatter * centre.framed.scale_mm * std::sqrt(size2))) continue;
    return nearer<Shape>({.surface = *surface, .tolerance = 3.5 * sigma}, points.framed, random);
  }
  return std::nullopt;
}

/// The surface that most points agree on (rejection.h, eq. 1), in mm; nullopt where none stands out from chance.
template <class Shape>
std::optional<Consensus<typename Shape::Surface>> consensus(const CentredPoints& points) {
  using Surface = typename Shape::Surface;
  constexpr std::size_t kPoints = 2000;  // the search costs points x proposals; normals cost points squared
  constexpr int kProposals = 3000, kRefinements = 6;
  Random random(2634);
  const Sample sample = make_sample(sample_in_frame(points.framed, kPoints, random));
  if (sample.points.size() < static_cast<std::size_t>(Surface::kParameters) + 1) return std::nullopt;
  std::optional<Surface> best;
  Support best_support, best_proposed;
  for (int proposal = 0; proposal < kProposals; ++proposal) {
    std::optional<Surface> candidate = Shape::propose(sample, random);
    if (!candidate) continue;
    Distances d = distances<Surface>(sample.points, *candidate);
    Support found = support(d, Surface::kParameters);
    // A proposal through few points is rougher than what it stands for, so each that leads the proposals is refined.
    if (!(found.log_nfa < best_proposed.log_nfa)) continue;
    for (int refinement = 0; refinement < kRefinements; ++refinement) {
      std::vector<Eigen::Vector3d> near;
      for (std::size_t i = 0; i < d.size(); ++i) {
        if (std::abs(d[i]) <= 2.0 * found.tolerance) near.push_back(sample.points[i]);
      }
      if (!Shape::is_round(near, *candidate)) break;
      if (refinement == 0) best_proposed = found;
      if (found.log_nfa < best_support.log_nfa) {
        best = candidate;
        best_support = found;
      }
      const auto minimum = gauss_newton(*candidate, as_they_are(near), {.max_iterations = 20});
      if (!minimum) break;
      d = distances<Surface>(sample.points, minimum->surface);
      const Support again = support(d, Surface::kParameters);
      if (!(again.log_nfa < found.log_nfa)) break;
      candidate = minimum->surface;
      found = again;
    }
  }
  if (!best) return std::nullopt;
  return Consensus<Surface>{surface_in_mm(*best, points.framed), 2.0 * best_support.tolerance * points.framed.scale_mm};
}

/// Eq. 6 of fit.h: weights of mean one, and the variance that a weight of one stands for. Empty where a covariance is
/// not positive along its normal.
struct NormalWeights {
  std::vector<double> weights;
  double variance_mm2 = 1.0;
};
template <class Surface>
NormalWeights normal_weights(Points points_mm, std::span<const Eigen::Matrix3d> covariances_mm2, const UsedBits& used,
                             const Surface& surface) {
  NormalWeights out;
  out.weights.reserve(points_mm.size());
  double sum = 0.0, n = 0.0;
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    const Eigen::Vector3d normal = surface.normal(points_mm[i]);
    const double variance = normal.dot(covariances_mm2[i] * normal);
    if (!(variance > 0.0 && variance < 1e200)) return {};
    out.weights.push_back(1.0 / variance);
    if (!used.empty() && !is_used(used, i)) continue;
    sum += out.weights.back();
    n += 1.0;
  }
  out.variance_mm2 = n / sum;
  for (double& w : out.weights) w *= out.variance_mm2;
  return out;
}

/// A minimum of the frame's lengths in mm: the surface, what belongs to its parameters, and F.
template <class Surface>
Minimum<Surface> minimum_in_mm(const Minimum<Surface>& minimum, const FramedPoints& framed) {
  constexpr int M = Surface::kParameters;
  // Lengths among the parameters: the shift along the normal, and the curvature.
  VectorN<M> units = VectorN<M>::Ones();
  units[0] = framed.scale_mm;
  if (M > 3) units[M - 1] = 1.0 / framed.scale_mm;
  Minimum<Surface> out = minimum;
  out.surface = surface_in_mm(minimum.surface, framed);
  out.inverse_jtj = units.asDiagonal() * minimum.inverse_jtj * units.asDiagonal();
  out.inverse_jtj /= framed.scale_mm * framed.scale_mm;
  out.f *= framed.scale_mm * framed.scale_mm;
  return out;
}

/// The frame of a sample; the axes and sums of squares are those of the sample, which are less than those of all points.
inline CentredPoints centred_by_sample(Points points_mm, const PointWeights& weights, std::size_t n_used) {
  Random random(9);
  const std::vector<Eigen::Vector3d> sample = spread_sample(points_mm, weights, 400, random);
  if (sample.size() < 100) return centred(points_mm, weights, n_used);
  CentredPoints out = centred(sample, {}, sample.size());
  out.framed.points_mm = points_mm;
  out.framed.weights = weights;
  out.framed.n = static_cast<double>(n_used);
  return out;
}

/// A start that is within its sample's scatter brought nearer, by Newton steps with a part of the points in the order
/// they have: with few, then with as many as let quick_descent() end after one or after two passes, where that costs less
/// than a pass. With m points a start is off by M s^2 / m (squared, of the points' size; s: the scatter).
template <class Shape>
std::optional<typename Shape::Surface> by_part(typename Shape::Surface surface, const FramedPoints& framed) {
  constexpr int M = Shape::Surface::kParameters, kSteps = 5;
  constexpr double kFewest = 512.0, kFirstPart = 1.0 / 128.0, kLargestPart = 1.0 / 3.0;
  constexpr double kNear = 0.1;  // of the scatter, squared: from here on a Newton step ends at the sample's minimum
  constexpr double kOnePass2 = 1e-10, kTwoPasses2 = 5e-8;
  const double n = static_cast<double>(framed.points_mm.size());
  double part = std::max(kFewest / n, kFirstPart);
  for (int step = 0; step < kSteps; ++step) {
    FramedPoints some = framed;
    some.of_each_block = std::clamp<std::size_t>((static_cast<std::size_t>(1024.0 * part) + 7) / 8 * 8, 8, 1024);
    const auto at = lean_normal_equations(surface, some, nullptr, KernelSumsWanted::all);
    const auto newton = newton_step<M>(at, false);
    if (!newton) return std::nullopt;
    surface = Shape::convex(surface.moved(newton->x));
    if (!(-newton->x.dot(at.jtd) < kNear * at.f)) continue;
    const double variance = at.f / (part * framed.n);
    double next = 0.0;
    for (const double target2 : {kTwoPasses2, kOnePass2}) {
      const double wanted = M * variance / target2 / framed.n;
      if (wanted <= kLargestPart) next = wanted;
    }
    if (!(next > part)) return surface;
    part = next;
  }
  return std::nullopt;
}

/// solve() for many points that leave no question open; nullopt where they leave one, or are not all finite. start_mm:
/// absent, a start is found.
template <class Shape>
std::optional<Minimum<typename Shape::Surface>> quick_solve(const CentredPoints& points,
                                                            const std::optional<typename Shape::Surface>& start_mm,
                                                            double* distances_mm) {
  using Surface = typename Shape::Surface;
  constexpr std::size_t kFew = 200;  // points of a start
  const FramedPoints& framed = points.framed;
  if (!points.finite || !Shape::why_flat(points).empty()) return std::nullopt;
  Surface surface;
  if (start_mm) {
    surface = surface_in_frame(*start_mm, framed);
  } else {
    const auto start = Shape::start(points, kFew, {});
    if (!start) return std::nullopt;
    const auto there = by_part<Shape>(Shape::convex(*start), framed);
    if (!there) return std::nullopt;
    surface = *there;
  }
  surface = Shape::beside_origin(Shape::convex(surface));
  if (Surface::kParameters == 5 && !is_curled(surface)) return std::nullopt;  // the centroid comes with those sums
  const auto first = lean_normal_equations(surface, framed, nullptr, KernelSumsWanted::all);
  auto minimum = quick_descent(surface, framed, first, distances_mm);
  if (!minimum || !(std::max(minimum->largest_mm, -minimum->smallest_mm) < 1e100)) return std::nullopt;
  if (!Shape::why_undetermined(points, *minimum, {}).empty()) return std::nullopt;
  return minimum_in_mm(Shape::beside_centroid(*minimum), framed);
}

/// The minimum over the points used, in mm. start_mm: absent, a start is found.
template <class Shape>
Result<Minimum<typename Shape::Surface>> solve(const CentredPoints& points, const FitOptions& options,
                                               const std::optional<typename Shape::Surface>& start_mm,
                                               double* distances_mm) {
  using Surface = typename Shape::Surface;
  constexpr int M = Surface::kParameters;
  const FramedPoints& framed = points.framed;
  // Enough to come near; where they happen not to determine the shape, more.
  const std::size_t few = std::clamp<std::size_t>(static_cast<std::size_t>(framed.n) / 50, 300, 3000), many = 20000;
  constexpr double kWorthMany = 200000;  // from here on a descent over `many` costs less than the pass that it saves
  if (std::string why = Shape::why_flat(points); !why.empty()) return unanswerable(std::move(why));
  DescentOptions descent{.max_iterations = options.max_iterations,
                         .hold_curvature = options.fixed_diameter_mm && M > 3,
                         .distances_mm = distances_mm,
                         .start_is_close = M == 3 && points.axes.values[1] > 1e-4 * points.axes.values[2],
                         .start_is_near = (start_mm && M > 3) || framed.n >= kWorthMany};
  const auto descend = [&](const Surface& start) {
    Surface from = Shape::convex(start);
    if (descent.hold_curvature) from = Shape::with_curvature(from, 2.0 * framed.scale_mm / *options.fixed_diameter_mm);
    return gauss_newton(Shape::beside_origin(from), framed, descent);
  };
  const auto nearer = [&](const Surface& start) {
    Random random(7);
    const auto sample = sample_in_frame(framed, many, random);
    const auto there = gauss_newton(start, as_they_are(sample), {.max_iterations = 5, .enough = 1e-7});
    return there ? there->surface : start;
  };
  if constexpr (M == 3) {
    if (!distances_mm && descent.start_is_close) return minimum_in_mm(Shape::minimum_of(points), framed);
  }
  tl::expected<Minimum<Surface>, Descent> minimum = tl::unexpected(Descent::singular);
  // A plane starts at its minimum: the axes.
  if (start_mm && M > 3) minimum = descend(surface_in_frame(*start_mm, framed));
  std::string why;
  for (const std::size_t most : {few, many}) {
    if (minimum || (most == many && !(framed.n > static_cast<double>(few)))) break;
    const auto start = Shape::start(points, most, options);
    if (start) {
      minimum = descend(M > 3 && framed.n >= kWorthMany && !descent.hold_curvature ? nearer(*start) : *start);
    } else {
      why = start.error().sentence;
    }
  }
  if (!minimum && !why.empty()) return unanswerable(std::move(why));
  if (!minimum) return unanswerable(why_no_minimum(minimum.error(), Shape::kName, options.max_iterations));
  minimum->surface = Shape::beside_origin(Shape::convex(minimum->surface));
  why = Shape::why_undetermined(points, *minimum, options);
  if (!why.empty()) return unanswerable(std::move(why));
  return minimum_in_mm(*minimum, framed);
}

template <class Shape>
Result<Associated<typename Shape::Surface>> associate(Points points_mm, const FitOptions& options) {
  using Surface = typename Shape::Surface;
  constexpr int kRounds = 60;    // of rejection; 3 to 10 are usual
  constexpr int kReweights = 8;  // the weights depend on the normals alone, which hardly move
  const int m = Surface::kParameters - (options.fixed_diameter_mm && Surface::kParameters > 3 ? 1 : 0);
  const std::size_t n = points_mm.size();
  const bool has_covariances = !options.covariances_mm2.empty();
  require(!has_covariances || options.covariances_mm2.size() == n, "there is one covariance per point");
  require(!options.fixed_diameter_mm || *options.fixed_diameter_mm > 0.0, "a diameter that is held is positive");
  if (std::string why = why_too_few(n, m, Shape::kName); !why.empty()) return unanswerable(std::move(why));

  const bool many = n >= kMany && Surface::kParameters > 3 && !options.fixed_diameter_mm && !has_covariances;
  CentredPoints points = many ? centred_by_sample(points_mm, {}, n) : centred(points_mm, {}, n);
  if (!points.finite) return unanswerable(why_not_finite(points_mm));
  const double rounding_mm = 16.0 * points.rounding * points.framed.scale_mm;
  Associated<Surface> out;
  FitQuality& quality = out.quality;
  // Rejection goes by the distances, weights leave F to them.
  const bool with_distances =
      options.distances == DistancesWanted::all || options.rejection != Rejection::none || has_covariances;
  if (with_distances) {
    quality.distances_mm.resize(n);
    prefer_huge_pages(quality.distances_mm.data(), n * sizeof(double));
  }
  double* const distances_mm = with_distances ? quality.distances_mm.data() : nullptr;
  UsedBits used, before;  // empty: all; none
  NormalWeights weights;
  std::optional<Surface> start;
  const auto solved = [&](bool others) -> Result<Minimum<Surface>> {  // others: other points or weights than before
    const PointWeights of{used.empty() ? nullptr : used.data(),
                          weights.weights.empty() ? nullptr : weights.weights.data()};
    const std::size_t n_used = used.empty() ? n : count_used(used);
    if (many) {
      if (others) points = centred_by_sample(points_mm, of, n_used);
      if (auto quick = quick_solve<Shape>(points, start, distances_mm)) return *quick;
    }
    if (many || others) points = centred(points_mm, of, n_used);
    if (!points.finite) return unanswerable(why_not_finite(points_mm));
    return solve<Shape>(points, options, start, distances_mm);
  };
  const bool robust = options.rejection == Rejection::robust;
  if (robust) {
    auto found = quick_consensus<Shape>(points);
    if (!found) found = consensus<Shape>(points);
    if (found) {
      start = found->surface;
      FramedPoints all = points.framed;
      all.weights = {};
      const auto sums =
          lean_normal_equations(surface_in_frame(*start, all), all, distances_mm, KernelSumsWanted::all_but_matrix);
      const double farthest_mm = std::max(sums.largest, -sums.smallest);
      if (!(std::isfinite(sums.f) && farthest_mm < 1e100)) return unanswerable(why_not_finite(points_mm));
      used = within(quality.distances_mm, found->tolerance);
      if (n >= kMany && count_used(used) > 0) {
        used = settled_within_robust_deviation(quality.distances_mm, used, rounding_mm);
      }
    }
  }
  int reweights = 0;
  for (int round = 0;; ++round) {
    if (round > 0 || !used.empty()) {  // other points or other weights
      const std::size_t n_used = used.empty() ? n : count_used(used);
      if (std::string why = why_too_few(n_used, m, Shape::kName); !why.empty()) {
        return unanswerable(fmt::format("after rejection {} of {} points are left: {}", n_used, n, why));
      }
    }
    Result<Minimum<Surface>> minimum = solved(round > 0 || !used.empty());
    if (!minimum) {
      if (used.empty() || count_used(used) == n) return tl::unexpected(minimum.error());
      return unanswerable(
          fmt::format("after rejection {} of {} points are left: {}", count_used(used), n, minimum.error().sentence));
    }
    start = minimum->surface;
    out.minimum = *minimum;
    if (has_covariances && reweights < kReweights) {
      NormalWeights next = normal_weights(points_mm, options.covariances_mm2, used, *start);
      if (next.weights.empty())
        return unanswerable("the covariance of a point is not positive along the normal of the surface there");
      double change = reweights == 0 ? 1.0 : 0.0;
      for (std::size_t i = 0; i < weights.weights.size(); ++i) {
        change = std::max(change, std::abs(next.weights[i] / weights.weights[i] - 1.0));
      }
      weights = std::move(next);
      ++reweights;
      if (change > 1e-9) continue;
    }
    const double n_used = points.framed.n;
    double f = minimum->f;
    if (has_covariances) {
      quality.scatter_over_expected = standard_deviation(f / weights.variance_mm2, n_used, m);
      f = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        if (used.empty() || is_used(used, i)) f += quality.distances_mm[i] * quality.distances_mm[i];
      }
    }
    quality.n_used = static_cast<std::size_t>(n_used);
    quality.n_rejected = n - quality.n_used;
    quality.iterations = minimum->iterations;
    quality.rms_mm = std::sqrt(f / n_used);
    quality.standard_deviation_mm = standard_deviation(f, n_used, m);
    if (options.rejection != Rejection::none && round < kRounds) {
      if (used.empty()) used = all_used(n);
      UsedBits next =
          options.rejection == Rejection::vdi_2634
              ? within_three_deviations(quality.distances_mm, quality.standard_deviation_mm)
              : within_robust_deviation(quality.distances_mm, used, rounding_mm, quality.standard_deviation_mm);
      if (next != used && next != before && !(robust && is_settled(used, next))) {
        // Eq. 2 settles on these distances first: a descent costs more than a median.
        if (robust) next = settled_within_robust_deviation(quality.distances_mm, next, rounding_mm);
        before = std::move(used);
        used = std::move(next);
        continue;
      }
    }
    if (options.distances == DistancesWanted::all) {
      quality.max_mm = minimum->largest_mm;
      quality.min_mm = minimum->smallest_mm;
    } else {
      quality.distances_mm = {};
    }
    quality.rejected.assign(n, false);
    for (std::size_t byte = 0; byte < used.size(); ++byte) {
      for (unsigned left = used[byte] ^ 0xffu; left != 0; left &= left - 1) {
        const std::size_t i = 8 * byte + static_cast<std::size_t>(std::countr_zero(left));
        if (i < n) quality.rejected[i] = true;
      }
    }
    const double s = quality.standard_deviation_mm;
    out.covariance = (has_covariances ? weights.variance_mm2 : s * s) * minimum->inverse_jtj;
    return out;
  }
}

/// The standard uncertainty sqrt(g^T V g), or infinite where the scatter is unknown.
template <int M>
double standard_uncertainty(const VectorN<M>& gradient, const MatrixN<M>& covariance) {
  if (!covariance.allFinite()) return std::numeric_limits<double>::infinity();
  return std::sqrt(std::max(0.0, gradient.dot(covariance * gradient)));
}
/// The largest standard uncertainty of the two quantities with the gradients g1, g2, over all directions between them.
template <int M>
double worse_uncertainty(const VectorN<M>& g1, const VectorN<M>& g2, const MatrixN<M>& covariance) {
  if (!covariance.allFinite()) return std::numeric_limits<double>::infinity();
  Eigen::Matrix2d V;
  V << g1.dot(covariance * g1), g1.dot(covariance * g2), g2.dot(covariance * g1), g2.dot(covariance * g2);
  return std::sqrt(std::max(0.0, symmetric_eigen<2>(V).values[1]));
}

/// A direction with its sign such that the largest component is positive.
inline Eigen::Vector3d largest_positive(const Eigen::Vector3d& direction) {
  int largest = 0;
  direction.cwiseAbs().maxCoeff(&largest);
  return direction[largest] < 0.0 ? Eigen::Vector3d(-direction) : direction;
}

/// The sentence of a descent that found no minimum.
std::string why_no_minimum(Descent descent, const char* shape, int max_iterations);

}  // namespace fringecal::fitting

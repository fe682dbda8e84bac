// The common way of fit_plane, fit_sphere and fit_cylinder: check the points, solve, reject, solve again, describe.
//
// A Shape has
//   Surface                                  (surface.h)
//   kName                                    for messages
//   solve(points_mm, max_iterations, start)  the minimum of F in mm, without a guess where start is absent
//   propose(sample, random)                  a surface through few points of a normalised sample
//   is_round(points, surface)                whether the points show the surface's curvature at all
#pragma once

#include "fitting/least_squares.h"
#include "fitting/rejection.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace fringecal::fitting {

template <class Surface>
struct Associated {
  Minimum<Surface> minimum;  // in mm
  FitQuality quality;
  /// Covariance of the surface's parameters: s^2 (J^T J)^-1.
  MatrixN<Surface::kParameters> covariance;
};

/// Distances of all points from a surface.
template <class Surface>
std::vector<double> distances(Points points, const Surface& surface) {
  std::vector<double> out;
  out.reserve(points.size());
  for (const Eigen::Vector3d& p : points) out.push_back(surface.distance(p));
  return out;
}

inline std::vector<Eigen::Vector3d> without(Points points, const std::vector<bool>& rejected) {
  std::vector<Eigen::Vector3d> out;
  out.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!rejected[i]) out.push_back(points[i]);
  }
  return out;
}

/// s of the header of fit.h; infinite where there are only as many points as parameters.
inline double standard_deviation(double f, std::size_t n, int parameters) {
  const double freedom = static_cast<double>(n) - parameters;
  return freedom > 0.0 ? std::sqrt(f / freedom) : std::numeric_limits<double>::infinity();
}

/// A minimum in normalised lengths as one in mm. units: what one of each parameter is in the normalised frame.
template <class Surface>
Minimum<Surface> in_mm(const Minimum<Surface>& minimum, const Normalised& frame,
                       const VectorN<Surface::kParameters>& units) {
  const double s2 = frame.scale_mm * frame.scale_mm;
  return {minimum.surface.transformed(frame.scale_mm, frame.origin_mm),
          units.asDiagonal() * minimum.inverse_jtj * units.asDiagonal() / s2, minimum.f * s2, minimum.iterations};
}

/// The surface that most points agree on (rejection.h, eq. 1), in mm; nullopt where none stands out from chance.
template <class Shape>
std::optional<std::pair<typename Shape::Surface, double>> consensus(Points points_mm) {
  using Surface = typename Shape::Surface;
  constexpr int kProposals = 3000, kRefinements = 6;
  const Normalised frame = normalise(points_mm);
  Random random(2634);
  const Sample sample = make_sample(frame.points, random);
  if (sample.points.size() < static_cast<std::size_t>(Surface::kParameters) + 1) return std::nullopt;
  std::optional<Surface> best;
  Support best_support, best_proposed;
  for (int proposal = 0; proposal < kProposals; ++proposal) {
    std::optional<Surface> candidate = Shape::propose(sample, random);
    if (!candidate) continue;
    std::vector<double> d = distances(sample.points, *candidate);
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
      const auto minimum = gauss_newton(*candidate, near, 20);
      if (!minimum) break;
      d = distances(sample.points, minimum->surface);
      const Support again = support(d, Surface::kParameters);
      if (!(again.log_nfa < found.log_nfa)) break;
      candidate = minimum->surface;
      found = again;
    }
  }
  if (!best) return std::nullopt;
  return std::pair(best->transformed(frame.scale_mm, frame.origin_mm), 2.0 * best_support.tolerance * frame.scale_mm);
}

template <class Shape>
Result<Associated<typename Shape::Surface>> associate(Points points_mm, const FitOptions& options) {
  using Surface = typename Shape::Surface;
  constexpr int M = Surface::kParameters;
  constexpr int kRounds = 60;  // of rejection; 5 to 20 are usual
  if (std::string why = why_unusable(points_mm, M, Shape::kName); !why.empty()) return unanswerable(std::move(why));

  std::vector<bool> rejected(points_mm.size());
  std::optional<Surface> start;
  if (options.rejection == Rejection::robust) {
    if (const auto found = consensus<Shape>(points_mm)) {
      start = found->first;
      for (std::size_t i = 0; i < rejected.size(); ++i) {
        rejected[i] = std::abs(start->distance(points_mm[i])) > found->second;
      }
    }
  }
  for (int round = 0;; ++round) {
    const bool is_all = std::find(rejected.begin(), rejected.end(), true) == rejected.end();
    const std::vector<Eigen::Vector3d> kept = is_all ? std::vector<Eigen::Vector3d>{} : without(points_mm, rejected);
    const Points used = is_all ? points_mm : Points(kept);
    if (std::string why = why_unusable(used, M, Shape::kName); !why.empty()) {
      return unanswerable(
          fmt::format("after rejection {} of {} points are left: {}", used.size(), points_mm.size(), why));
    }
    Result<Minimum<Surface>> minimum = Shape::solve(used, options.max_iterations, start);
    if (!minimum) return tl::unexpected(minimum.error());
    start = minimum->surface;
    Associated<Surface> out{*minimum, {}, {}};
    FitQuality& quality = out.quality;
    quality.distances_mm = distances(points_mm, minimum->surface);
    quality.n_used = used.size();
    quality.n_rejected = points_mm.size() - used.size();
    quality.iterations = minimum->iterations;
    quality.rms_mm = std::sqrt(minimum->f / static_cast<double>(used.size()));
    quality.standard_deviation_mm = standard_deviation(minimum->f, used.size(), M);

    std::vector<bool> next = rejected;
    if (options.rejection == Rejection::vdi_2634) {
      next = beyond_three_deviations(quality.distances_mm, quality.standard_deviation_mm);
    } else if (options.rejection == Rejection::robust) {
      double largest = 0.0;
      for (const Eigen::Vector3d& p : used) largest = std::max(largest, p.cwiseAbs().maxCoeff());
      next = beyond_robust_deviation(quality.distances_mm, rejected,
                                     16.0 * std::numeric_limits<double>::epsilon() * largest);
    }
    if (next != rejected && round < kRounds) {
      rejected = std::move(next);
      continue;
    }
    quality.max_mm = -std::numeric_limits<double>::infinity();
    quality.min_mm = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < rejected.size(); ++i) {
      if (rejected[i]) continue;
      quality.max_mm = std::max(quality.max_mm, quality.distances_mm[i]);
      quality.min_mm = std::min(quality.min_mm, quality.distances_mm[i]);
    }
    quality.rejected = std::move(rejected);
    const double s = quality.standard_deviation_mm;
    out.covariance = s * s * minimum->inverse_jtj;
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

/// The least-squares plane of normalised points as the start of every shape's checks. values[0]: its sum of squares.
SymmetricEigen<3> principal_axes(Points normalised);

/// The sentence of a descent that found no minimum.
std::string why_no_minimum(Descent descent, const char* shape, int max_iterations);

}  // namespace fringecal::fitting

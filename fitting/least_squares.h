// Gauss-Newton for F = sum d_i^2 over the points, and the small dense decompositions that fitting needs (their
// templates are instantiated in least_squares.cpp only: they are slow to compile).
//
//   (J^T J) step = -J^T d                                                                                      (1)
//   step^T J^T J step = the squared length, over all points, of what the step changes in the distances         (2)
// The sums are those of kernels.h. The points are seen centred and of size one (frame_of()), without a copy of them.
#pragma once

#include "core/error.h"
#include "fitting/fit.h"
#include "fitting/kernels.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

namespace fringecal::fitting {

template <int N>
using VectorN = Eigen::Matrix<double, N, 1>;
template <int N>
using MatrixN = Eigen::Matrix<double, N, N>;

/// Eigenvalues in increasing order, with their vectors as columns. N = 2 .. 6.
template <int N>
struct SymmetricEigen {
  VectorN<N> values;
  MatrixN<N> vectors;
};
template <int N>
SymmetricEigen<N> symmetric_eigen(const MatrixN<N>& matrix);

/// The solution of A x = b, refined once (where A is nearly singular its inverse alone leaves errors along the other
/// directions that exceed the step), and the inverse of A, for A symmetric positive definite, after scaling its diagonal to one.
/// nullopt where the smallest eigenvalue of the scaled A is below 1e-10: where it goes to zero with the step, as for points
/// that determine a shape by their second order only, a descent creeps on to 1e-14 and calls that a minimum. N = 3 .. 6.
template <int N>
struct NormalSolution {
  VectorN<N> x;
  MatrixN<N> inverse;
};
template <int N>
std::optional<NormalSolution<N>> solve_normal_equations(const MatrixN<N>& A, const VectorN<N>& b);

/// Points as a fit sees them: x = (p - origin_mm) / scale_mm.
struct FramedPoints {
  Points points_mm;
  PointWeights weights;
  double n = 0.0;                    // points used
  std::size_t of_each_block = 1024;  // less: a sample (kernels.h); n may be about that many only
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  double scale_mm = 1.0;
  Eigen::Vector3d in_frame(const Eigen::Vector3d& p_mm) const { return (p_mm - origin_mm) / scale_mm; }
};

/// Points that are in their frame already.
inline FramedPoints as_they_are(Points points) { return {points, {}, static_cast<double>(points.size())}; }

/// Points seen centred and of rms distance one from their centroid, and their principal axes. Points within 1e-100 mm of
/// one another are one place (scale_mm one, axes zero): squares of such lengths leave the range of double.
struct CentredPoints {
  FramedPoints framed;
  SymmetricEigen<3>
      axes;  // values: sums of squares along the axes, exact for the thinnest set (values[0]: a plane's F)
  /// What rounding of the input coordinates leaves open, in units of scale_mm.
  double rounding = 0.0;
  /// The sum of squares about the best plane, in the points' unit.
  double plane_f() const { return axes.values[0] * framed.scale_mm * framed.scale_mm; }
  bool finite = false;  // every coordinate is a number below 1e100; else nothing else here means anything
};
CentredPoints centred(Points points_mm, const PointWeights& weights, std::size_t n_used);

/// Sum of term(point) over the points; Sum needs +=, term(point, sum) adds one point's part.
template <class Sum, class Term>
Sum blocked_sum(Points points, Sum zero, const Term& term) {
  constexpr std::size_t kBlock = 1024;
  Sum total = zero;
  for (std::size_t first = 0; first < points.size(); first += kBlock) {
    Sum part = zero;
    for (const Eigen::Vector3d& p : points.subspan(first, std::min(kBlock, points.size() - first))) term(p, part);
    total += part;
  }
  return total;
}

template <int M>
struct NormalEquations {
  MatrixN<M> jtj = MatrixN<M>::Zero();
  VectorN<M> jtd = VectorN<M>::Zero();
  double f = 0.0;
  double largest = 0.0, smallest = 0.0;  // distance of a point used, times scale_mm
  double along = 0.0;                    // about a cylinder's axis: sum of w z, z from the anchor
};

template <int M>
NormalEquations<M> sums_of(const KernelSums& sums) {
  NormalEquations<M> out;
  const double* next = sums.sums;
  for (int c = 0; c < M; ++c) {
    for (int r = c; r < M; ++r) out.jtj(r, c) = out.jtj(c, r) = *next++;
  }
  for (int c = 0; c < M; ++c) out.jtd[c] = *next++;
  out.f = *next;
  out.largest = sums.largest;
  out.smallest = sums.smallest;
  return out;
}

/// distances_mm: where not null, receives the distance of every point, used or not.
template <class Surface>
NormalEquations<Surface::kParameters> normal_equations(const Surface& surface, const FramedPoints& points,
                                                       double* distances_mm = nullptr) {
  constexpr int M = Surface::kParameters;
  KernelTask task{Surface::kKernel, points.points_mm, points.weights, points.origin_mm, 1.0 / points.scale_mm};
  task.anchor = surface.anchor;
  task.axes = surface.axes;
  if constexpr (Surface::kKernel != KernelKind::plane) task.k = surface.k;
  task.of_each_block = points.of_each_block;
  task.distances = distances_mm;
  task.distance_unit = points.scale_mm;
  return sums_of<M>(run_kernel(task));
}

/// Whether the sums about the centre keep the digits: the radius is below four times the points' rms distance from their
/// centroid, so that (2) of surface.h costs one digit.
template <class Surface>
bool is_curled(const Surface& surface) {
  if constexpr (Surface::kParameters > 3) return surface.k > 0.25;
  return false;
}

/// normal_equations() without what is not wanted, about the centre where that keeps the digits.
template <class Surface>
NormalEquations<Surface::kParameters> lean_normal_equations(const Surface& surface, const FramedPoints& points,
                                                            double* distances_mm, KernelSumsWanted wanted) {
  constexpr int M = Surface::kParameters;
  KernelTask task{Surface::kKernel, points.points_mm, points.weights, points.origin_mm, 1.0 / points.scale_mm};
  task.axes = surface.axes;
  task.wanted = wanted;
  task.of_each_block = points.of_each_block;
  task.distances = distances_mm;
  task.distance_unit = points.scale_mm;
  NormalEquations<M> out;
  if constexpr (M == 3) {
    task.anchor = surface.anchor;
    out = sums_of<M>(run_kernel(task));
  } else {
    if (!is_curled(surface)) return normal_equations(surface, points, distances_mm);
    task.kind = Surface::kAboutCentre;
    task.anchor = points.scale_mm * surface.centre();
    task.radius_mm = points.scale_mm / surface.k;
    const KernelSums sums = run_kernel(task);
    out = sums_of<M>(sums);
    // Lengths of the frame; the rows 2, 3 of a cylinder are lengths.
    VectorN<M> units = VectorN<M>::Ones();
    if (M == 5) units[2] = units[3] = 1.0 / points.scale_mm;
    const MatrixN<M> T = surface.from_centre() * units.asDiagonal();
    out.jtj = T * out.jtj * T.transpose();
    out.jtd = T * out.jtd / points.scale_mm;
    out.f /= points.scale_mm * points.scale_mm;
    if (M == 5) out.along = sums.sums[M * (M + 3) / 2 + 1] / points.scale_mm;
  }
  return out;
}

/// A surface at the minimum of F. In the units of the frame it was fitted in.
template <class Surface>
struct Minimum {
  Surface surface;
  MatrixN<Surface::kParameters> inverse_jtj;  // zero in the rows and columns of what is held fixed
  double f = 0.0;
  int iterations = 0;
  double largest_mm = 0.0, smallest_mm = 0.0;
  double along = 0.0;  // about a cylinder's axis: mean of w z, z from the anchor, before the last step
};

enum class Descent { singular, not_converged };

struct DescentOptions {
  int max_iterations = 100;
  bool hold_curvature = false;
  double* distances_mm = nullptr;  // as in normal_equations(), at the minimum
  /// Stop where a step changes the distances by less than this (rms, in units of the frame's size).
  double enough = 1e-16;
  /// The start is good to rounding, so the first pass may be the last; then a step of ten roundings is enough.
  bool start_is_close = false;
  /// The start is so near that the second pass may be the last.
  bool start_is_near = false;
};

/// The Newton step of eq. 1; where the curvature (the last parameter) is held, of the others.
template <int M>
std::optional<NormalSolution<M>> newton_step(const NormalEquations<M>& at, bool hold_curvature) {
  if constexpr (M > 3) {
    if (hold_curvature) {
      const auto part =
          solve_normal_equations<M - 1>(at.jtj.template topLeftCorner<M - 1, M - 1>(), -at.jtd.template head<M - 1>());
      if (!part) return std::nullopt;
      NormalSolution<M> out{VectorN<M>::Zero(), MatrixN<M>::Zero()};
      out.x.template head<M - 1>() = part->x;
      out.inverse.template topLeftCorner<M - 1, M - 1>() = part->inverse;
      return out;
    }
  }
  return solve_normal_equations<M>(at.jtj, -at.jtd);
}

/// From a start to the last digits. A step is halved until it lowers F; where F no longer resolves the step (its
/// predicted gain is below 1e-11 F or F's own rounding), until it lowers the length (2) of the step that would follow. It
/// has converged when that can be had no more and the step that is left is small against the scatter, or when a step
/// changes the distances by less than double resolves; where F could still be lowered and no step does it, it has not: F
/// has a kink there (a point on the axis or in the centre). A step below 1e-12 whose successor, at the rate of the last
/// two, is below that is taken without looking again: F and the distances are then those before it, 1e-12 of the points'
/// size away.
template <class Surface>
tl::expected<Minimum<Surface>, Descent> gauss_newton(Surface surface, const FramedPoints& points,
                                                     const DescentOptions& options) {
  constexpr int M = Surface::kParameters;
  constexpr int kHalvings = 30, kHalvingsAtTheEnd = 4;
  constexpr double kBlind2 = 1e-24, kGain = 0.5;
  constexpr double kStationary2 = 1e-8, kRounding2 = 1e-26;  // of F; of n, what rounding can make of a step at most
  const double n = points.n, resolved = options.enough * options.enough * n;
  double* const distances_mm = options.distances_mm;
  NormalEquations<M> at = normal_equations(surface, points, options.start_is_close ? distances_mm : nullptr);
  std::optional<NormalSolution<M>> newton = newton_step<M>(at, options.hold_curvature);
  bool has_distances = options.start_is_close;
  double rate = 1.0;  // of the squared lengths
  const auto done = [&](int iterations) {
    if (distances_mm && !has_distances) normal_equations(surface, points, distances_mm);
    return Minimum<Surface>{surface, newton->inverse, at.f, iterations, at.largest, at.smallest};
  };
  for (int iteration = 0; newton; ++iteration) {
    const double length2 = -newton->x.dot(at.jtd);  // eq. 2
    if (!(length2 > (options.start_is_close && iteration == 0 ? 100.0 * resolved : resolved))) return done(iteration);
    if (rate < 1e-4 && length2 < kBlind2 * n && length2 * rate < std::max(resolved, 1e-32 * n)) {
      surface = surface.moved(newton->x);
      return done(iteration + 1);
    }
    // Where the scatter itself is near rounding, a step is rounding when it is small against the scatter too.
    const bool is_rounding = !(length2 > std::clamp(kStationary2 * at.f, 1e-29 * n, kRounding2 * n));
    // F is a sum of squares of distances that are known to some 4 eps of the frame's size.
    const bool at_the_end = is_rounding || !(length2 > std::max(1e-11 * at.f, 2e-15 * std::sqrt(at.f * n)));
    const bool write = distances_mm && (options.start_is_near || (rate < 1e-4 && length2 * rate < kBlind2 * n));
    const int halvings = is_rounding ? 0 : at_the_end ? kHalvingsAtTheEnd : kHalvings;
    const double enough = is_rounding ? 0.25 : 0.98;  // of length2; slow where the scatter is as large as the radius
    bool better = false;
    VectorN<M> step = newton->x;
    for (int halving = 0; !better && halving <= halvings; ++halving, step *= 0.5) {
      const Surface trial = surface.moved(step);
      const NormalEquations<M> there = normal_equations(trial, points, write ? distances_mm : nullptr);
      if (write) has_distances = false;
      if (!at_the_end && !(there.f < at.f)) continue;
      auto next = newton_step<M>(there, options.hold_curvature);
      const double next2 = next ? -next->x.dot(there.jtd) : 0.0;
      better =
          !at_the_end || (next && (next2 < enough * length2 || (!is_rounding && there.f < at.f - kGain * length2)));
      if (better) {
        has_distances = write;
        surface = trial;
        at = there;
        newton = std::move(next);
        rate = halving == 0 ? next2 / length2 : 1.0;
      }
    }
    const bool is_last = iteration >= options.max_iterations;
    const bool is_stationary = !(length2 > std::max(kStationary2 * at.f, kRounding2 * n));
    if (at_the_end && is_stationary && (!better || is_last)) return done(iteration);
    if (!better || is_last) return tl::unexpected(Descent::not_converged);
  }
  return tl::unexpected(Descent::singular);
}

/// The minimum over many points from a start that is near it: one pass with the matrix J^T J, which is kept, then passes
/// with the gradient alone. Each contracts the step by the rate that the last two show; a step below 3e-9 whose
/// successor is below 1e-14 is taken without looking again: F and the distances are then those before it, 3e-9 of the
/// points' size away at most (less than 1e-5 of their scatter: the step before was below a thousandth), and the matrix
/// that of the start. nullopt where this does not go so quickly.
template <class Surface>
std::optional<Minimum<Surface>> quick_descent(Surface surface, const FramedPoints& points,
                                              const NormalEquations<Surface::kParameters>& first,
                                              double* distances_mm) {
  constexpr int kPasses = 3;
  constexpr double kNear2 = 1e-6, kBlind2 = 1e-17, kResolved2 = 1e-28, kRate = 1e-3;
  constexpr double kFirstIsLast2 = 1e-9;  // a step whose successor, its square, is below kBlind2
  constexpr double kSlower = 10.0;        // than the last: the next rate at most; 4 is seen
  constexpr double kRounding = 1e-12;     // of F
  const double n = points.n;
  const auto newton = newton_step<Surface::kParameters>(first, false);
  if (!newton) return std::nullopt;
  VectorN<Surface::kParameters> step = newton->x;
  double length2 = -step.dot(first.jtd), f = first.f;
  for (int pass = 1; pass <= kPasses; ++pass) {
    if (!(length2 <= kNear2 * n)) return std::nullopt;
    surface = surface.moved(step);
    const bool may_be_last = length2 < kFirstIsLast2 * n;
    const auto there =
        lean_normal_equations(surface, points, may_be_last ? distances_mm : nullptr, KernelSumsWanted::all_but_matrix);
    step = -(newton->inverse * there.jtd);
    const double next2 = -step.dot(there.jtd);
    if (!(there.f <= (1.0 + kRounding) * f + kResolved2 * n && next2 <= std::max(kRate * length2, kResolved2 * n)))
      return std::nullopt;
    if (may_be_last && next2 < kBlind2 * n && next2 * std::min(1.0, kSlower * next2 / length2) < kResolved2 * n) {
      return Minimum<Surface>{surface.moved(step), newton->inverse, there.f,        pass,
                              there.largest,       there.smallest,  there.along / n};
    }
    length2 = next2;
    f = there.f;
  }
  return std::nullopt;
}

}  // namespace fringecal::fitting

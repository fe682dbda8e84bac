// Gauss-Newton for F = sum d_i^2 over the points, and the small dense decompositions that fitting needs (their
// templates are instantiated in least_squares.cpp only: they are slow to compile).
//
//   (J^T J) step = -J^T d                                                                                      (1)
//   step^T J^T J step = the squared length, over all points, of what the step changes in the distances         (2)
// Sums run over blocks of fixed size in the order of the points: the rounding error grows with the block, not with the
// number of points, and the same points give the same bytes.
//
// The points must be normalised (normalise()): centred, and of size one.
#pragma once

#include "core/error.h"
#include "fitting/fit.h"

#include <Eigen/Core>

#include <cmath>
#include <optional>
#include <span>
#include <vector>

namespace fringecal::fitting {

template <int N>
using VectorN = Eigen::Matrix<double, N, 1>;
template <int N>
using MatrixN = Eigen::Matrix<double, N, N>;

/// Eigenvalues in increasing order, with their vectors as columns. N = 2, 3, 4, 5.
template <int N>
struct SymmetricEigen {
  VectorN<N> values;
  MatrixN<N> vectors;
};
template <int N>
SymmetricEigen<N> symmetric_eigen(const MatrixN<N>& matrix);

/// The solution of A x = b and the inverse of A, for A symmetric positive definite, after scaling its diagonal to one.
/// nullopt where the smallest eigenvalue of the scaled A is below 1e-14: to double precision, A is singular. N = 3,
/// 4, 5.
template <int N>
struct NormalSolution {
  VectorN<N> x;
  MatrixN<N> inverse;
};
template <int N>
std::optional<NormalSolution<N>> solve_normal_equations(const MatrixN<N>& A, const VectorN<N>& b);

/// points_mm = origin_mm + scale_mm * points, the points centred and of rms distance one from the origin.
struct Normalised {
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d origin_mm;
  double scale_mm = 1.0;
  /// What rounding of the input coordinates leaves open, in units of scale.
  double rounding = 0.0;
};
Normalised normalise(Points points_mm);

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
  NormalEquations& operator+=(const NormalEquations& other) {
    jtj += other.jtj;
    jtd += other.jtd;
    f += other.f;
    return *this;
  }
};

template <class Surface>
NormalEquations<Surface::kParameters> normal_equations(const Surface& surface, Points points) {
  constexpr int M = Surface::kParameters;
  NormalEquations<M> sum =
      blocked_sum(points, NormalEquations<M>{}, [&](const Eigen::Vector3d& p, NormalEquations<M>& part) {
        VectorN<M> row;
        const double d = surface.linearize(p, row);
        for (int c = 0; c < M; ++c) {
          for (int r = c; r < M; ++r) part.jtj(r, c) += row[r] * row[c];
          part.jtd[c] += row[c] * d;
        }
        part.f += d * d;
      });
  for (int c = 0; c < M; ++c) {
    for (int r = c + 1; r < M; ++r) sum.jtj(c, r) = sum.jtj(r, c);
  }
  return sum;
}

/// A surface at the minimum of F. In the units of the points it was fitted to.
template <class Surface>
struct Minimum {
  Surface surface;
  MatrixN<Surface::kParameters> inverse_jtj;
  double f = 0.0;
  int iterations = 0;
};

enum class Descent { singular, not_converged };

/// From a start to the last digits. A step is halved until it lowers F; where F no longer resolves the step (its
/// predicted gain is below 1e-11 F), until it lowers the length (2) of the step that would follow. It has converged
/// when neither can be had any more, or when the step changes the distances by less than double resolves (1e-16 of the
/// points' size).
template <class Surface>
tl::expected<Minimum<Surface>, Descent> gauss_newton(Surface surface, Points points, int max_iterations) {
  constexpr int M = Surface::kParameters;
  constexpr int kHalvings = 30, kHalvingsAtTheEnd = 4;
  const double n = static_cast<double>(points.size());
  NormalEquations<M> at = normal_equations(surface, points);
  std::optional<NormalSolution<M>> newton = solve_normal_equations<M>(at.jtj, -at.jtd);
  for (int iteration = 0; newton; ++iteration) {
    const double length2 = -newton->x.dot(at.jtd);  // eq. 2
    if (!(length2 > 1e-32 * n)) return Minimum<Surface>{surface, newton->inverse, at.f, iteration};
    const bool is_rounding = !(length2 > 1e-26 * n);
    const bool at_the_end = is_rounding || !(length2 > 1e-11 * at.f);
    const int halvings = is_rounding ? 0 : at_the_end ? kHalvingsAtTheEnd : kHalvings;
    const double enough = is_rounding ? 0.25 : 0.98;  // of length2; slow where the scatter is as large as the radius
    bool better = false;
    VectorN<M> step = newton->x;
    for (int halving = 0; !better && halving <= halvings; ++halving, step *= 0.5) {
      const Surface trial = surface.moved(step);
      const NormalEquations<M> there = normal_equations(trial, points);
      if (at_the_end) {
        auto next = solve_normal_equations<M>(there.jtj, -there.jtd);
        better = next && -next->x.dot(there.jtd) < enough * length2;
        if (better) newton = std::move(next);
      } else {
        better = there.f < at.f;
        if (better) newton = solve_normal_equations<M>(there.jtj, -there.jtd);
      }
      if (better) {
        surface = trial;
        at = there;
      }
    }
    const bool is_last = iteration >= max_iterations;
    if (!better || (is_last && at_the_end)) return Minimum<Surface>{surface, newton->inverse, at.f, iteration};
    if (is_last) return tl::unexpected(Descent::not_converged);
  }
  return tl::unexpected(Descent::singular);
}

}  // namespace fringecal::fitting

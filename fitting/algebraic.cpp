#include "fitting/algebraic.h"

#include <Eigen/Eigenvalues>

#include <cmath>
#include <limits>

namespace fringecal::fitting {

template <int Dim>
std::optional<AlgebraicRound<Dim>> pratt(const MatrixN<Dim + 2>& moments) {
  constexpr int N = Dim + 2;
  const double n = moments(N - 1, N - 1);
  const double size = std::sqrt(moments(0, N - 1) / n);  // rms distance from the origin
  if (!(size > 0.0) || !std::isfinite(size)) return std::nullopt;
  // In units of size: z = (|x|^2 / size^2, x / size, 1)
  VectorN<N> unit = VectorN<N>::Constant(1.0 / size);
  unit[0] = 1.0 / (size * size);
  unit[N - 1] = 1.0;
  const MatrixN<N> M = unit.asDiagonal() * (moments / n) * unit.asDiagonal();
  // N^-1 of eq. 2: the identity for B, -1/2 across for A and C
  MatrixN<N> problem;
  problem.template middleRows<Dim>(1) = M.template middleRows<Dim>(1);
  problem.row(0) = -0.5 * M.row(N - 1);
  problem.row(N - 1) = -0.5 * M.row(0);
  const Eigen::EigenSolver<MatrixN<N>> solver(problem);
  if (solver.info() != Eigen::Success) return std::nullopt;
  int best = -1;
  for (int i = 0; i < N; ++i) {
    const double eta = solver.eigenvalues()[i].real();
    if (eta < -1e-13 * M.trace()) continue;  // the one negative eigenvalue; rounding of a zero is much smaller
    if (best < 0 || eta < solver.eigenvalues()[best].real()) best = i;
  }
  if (best < 0) return std::nullopt;
  const VectorN<N> v = solver.eigenvectors().col(best).real();
  const Eigen::Matrix<double, Dim, 1> B = v.template segment<Dim>(1);
  const double norm2 = B.squaredNorm() - 4.0 * v[0] * v[N - 1];
  if (!(norm2 > 0.0)) return std::nullopt;
  const double norm = std::sqrt(norm2);  // eq. 1
  const double A = v[0] / norm, C = v[N - 1] / norm, b = B.norm() / norm;
  AlgebraicRound<Dim> out;
  out.normal = b > 1e-12 ? Eigen::Matrix<double, Dim, 1>(-B / B.norm()) : Eigen::Matrix<double, Dim, 1>::Unit(0).eval();
  out.anchor =
      size * (2.0 * C / (b + 1.0)) * out.normal;  // A s^2 - b s + C = 0 along the normal, the root near the origin
  out.k = 2.0 * A / size;
  out.f = std::max(0.0, solver.eigenvalues()[best].real()) * n * size * size;
  return out;
}
template std::optional<AlgebraicRound<2>> pratt<2>(const MatrixN<4>&);
template std::optional<AlgebraicRound<3>> pratt<3>(const MatrixN<5>&);

}  // namespace fringecal::fitting

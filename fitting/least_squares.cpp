#include "fitting/least_squares.h"

#include "fitting/surface.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <limits>

namespace fringecal::fitting {

template <int N>
SymmetricEigen<N> symmetric_eigen(const MatrixN<N>& matrix) {
  const Eigen::SelfAdjointEigenSolver<MatrixN<N>> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}
template SymmetricEigen<2> symmetric_eigen<2>(const MatrixN<2>&);
template SymmetricEigen<3> symmetric_eigen<3>(const MatrixN<3>&);
template SymmetricEigen<4> symmetric_eigen<4>(const MatrixN<4>&);
template SymmetricEigen<5> symmetric_eigen<5>(const MatrixN<5>&);

template <int N>
std::optional<NormalSolution<N>> solve_normal_equations(const MatrixN<N>& A, const VectorN<N>& b) {
  const VectorN<N> diagonal = A.diagonal();
  if (!A.allFinite() || !(diagonal.minCoeff() > 0.0)) return std::nullopt;
  const VectorN<N> scaling = diagonal.cwiseSqrt().cwiseInverse();
  const MatrixN<N> scaled = scaling.asDiagonal() * A * scaling.asDiagonal();
  const SymmetricEigen<N> eigen = symmetric_eigen<N>(scaled);
  if (!(eigen.values[0] > 1e-14)) return std::nullopt;
  const MatrixN<N> root = scaling.asDiagonal() * eigen.vectors;
  const MatrixN<N> inverse = root * eigen.values.cwiseInverse().asDiagonal() * root.transpose();
  return NormalSolution<N>{inverse * b, inverse};
}
template std::optional<NormalSolution<3>> solve_normal_equations<3>(const MatrixN<3>&, const VectorN<3>&);
template std::optional<NormalSolution<4>> solve_normal_equations<4>(const MatrixN<4>&, const VectorN<4>&);
template std::optional<NormalSolution<5>> solve_normal_equations<5>(const MatrixN<5>&, const VectorN<5>&);

Normalised normalise(Points points_mm) {
  require(!points_mm.empty(), "normalise() is given points");
  Normalised out;
  const double n = static_cast<double>(points_mm.size());
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const Eigen::Vector3d first =
      points_mm.front();  // the sum of differences keeps the digits that a far offset would take
  out.origin_mm = first + blocked_sum(points_mm, zero, [&](const Eigen::Vector3d& p, Eigen::Vector3d& sum) {
                            sum += p - first;
                          }) / n;
  const double f = blocked_sum(
      points_mm, 0.0, [&](const Eigen::Vector3d& p, double& sum) { sum += (p - out.origin_mm).squaredNorm(); });
  double largest = 0.0;
  for (const Eigen::Vector3d& p : points_mm) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  out.scale_mm = f > 0.0 ? std::sqrt(f / n) : 1.0;
  out.rounding = std::numeric_limits<double>::epsilon() * (largest / out.scale_mm + 1.0);
  out.points.reserve(points_mm.size());
  for (const Eigen::Vector3d& p : points_mm) out.points.push_back((p - out.origin_mm) / out.scale_mm);
  return out;
}

Eigen::Matrix3d axes_with(const Eigen::Vector3d& direction, int column) {
  const Eigen::Vector3d a = direction.normalized();
  int smallest = 0;
  a.cwiseAbs().minCoeff(&smallest);
  const Eigen::Vector3d b = a.cross(Eigen::Vector3d::Unit(smallest)).normalized();
  Eigen::Matrix3d axes;
  axes.col(column) = a;
  axes.col((column + 1) % 3) = b;
  axes.col((column + 2) % 3) = a.cross(b);
  return axes;
}

Eigen::Matrix3d turned(const Eigen::Matrix3d& axes, const Eigen::Vector3d& w) {
  Eigen::Matrix3d out = rotation_from_vector(w).toRotationMatrix() * axes;
  out.col(2).normalize();
  out.col(0) = (out.col(0) - out.col(2).dot(out.col(0)) * out.col(2)).normalized();
  out.col(1) = out.col(2).cross(out.col(0));
  return out;
}

}  // namespace fringecal::fitting

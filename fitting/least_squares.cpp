#include "fitting/least_squares.h"

#include "fitting/surface.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <limits>
#include <numbers>

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
template SymmetricEigen<6> symmetric_eigen<6>(const MatrixN<6>&);

template <int N>
std::optional<NormalSolution<N>> solve_normal_equations(const MatrixN<N>& A, const VectorN<N>& b) {
  const VectorN<N> diagonal = A.diagonal();
  if (!A.allFinite() || !(diagonal.minCoeff() > 0.0)) return std::nullopt;
  const VectorN<N> scaling = diagonal.cwiseSqrt().cwiseInverse();
  const MatrixN<N> scaled = scaling.asDiagonal() * A * scaling.asDiagonal();
  const auto refined = [&](const MatrixN<N>& inverse) {
    const VectorN<N> x = inverse * b;
    return NormalSolution<N>{x + inverse * (b - A * x), inverse};
  };
  // With the trace N the eigenvalues but the smallest have a product below (N / (N - 1))^(N - 1) < e, so the smallest is
  // above the determinant / e: mostly the factors alone, a tenth of the work, show that it is above the limit.
  constexpr double kSmallest = 1e-10;
  const Eigen::LLT<MatrixN<N>> factors(scaled);
  if (factors.info() == Eigen::Success &&
      std::pow(factors.matrixLLT().diagonal().prod(), 2) > std::numbers::e * kSmallest) {
    const MatrixN<N> root = factors.matrixL().solve(MatrixN<N>(scaling.asDiagonal()));
    const MatrixN<N> inverse = root.transpose() * root;
    return refined(inverse);
  }
  const SymmetricEigen<N> eigen = symmetric_eigen<N>(scaled);
  if (!(eigen.values[0] > kSmallest)) return std::nullopt;
  const MatrixN<N> root = scaling.asDiagonal() * eigen.vectors;
  const MatrixN<N> inverse = root * eigen.values.cwiseInverse().asDiagonal() * root.transpose();
  return refined(inverse);
}
template std::optional<NormalSolution<3>> solve_normal_equations<3>(const MatrixN<3>&, const VectorN<3>&);
template std::optional<NormalSolution<4>> solve_normal_equations<4>(const MatrixN<4>&, const VectorN<4>&);
template std::optional<NormalSolution<5>> solve_normal_equations<5>(const MatrixN<5>&, const VectorN<5>&);
template std::optional<NormalSolution<6>> solve_normal_equations<6>(const MatrixN<6>&, const VectorN<6>&);

namespace {

/// Mean and scatter of the points in the frame of a task (kernels.h, eq. 3).
struct Moments {
  Eigen::Vector3d mean;
  Eigen::Matrix3d scatter;  // about the mean
  double largest = 0.0;
};
Moments moments_of(const KernelTask& task, double n) {
  const KernelSums k = run_kernel(task);
  const double* s = k.sums;
  Moments out;
  out.mean = Eigen::Vector3d(s[0], s[1], s[2]) / n;
  out.scatter << s[3], s[4], s[5], s[4], s[6], s[7], s[5], s[7], s[8];
  out.scatter -= n * out.mean * out.mean.transpose();
  out.largest = k.largest;
  return out;
}

}  // namespace

CentredPoints centred(Points points_mm, const PointWeights& weights, std::size_t n_used) {
  require(!points_mm.empty() && n_used > 0, "centred() is given points");
  constexpr std::size_t kFew = 16;      // whose mean lies well enough inside the others
  constexpr double kSmallest = 1e-100;  // mm
  const double n = static_cast<double>(n_used);
  CentredPoints out;
  out.framed = {points_mm, weights, n};
  Eigen::Vector3d near = Eigen::Vector3d::Zero();
  const std::size_t few = std::min(kFew, points_mm.size());
  const auto some = [&](std::size_t i) -> const Eigen::Vector3d& { return points_mm[i * points_mm.size() / few]; };
  for (std::size_t i = 0; i < few; ++i) near += (some(i) - points_mm[0]) / static_cast<double>(few);
  near += points_mm[0];
  if (!near.allFinite() || !(near.cwiseAbs().maxCoeff() <= 1e100)) return out;
  KernelTask task{KernelKind::moments_mm, points_mm, weights, near};
  const Moments rough = moments_of(task, n);
  const double farthest_mm = near.cwiseAbs().maxCoeff() + rough.largest;
  out.finite = rough.mean.allFinite() && rough.scatter.allFinite() && farthest_mm <= 1e100;
  if (!out.finite) return out;
  out.framed.origin_mm = near + rough.mean;
  const double rms_mm = std::sqrt(std::max(0.0, rough.scatter.trace()) / n);
  out.framed.scale_mm = rms_mm > kSmallest ? rms_mm : 1.0;
  out.rounding = std::numeric_limits<double>::epsilon() * (farthest_mm / out.framed.scale_mm + 1.0);
  out.axes = symmetric_eigen<3>(rms_mm > kSmallest ? Eigen::Matrix3d(rough.scatter / (rms_mm * rms_mm))
                                                   : Eigen::Matrix3d::Zero());
  // An eigenvalue is good to eps of the largest one, so a thickness only to 1e-8 of the size; along the axes it is
  // exact. 1e-8: a thickness good to four digits.
  if (!(out.axes.values[0] > 1e-8 * out.axes.values[2])) {
    task.kind = KernelKind::moments;
    task.origin_mm = out.framed.origin_mm;
    task.inverse_scale = 1.0 / out.framed.scale_mm;
    task.axes = out.axes.vectors;
    out.axes.values = moments_of(task, n).scatter.diagonal();
  }
  out.axes.values = out.axes.values.cwiseMax(0.0);
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

// The surfaces while they are being fitted: an anchor point o on the surface, orthonormal axes there, and the curvature
// k = 1 / r. With u = p - o, x = u . n (n: the surface normal that points to the centre), q = the squared distance from
// o (cylinder: without the part along the axis), the signed orthogonal distance of a point is
//   A = k q - 2 x,   D = sqrt(1 + k A) = k |p - centre|,   d = A / (1 + D)  (= |p - centre| - r for k > 0)          (1)
// after [LukacsMarshallMartin1998]. The form holds through k = 0 (a plane), so a small cap or sector of a large radius
// is fitted as well conditioned as a full one; no large nearly equal numbers are subtracted.
//
// Every surface has: kParameters; distance(p); linearize(p, row), which also gives d(distance)/d(parameters);
// moved(step), the surface after a small step of the parameters; and transformed(scale, offset), the surface carried by
// x -> scale x + offset. The parameters are local to the surface they belong to, so no direction is special.
#pragma once

#include "core/rigid.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

namespace fringecal::fitting {

/// Right-handed orthonormal axes with `direction` as the given column.
Eigen::Matrix3d axes_with(const Eigen::Vector3d& direction, int column);

/// axes turned by the rotation vector w (in the same frame as the axes), orthonormal to the last digit.
Eigen::Matrix3d turned(const Eigen::Matrix3d& axes, const Eigen::Vector3d& w);

namespace detail {
/// Eq. 1: D and d from A and k.
struct Curved {
  double d, D, dd_dk;
  Curved(double A, double q, double k) {
    D = std::sqrt(std::max(0.0, 1.0 + k * A));
    d = A / (1.0 + D);
    // d(d)/dk at fixed u: A/(1 + D) with dA/dk = q and dD/dk = (A + k q) / (2 D)
    const double divisor = std::max(D, 1e-150);
    dd_dk = q / (1.0 + D) - A * (A + k * q) / (2.0 * divisor * (1.0 + D) * (1.0 + D));
    D = divisor;
  }
};
inline double curved_distance(double A, double k) { return A / (1.0 + std::sqrt(std::max(0.0, 1.0 + k * A))); }
}  // namespace detail

/// d = n . (p - o). Parameters: shift along n, tilts of n towards the first and second axis.
struct PlaneSurface {
  static constexpr int kParameters = 3;
  using Row = Eigen::Matrix<double, 3, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // third column: n

  double distance(const Eigen::Vector3d& p) const { return axes.col(2).dot(p - anchor); }
  double linearize(const Eigen::Vector3d& p, Row& row) const {
    const Eigen::Vector3d u = p - anchor;
    row << -1.0, axes.col(0).dot(u), axes.col(1).dot(u);
    return axes.col(2).dot(u);
  }
  PlaneSurface moved(const Row& step) const {
    return {anchor + step[0] * axes.col(2), turned(axes, step[1] * axes.col(1) - step[2] * axes.col(0))};
  }
  PlaneSurface transformed(double scale, const Eigen::Vector3d& offset) const {
    return {scale * anchor + offset, axes};
  }
};

/// Parameters: shift along n, tilts of n towards the first and second axis, k.
struct SphereSurface {
  static constexpr int kParameters = 4;
  using Row = Eigen::Matrix<double, 4, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // third column: n
  double k = 0.0;

  double distance(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d u = p - anchor;
    return detail::curved_distance(k * u.squaredNorm() - 2.0 * axes.col(2).dot(u), k);
  }
  double linearize(const Eigen::Vector3d& p, Row& row) const {
    const Eigen::Vector3d u = axes.transpose() * (p - anchor);
    const double q = u.squaredNorm();
    const detail::Curved c(k * q - 2.0 * u.z(), q, k);
    row << (1.0 - k * u.z()) / c.D, -u.x() / c.D, -u.y() / c.D, c.dd_dk;
    return c.d;
  }
  SphereSurface moved(const Row& step) const {
    return {anchor + step[0] * axes.col(2), turned(axes, step[1] * axes.col(1) - step[2] * axes.col(0)), k + step[3]};
  }
  SphereSurface transformed(double scale, const Eigen::Vector3d& offset) const {
    return {scale * anchor + offset, axes, k / scale};
  }
};

/// Axes: n, b = a x n, a (the direction of the axis). Parameters: shift along n, turn about a, tilt of a towards n,
/// tilt of a towards b, k.
struct CylinderSurface {
  static constexpr int kParameters = 5;
  using Row = Eigen::Matrix<double, 5, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double k = 0.0;

  double distance(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d u = p - anchor;
    const double x = axes.col(0).dot(u), y = axes.col(1).dot(u);
    return detail::curved_distance(k * (x * x + y * y) - 2.0 * x, k);
  }
  double linearize(const Eigen::Vector3d& p, Row& row) const {
    const Eigen::Vector3d u = axes.transpose() * (p - anchor);
    const double q = u.x() * u.x() + u.y() * u.y();
    const detail::Curved c(k * q - 2.0 * u.x(), q, k);
    const double along_n = (1.0 - k * u.x()) / c.D;
    row << along_n, -u.y() / c.D, along_n * u.z(), -k * u.y() * u.z() / c.D, c.dd_dk;
    return c.d;
  }
  CylinderSurface moved(const Row& step) const {
    const Eigen::Vector3d w = step[1] * axes.col(2) + step[2] * axes.col(1) - step[3] * axes.col(0);
    return {anchor + step[0] * axes.col(0), turned(axes, w), k + step[4]};
  }
  CylinderSurface transformed(double scale, const Eigen::Vector3d& offset) const {
    return {scale * anchor + offset, axes, k / scale};
  }
  /// The same cylinder with the anchor at the height of `point` along the axis.
  CylinderSurface anchored_beside(const Eigen::Vector3d& point) const {
    return {anchor + axes.col(2).dot(point - anchor) * axes.col(2), axes, k};
  }
};

}  // namespace fringecal::fitting

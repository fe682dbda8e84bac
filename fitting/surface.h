// The surfaces while they are being fitted: an anchor point o on the surface, orthonormal axes there, and the curvature
// k = 1 / r. With u = p - o, x = u . n (n: the surface normal that points to the centre), q = the squared distance from
// o (cylinder: without the part along the axis), the signed orthogonal distance of a point is
//   A = k q - 2 x,   D = sqrt(1 + k A) = k |p - centre|,   d = A / (1 + D)  (= |p - centre| - r for k > 0)          (1)
// after [LukacsMarshallMartin1998]. The form holds through k = 0 (a plane), so a small cap or sector of a large radius
// is fitted as well conditioned as a full one; no large nearly equal numbers are subtracted.
//
// Its derivatives by the parameters (kernels.cpp) follow from dA/dk = q and dD/dk = (A + k q) / (2 D). From the sums about
// the centre o + n / k (kernels.h, eq. 4), of rows g, those of the same derivatives J are
//   J = T g                                                                                                        (2)
// which loses a factor of 1 / k^2 (in units of the points' size) of the digits.
//
// Every surface has: kParameters; kKernel, the sums over points (kernels.h); distance(p); moved(step), the surface after
// a small step of the parameters; transformed(scale, offset), the surface carried by x -> scale x + offset; and
// normal(p), the direction of the distance. The parameters are local to the surface they belong to, so no direction is
// special.
#pragma once

#include "core/rigid.h"
#include "fitting/kernels.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

namespace fringecal::fitting {

/// Right-handed orthonormal axes with `direction` as the given column.
Eigen::Matrix3d axes_with(const Eigen::Vector3d& direction, int column);

/// axes turned by the rotation vector w (in the same frame as the axes), orthonormal to the last digit.
Eigen::Matrix3d turned(const Eigen::Matrix3d& axes, const Eigen::Vector3d& w);

namespace detail {
/// Eq. 1: d from A and k.
inline double curved_distance(double A, double k) { return A / (1.0 + std::sqrt(std::max(0.0, 1.0 + k * A))); }
}  // namespace detail

/// d = n . (p - o). Parameters: shift along n, tilts of n towards the first and second axis.
struct PlaneSurface {
  static constexpr int kParameters = 3;
  static constexpr KernelKind kKernel = KernelKind::plane;
  using Row = Eigen::Matrix<double, 3, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // third column: n

  double distance(const Eigen::Vector3d& p) const { return axes.col(2).dot(p - anchor); }
  Eigen::Vector3d normal(const Eigen::Vector3d&) const { return axes.col(2); }
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
  static constexpr KernelKind kKernel = KernelKind::sphere;
  using Row = Eigen::Matrix<double, 4, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // third column: n
  double k = 0.0;

  double distance(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d u = p - anchor;
    return detail::curved_distance(k * u.squaredNorm() - 2.0 * axes.col(2).dot(u), k);
  }
  Eigen::Vector3d normal(const Eigen::Vector3d& p) const { return (k * (p - anchor) - axes.col(2)).normalized(); }
  SphereSurface moved(const Row& step) const {
    return {anchor + step[0] * axes.col(2), turned(axes, step[1] * axes.col(1) - step[2] * axes.col(0)), k + step[3]};
  }
  static constexpr KernelKind kAboutCentre = KernelKind::sphere_centre;
  Eigen::Vector3d centre() const { return anchor + axes.col(2) / k; }
  /// T of eq. 2.
  Eigen::Matrix4d from_centre() const {
    Eigen::Matrix4d T = Eigen::Matrix4d::Zero();
    T.block<1, 3>(0, 0) = -axes.col(2).transpose();
    T.block<1, 3>(1, 0) = -axes.col(0).transpose() / k;
    T.block<1, 3>(2, 0) = -axes.col(1).transpose() / k;
    T.row(3) << axes.col(2).transpose() / (k * k), 1.0 / (k * k);
    return T;
  }
  SphereSurface transformed(double scale, const Eigen::Vector3d& offset) const {
    return {scale * anchor + offset, axes, k / scale};
  }
};

/// Axes: n, b = a x n, a (the direction of the axis). Parameters: shift along n, turn about a, tilt of a towards n,
/// tilt of a towards b, k.
struct CylinderSurface {
  static constexpr int kParameters = 5;
  static constexpr KernelKind kKernel = KernelKind::cylinder;
  using Row = Eigen::Matrix<double, 5, 1>;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double k = 0.0;

  double distance(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d u = p - anchor;
    const double x = axes.col(0).dot(u), y = axes.col(1).dot(u);
    return detail::curved_distance(k * (x * x + y * y) - 2.0 * x, k);
  }
  Eigen::Vector3d normal(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d u = p - anchor;
    return (k * (u - axes.col(2).dot(u) * axes.col(2)) - axes.col(0)).normalized();
  }
  CylinderSurface moved(const Row& step) const {
    const Eigen::Vector3d w = step[1] * axes.col(2) + step[2] * axes.col(1) - step[3] * axes.col(0);
    return {anchor + step[0] * axes.col(0), turned(axes, w), k + step[4]};
  }
  static constexpr KernelKind kAboutCentre = KernelKind::cylinder_axis;
  Eigen::Vector3d centre() const { return anchor + axes.col(0) / k; }
  /// T of eq. 2.
  Eigen::Matrix<double, 5, 5> from_centre() const {
    Eigen::Matrix<double, 5, 5> T = Eigen::Matrix<double, 5, 5>::Zero();
    T.diagonal() << -1.0, -1.0 / k, -1.0, -1.0, 1.0 / (k * k);
    T(4, 0) = 1.0 / (k * k);
    return T;
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

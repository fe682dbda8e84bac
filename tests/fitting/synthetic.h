// Points with an exactly known least-squares surface. Each place of the surface gives two points, at +delta and -delta
// along the normal there: both have the same row in the Jacobian, so J^T d = 0 at the surface itself, and F = n
// delta^2.
#pragma once

#include "fitting/rejection.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>
#include <vector>

namespace fringecal::fitting {

using Cloud = std::vector<Eigen::Vector3d>;

inline double uniform(Random& random) { return static_cast<double>(random.next() >> 11) * 0x1p-53; }
inline double normal(Random& random) {  // Box-Muller
  const double u = 1.0 - uniform(random), v = uniform(random);
  return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
}

inline void add_pair(Cloud& cloud, const Eigen::Vector3d& place, const Eigen::Vector3d& outward, double delta_mm) {
  cloud.push_back(place + delta_mm * outward);
  cloud.push_back(place - delta_mm * outward);
}

/// A cap of the half-angle, its pole along `pole`.
inline Cloud sphere_cap(const Eigen::Vector3d& center, double radius, const Eigen::Vector3d& pole,
                        double half_angle_rad, double delta) {
  Cloud cloud;
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), pole);
  for (int i = 0; i < 120; ++i) {
    const double z = 1.0 - (1.0 - std::cos(half_angle_rad)) * (i + 0.5) / 120.0, angle = 2.399963 * i;
    const double across = std::sqrt(std::max(0.0, 1.0 - z * z));
    const Eigen::Vector3d n = turn * Eigen::Vector3d(across * std::cos(angle), across * std::sin(angle), z);
    add_pair(cloud, center + radius * n, n, delta);
  }
  return cloud;
}

/// A sector of the angle (rad) about an axis.
inline Cloud cylinder_sector(const Eigen::Vector3d& point, const Eigen::Vector3d& axis, double radius, double length,
                             double angle_rad, double delta) {
  Cloud cloud;
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), axis);
  for (int i = 0; i < 12; ++i) {
    for (int k = 0; k < 15; ++k) {
      // the columns are shifted against one another: a grid would let parallel lines look like a second solution
      const double turn_rad = angle_rad * ((k + 0.5 + 0.3 * std::sin(1.0 + i)) / 15.0 - 0.5);
      const Eigen::Vector3d n = turn * Eigen::Vector3d(std::cos(turn_rad), std::sin(turn_rad), 0.0);
      add_pair(cloud, point + turn * Eigen::Vector3d(0, 0, length * ((i + 0.5) / 12.0 - 0.5)) + radius * n, n, delta);
    }
  }
  return cloud;
}

inline double distance_from_axis(const Eigen::Vector3d& p, const Eigen::Vector3d& point, const Eigen::Vector3d& axis) {
  return axis.cross(p - point).norm();
}

}  // namespace fringecal::fitting

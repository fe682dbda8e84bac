// Rigid3: a rotation and a translation between two named frames, b_from_a * x_in_a == x_in_b.
// Right-handed, lengths in mm. Adjacent names must match: c_from_b * b_from_a == c_from_a.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace fringecal {

struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& point_mm) const { return rotation * point_mm + translation_mm; }
  Rigid3 operator*(const Rigid3& other) const {
    return {(rotation * other.rotation).normalized(), rotation * other.translation_mm + translation_mm};
  }
  Rigid3 inverse() const {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * translation_mm)};
  }
  Eigen::Matrix3d rotation_matrix() const { return rotation.toRotationMatrix(); }
};

/// Rotation by |w| radians about w (Rodrigues' formula).
inline Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  if (angle < 1e-12) return Eigen::Quaterniond(1.0, 0.5 * w.x(), 0.5 * w.y(), 0.5 * w.z()).normalized();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle));
}

/// The rotation vector of a rotation, its length in [0, pi].
inline Eigen::Vector3d vector_from_rotation(const Eigen::Quaterniond& rotation) {
  const Eigen::AngleAxisd a(rotation);
  return a.angle() * a.axis();
}

}  // namespace fringecal

#include "core/error.h"
#include "fitting/fit.h"

#include <fmt/format.h>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <cmath>
#include <limits>

namespace fringecal::fitting {

Result<RigidFit> fit_rigid(Points points_in_a_mm, Points points_in_b_mm) {
  require(points_in_a_mm.size() == points_in_b_mm.size(), "fit_rigid() is given as many points in b as in a");
  const std::size_t n = points_in_a_mm.size();
  if (n < 3) return unanswerable(fmt::format("a rigid alignment needs at least 3 pairs of points and there are {}", n));
  Eigen::Vector3d a0 = Eigen::Vector3d::Zero(), b0 = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) {
    if (!points_in_a_mm[i].allFinite() || !points_in_b_mm[i].allFinite()) {
      return unanswerable(
          fmt::format("pair {} of {} has a coordinate that is not finite; remove invalid points", i + 1, n));
    }
    a0 += points_in_a_mm[i] - points_in_a_mm[0];
    b0 += points_in_b_mm[i] - points_in_b_mm[0];
  }
  a0 = points_in_a_mm[0] + a0 / static_cast<double>(n);
  b0 = points_in_b_mm[0] + b0 / static_cast<double>(n);
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  double size_a = 0.0, size_b = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d a = points_in_a_mm[i] - a0, b = points_in_b_mm[i] - b0;
    cross += b * a.transpose();  // [Umeyama1991, eq. 38]
    size_a += a.squaredNorm();
    size_b += b.squaredNorm();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  // The rotation about a line through all points is open: two singular values vanish.
  if (!(svd.singularValues()[1] > 1e-12 * std::sqrt(size_a * size_b))) {
    return unanswerable(
        fmt::format("the {} pairs of points lie on one line, so the rotation about it is open; use points to its "
                    "sides too",
                    n));
  }
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0)
    sign[2] = -1.0;  // [Umeyama1991, eq. 39]: no mirror
  RigidFit out;
  out.rotation = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();  // [Umeyama1991, eq. 40]
  out.translation_mm = b0 - out.rotation * a0;                                   // [Umeyama1991, eq. 41]
  double f = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    f += (out.rotation * (points_in_a_mm[i] - a0) - (points_in_b_mm[i] - b0)).squaredNorm();
  }
  out.rms_mm = std::sqrt(f / static_cast<double>(n));
  return out;
}

}  // namespace fringecal::fitting

// The sums over all points that a fit needs, vectorised (Highway, run-time dispatch) and on all threads.
//
// A point p is seen in the frame of a surface (surface.h): u = axes^T ((p - origin) / scale - anchor). Differences from
// the origin come first, so that data far away lose no digit that their coordinates have.            (1)
// Sums of the surface's row J (surface.h, eq. 1) and distance d, weight w (one where none is given):
//   jtj = sum w J J^T (lower triangle, column by column),  jtd = sum w J d,  f = sum w d^2             (2)
// Moments: sum w u, sum w u u^T (xx, yx, zx, yy, zy, zz); those in mm: of u = p - origin, half the work.  (3)
// About the centre, for radii that are not long against the points: v = p - origin - anchor in mm (cylinder: v =
// axes^T (p - origin - anchor), the third component z along the axis), s = |v| across the axis, n = v / s, d = s - radius,
//   sphere J = (n, 1),  cylinder J = (n1, n2, z n1, z n2, 1)                                           (4)
// and the sums (2), for the cylinder sum w z after them: a third of the operations less.
//
// The same points give the same bytes on every machine, whatever its vector width and the number of threads: eight
// running sums, added in a fixed order after each block of 1024 points, blocks in the order of the points, no fused
// multiply-add. The rounding error of a sum grows with the block, not with the number of points.
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <span>

namespace fringecal::fitting {

enum class KernelKind { moments, moments_mm, plane, sphere, cylinder, sphere_centre, cylinder_axis };

/// Which of the sums (2); the matrix is most of the work where there is little else.
enum class KernelSumsWanted { all, all_but_matrix };

/// Which points count and how much. Both absent: all, equally.
struct PointWeights {
  /// Bit i % 8 of byte i / 8: point i is used. At least (n + 7) / 8 bytes, or null.
  const std::uint8_t* used = nullptr;
  /// One weight per point, or null.
  const double* weights = nullptr;
};

struct KernelTask {
  KernelKind kind = KernelKind::plane;
  std::span<const Eigen::Vector3d> points_mm;
  PointWeights weights;
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  double inverse_scale = 1.0;
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double k = 0.0;
  double radius_mm = 0.0;                           // eq. 4
  KernelSumsWanted wanted = KernelSumsWanted::all;  // the matrix is left out of plane and eq. 4 only
  /// Points that count of each block of 1024, the first ones: a multiple of 8 below 1024 for a sample.
  std::size_t of_each_block = 1024;
  /// Where given: the distance of every point, used or not, times distance_unit; eq. 4: in mm.
  double* distances = nullptr;
  double distance_unit = 1.0;
};

/// Up to 22 sums (eq. 2 in the order jtj, jtd, f; eq. 3) and the extremes of d (eq. 2, times distance_unit) or of the
/// largest component of u (eq. 3), over the points used.
struct KernelSums {
  static constexpr int kMost = 22;
  double sums[kMost] = {};
  double largest = -1e300, smallest = 1e300;
};

KernelSums run_kernel(const KernelTask& task);

}  // namespace fringecal::fitting

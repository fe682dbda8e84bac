// Gaussian (orthogonal distance) least squares of plane, sphere, cylinder, line and circle, without an initial guess.
//
// Minimised is F = sum w_i d_i^2, d_i the (signed) orthogonal distance of point i from the surface or curve:
//   plane     d = n . (p - c)                                                              (1)
//   sphere    d = |p - c| - r                                                              (2)
//   cylinder  d = |(p - c) x a| - r,  |a| = 1                                              (3)
//   line      d^2 = |(p - c) x a|^2                                                        (4)
//   circle    d^2 = (|(p - c) x n| - r)^2 + (n . (p - c))^2                                (5)
// w_i = 1, or from the points' covariances V_i: w_i = 1 / (n_i^T V_i n_i), n_i the surface's normal at the point. (6)
// This is the "Gaussian associated feature" of ISO 14405-1 and ISO 10360-6 and what NIST's and PTB's reference data
// certify. [Shakarji1998] [Forbes1991]
//
// Points in mm, any frame, any order. The result moves with its points. Standard uncertainties follow from the Jacobian
// at the solution and the residual scatter s^2 = F / (n - m), m the number of parameters (plane 3, sphere 4, cylinder
// 5, line 4, circle 6; one less where the diameter is held); they take the point errors as independent, equal and along
// the normal. With exactly as many points as parameters nothing is left to judge the scatter by: standard_deviation_mm
// and every u_... are then +infinity. With covariances (eq. 6) the uncertainties follow from these alone. Errors that
// neighbours share: noise.h.
//
// Fewer points than parameters, points that are not finite, or points that do not determine the shape: no result, one
// sentence why. Nor where two different cylinders fit few points equally well.
// Any offset, scale and number of points (tried: 3 to 1e7); memory beyond the points is 8 bytes a point, for the
// distances where they are wanted, and as much again while points are rejected. The same points give the same bytes whatever the number of
// threads and the width of the processor's vectors.
#pragma once

#include "core/result.h"

#include <Eigen/Core>

#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace fringecal::fitting {

using Points = std::span<const Eigen::Vector3d>;

/// How points are rejected. Every rule starts from the fit to all (or to the consensus) and repeats until the set is
/// settled (rejection.h).
enum class Rejection {
  none,
  /// VDI/VDE 2634: at most 0.3 % of the points, those farthest out, and only beyond 3 s.
  vdi_2634,
  /// Raw scans with posts, bases and background: the surface that most points agree on is found first, then points
  /// beyond 3.5 robust standard deviations (MAD based) of it are left out.
  robust,
};

/// Whether the distance of every point is wanted, or the surface with its uncertainties alone: then a plane's points are
/// read once, its scatter comes from their moments (good to 1e-8 of itself), and no memory is needed.
enum class DistancesWanted { all, none };

struct FitOptions {
  Rejection rejection = Rejection::none;
  DistancesWanted distances = DistancesWanted::all;
  int max_iterations = 100;  // Gauss-Newton; well-posed data need 4 to 8
  /// Sphere and cylinder: the diameter is known and held. Absent: fitted.
  std::optional<double> fixed_diameter_mm = std::nullopt;
  /// Eq. 6: one covariance per point, symmetric, positive along the surface's normal. Empty: all points alike.
  std::span<const Eigen::Matrix3d> covariances_mm2 = {};
};

/// std::vector<double> whose elements are not set to zero before they are written: at a million points that costs as
/// much as a pass of the fit.
template <class T>
struct LeaveUnset : std::allocator<T> {
  template <class U>
  struct rebind {
    using other = LeaveUnset<U>;
  };
  template <class U>
  void construct(U* place) {
    ::new (static_cast<void*>(place)) U;
  }
  template <class U, class... Args>
  void construct(U* place, Args&&... args) {
    ::new (static_cast<void*>(place)) U(std::forward<Args>(args)...);
  }
};
using Distances = std::vector<double, LeaveUnset<double>>;

/// How a fit came about. u_...: standard uncertainties, k = 1.
struct FitQuality {
  double rms_mm = 0;                 // sqrt(F / n), every point used counting alike
  double standard_deviation_mm = 0;  // sqrt(F / (n - m)): the form standard deviation of the paper's section 4
  /// sqrt(F / (n - m)) with the weights of eq. 6: one where the covariances describe the scatter.
  std::optional<double> scatter_over_expected;
  /// Largest and smallest signed distance of a point used. Absent with DistancesWanted::none.
  std::optional<double> max_mm, min_mm;
  std::size_t n_used = 0, n_rejected = 0;
  int iterations = 0;
  Distances distances_mm;      // of every point given, rejected ones included, as ordered; empty where none are wanted
  std::vector<bool> rejected;  // as ordered
};

struct PlaneFit {
  Eigen::Vector3d point_mm;  // centroid of the points used
  Eigen::Vector3d normal;    // unit; its largest component is positive
  double u_offset_mm = 0;    // along the normal, at point_mm
  double u_tilt_rad = 0;     // of the normal, in the worse of its two directions
  FitQuality quality;
};

struct SphereFit {
  Eigen::Vector3d center_mm;
  double diameter_mm = 0;
  Eigen::Vector3d u_center_mm;
  double u_diameter_mm = 0;
  /// u_diameter_mm in units of what as many points all over the sphere would give, 2 s / sqrt(n): 1 for a whole sphere,
  /// 4 for a hemisphere, thousands for a small cap, which amplifies every error of its points, known or not, so much.
  double amplification = 0;
  FitQuality quality;
};

struct CylinderFit {
  Eigen::Vector3d axis_point_mm;   // the point of the axis nearest to the centroid of the points used
  Eigen::Vector3d axis_direction;  // unit; its largest component is positive
  double diameter_mm = 0;
  double u_axis_point_mm = 0;       // across the axis, in the worse of the two directions
  double u_axis_direction_rad = 0;  // in the worse of the two directions
  double u_diameter_mm = 0;
  double amplification = 0;  // as SphereFit's: 1 all around, more for a sector
  FitQuality quality;
};

/// d of eqs. 4, 5 has no sign: quality.min_mm is the smallest size.
struct LineFit {
  Eigen::Vector3d point_mm;   // centroid of the points
  Eigen::Vector3d direction;  // unit; its largest component is positive
  double u_point_mm = 0;      // across the line, at point_mm
  double u_direction_rad = 0;
  FitQuality quality;
};

struct CircleFit {
  Eigen::Vector3d center_mm;
  Eigen::Vector3d normal;  // unit; its largest component is positive
  double diameter_mm = 0;
  Eigen::Vector3d u_center_mm;
  double u_normal_rad = 0;  // in the worse of its two directions
  double u_diameter_mm = 0;
  FitQuality quality;
};

Result<PlaneFit> fit_plane(Points points_mm, const FitOptions& options = {});
Result<SphereFit> fit_sphere(Points points_mm, const FitOptions& options = {});
Result<CylinderFit> fit_cylinder(Points points_mm, const FitOptions& options = {});

/// Of all points, equally. The scatter s^2 = F / (2 n - 4) counts two distances per point.
Result<LineFit> fit_line(Points points_mm);
/// Of all points, equally. The scatter s^2 = F / (2 n - 6) counts two distances per point.
Result<CircleFit> fit_circle(Points points_mm);

/// b_from_a that best carries points_in_a onto points_in_b (least squares, rotation and translation). [Umeyama1991]
struct RigidFit {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation_mm;
  double rms_mm = 0;  // sqrt(mean squared distance of corresponding points)
};
Result<RigidFit> fit_rigid(Points points_in_a_mm, Points points_in_b_mm);

}  // namespace fringecal::fitting

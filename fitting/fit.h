// Gaussian (orthogonal distance) least squares of plane, sphere and cylinder, without an initial guess.
//
// Minimised is F = sum d_i^2, d_i the signed orthogonal distance of point i from the surface:
//   plane     d = n . (p - c)                                                              (1)
//   sphere    d = |p - c| - r                                                              (2)
//   cylinder  d = |(p - c) x a| - r,  |a| = 1                                              (3)
// This is the "Gaussian associated feature" of ISO 14405-1 and ISO 10360-6 and what NIST's and PTB's reference data
// certify. [Shakarji1998] [Forbes1991]
//
// Points in mm, any frame, any order. The result moves with its points. Standard uncertainties follow from the Jacobian
// at the solution and the residual scatter s^2 = F / (n - m), m the number of parameters (plane 3, sphere 4, cylinder
// 5); they take the point errors as independent, equal and along the normal. With exactly as many points as parameters
// nothing is left to judge the scatter by: standard_deviation_mm and every u_... are then +infinity.
//
// Fewer points than parameters, points that are not finite, or points that do not determine the shape: no result, one
// sentence why.
#pragma once

#include "core/result.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

namespace fringecal::fitting {

using Points = std::span<const Eigen::Vector3d>;

/// How points are rejected. Every rule starts from the fit to all (or to the consensus) and repeats until nothing
/// changes.
enum class Rejection {
  none,
  /// VDI/VDE 2634: at most 0.3 % of the points, those farthest out, and only beyond 3 s.
  vdi_2634,
  /// Raw scans with posts, bases and background: the surface that most points agree on is found first, then points
  /// beyond 3.5 robust standard deviations (MAD based) of it are left out.
  robust,
};

struct FitOptions {
  Rejection rejection = Rejection::none;
  int max_iterations = 100;  // Gauss-Newton; well-posed data need 4 to 8
};

/// How a fit came about. u_...: standard uncertainties, k = 1.
struct FitQuality {
  double rms_mm = 0;                 // sqrt(F / n)
  double standard_deviation_mm = 0;  // sqrt(F / (n - m)): the form standard deviation of the paper's section 4
  double max_mm = 0, min_mm = 0;     // largest and smallest signed distance
  std::size_t n_used = 0, n_rejected = 0;
  int iterations = 0;
  std::vector<double> distances_mm;  // of every point given, rejected ones included, as ordered
  std::vector<bool> rejected;        // as ordered
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
  FitQuality quality;
};

struct CylinderFit {
  Eigen::Vector3d axis_point_mm;   // the point of the axis nearest to the centroid of the points used
  Eigen::Vector3d axis_direction;  // unit; its largest component is positive
  double diameter_mm = 0;
  double u_axis_point_mm = 0;       // across the axis, in the worse of the two directions
  double u_axis_direction_rad = 0;  // in the worse of the two directions
  double u_diameter_mm = 0;
  FitQuality quality;
};

Result<PlaneFit> fit_plane(Points points_mm, const FitOptions& options = {});
Result<SphereFit> fit_sphere(Points points_mm, const FitOptions& options = {});
Result<CylinderFit> fit_cylinder(Points points_mm, const FitOptions& options = {});

/// b_from_a that best carries points_in_a onto points_in_b (least squares, rotation and translation). [Umeyama1991]
struct RigidFit {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation_mm;
  double rms_mm = 0;  // sqrt(mean squared distance of corresponding points)
};
Result<RigidFit> fit_rigid(Points points_in_a_mm, Points points_in_b_mm);

}  // namespace fringecal::fitting

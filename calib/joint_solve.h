// The least-squares problem of calibrate.h on plain data: target places, sights of them, a start. Camera alone, or
// camera and projector together.
//
// Minimised is  sum |camera residual|^2 / (s_c u_pixel)^2 + sum (projector residual)^2 / (s_p u)^2 + priors        (1)
// with the residuals of bundle_cost.h. The scales s_c and s_p of the stated uncertainties are not known beforehand;
// they are the square roots of the variance components
//   s^2 = chi2_group / (n_group - tr(N^-1 N_group)),  N = J^T J                                                (2)
// re-estimated until they stay. [Foerstner1979] What is known of the board enters as priors: the printing error of each
// corner (one place for all poses, so it does not average out over them), the scale of the pitch, the bow.
// A Cauchy loss first; corners beyond 4 standard deviations in a component are left out; then the clean problem. The
// solution is taken only if what is left of a Newton step is below 1e-3 standard uncertainties:
//   g^T N^-1 g < 1e-6                                                                                          (3)
#pragma once

#include "calib/calibrate.h"
#include "calib/model/projector.h"
#include "core/result.h"
#include "core/rigid.h"
#include "core/uncertain.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace fringecal::calib {

/// One target seen in one pose.
struct Sight {
  int pose = 0, target = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double u_pixel_px = 1;
  std::optional<Uncertain> x, y;
  bool used = true;
};

/// What is solved for, and what from. On entry the start, on return the solution.
struct Bundle {
  std::vector<Eigen::Vector2d> targets_mm;  // nominal, frame board
  std::vector<Sight> sights;

  model::Camera camera;
  std::optional<model::Projector> projector;
  Rigid3 proj_from_cam;
  std::vector<Rigid3> cam_from_board;
  Eigen::Vector2d bow_mm = Eigen::Vector2d::Zero();  // b_x, b_y of bundle_cost.h, eq. 1
  std::vector<Eigen::Vector2d> print_mm;             // printing errors; empty: zero
};

/// What happens to sights that do not fit.
enum class Outliers { reject, keep };
/// What stays at its start.
enum class Held { nothing, camera_and_poses };

struct SolveSettings {
  DistortionTerms camera_terms = DistortionTerms::radial;
  DistortionTerms projector_terms = DistortionTerms::radial;
  Outliers outliers = Outliers::reject;
  Held held = Held::nothing;
  // Standard deviations of the priors; 0 leaves the quantity at its nominal value.
  double u_print_mm = 0;
  double u_pitch_relative = 0;
  double u_bow_mm = 0;
  // Where one axis only is coded: the camera's pupil lies this far from the projector's along the fringes, 0 +- this.
  double u_along_mm = 0;
  // Given: the scales of eq. 1 are not estimated and no sight is rejected (comparing models on the same footing).
  std::optional<Eigen::Vector2d> fixed_scales;
};

struct SolveReport {
  model::ParameterCovariance covariance;         // camera, projector, proj_from_cam
  double scale_camera = 1, scale_projector = 1;  // s_c, s_p
  double chi2 = 0;                               // eq. 1 at the solution, priors included
  int dof = 0, parameters = 0, residuals = 0;    // without the board's priors
  double camera_rms_px = 0, projector_rms = 0;   // over the sights used; per coordinate; main axis
  int n_rejected = 0, iterations = 0;
  double newton_decrement = 0;  // square root of eq. 3
};

/// No result where the problem is singular, does not converge, or gives anything that is not finite.
Result<SolveReport> solve_bundle(Bundle& bundle, const SolveSettings& settings);

/// Number of distortion coefficients of a set: 0, 2, 4, 5.
int term_count(DistortionTerms terms);
/// "none", "radial", "radial+tangential", "full", "auto": as the command line has it.
const char* name_of(DistortionTerms terms);

}  // namespace fringecal::calib

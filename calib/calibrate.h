// Camera and projector from views of a board: intrinsics, radial (and tangential) distortion of both, relative pose.
//
// Minimised is the sum of whitened squares of
//   camera      (px, py) - pi_cam(cam_from_board X_ij)                 / u_pixel     2 per corner           (1)
//   projector   u - u_proj(proj_from_cam cam_from_board X_ij)          / u(u)        1 per corner and axis  (2)
// over the camera (f, c, distortion), the projector (f, u0 per coded axis, distortion), proj_from_cam and the poses,
// with the models of calib/model. Views of a flat plate, where there are any, are one plane each (flat_witness.h) and have (2)
// at a grid of pixels. Robust loss first; corners beyond 4 standard deviations are then listed and left out,
// and the clean problem is solved again. What the readings of one capture or one corner have in common (phase offset, bend
// of the board, printing error, height) is estimated with its scatter (joint_solve.h), so that the covariance does not
// average it away; the covariance is widened where the poses contradict it. It is linear but for the place of a one-axis
// projector along the fringes (joint_solve.h, eq. 6): single parameters and triangulated points have their uncertainties, a
// joint region of all parameters is still somewhat too small. A projector that is coded along one axis is a one-dimensional
// camera; what that leaves open (its place
// along the fringes) gets a weak prior, which the Scanner names. [Zhang2000] [Chen2008, eqs. 18-20]
#pragma once

#include "calib/model/board.h"
#include "calib/model/scanner.h"
#include "core/result.h"

#include <span>

namespace fringecal::calib {

/// Which distortion terms are estimated.
enum class DistortionTerms {
  none,
  radial,             // k1, k2: the paper's model
  radial_tangential,  // k1, k2, p1, p2
  full,               // k1, k2, p1, p2, k3: OpenCV's default
  automatic,          // the set the data support: a richer one only where it lowers the Bayesian information criterion
};

enum class CalibrationMethod {
  // All at once, as above.
  joint,
  // For comparison with programs that work so: the camera from its own corners by plain least squares, every corner
  // kept with
  // the same weight, the board perfect; then the projector with camera and poses held, outliers in u left out. The
  // covariance
  // of the projector then leaves out what the camera contributes.
  staged,
  // The paper's way: the camera by Tsai's two stages (tsai.h), its principal point in the image's middle, every corner kept;
  // then the projector as in `staged`. The camera's covariance is that of stage 2.
  tsai,
};

/// What the joint and the staged solve start from.
enum class CameraStart { zhang, tsai };

struct CalibrationOptions {
  DistortionTerms camera_terms = DistortionTerms::automatic;
  DistortionTerms projector_terms = DistortionTerms::radial;  // none or radial where one axis only is coded
  CalibrationMethod method = CalibrationMethod::joint;
  CameraStart start = CameraStart::zhang;  // closed form from homographies; the solution does not depend on it
  int min_poses = 3;
  // The board's bow (two parabolas, across x and y) is estimated with a prior of this share of the field's diagonal:
  // printed and glued boards bow by 0.2 to 1 per mille. 0: the board is taken as flat.
  double u_bow_relative = 1e-3;
  // Views of a flat witness; joint method only. Its bow is estimated with the prior u_flatness_mm per term (flat_witness.h):
  // of a plate certified to 5 um.
  std::vector<model::BoardObservation> flats = {};
  double u_flatness_mm = 0.003;
  std::optional<double> pixel_mm = {};             // passed on to the Scanner for the paper's parameters
  std::optional<double> working_distance_mm = {};  // L; by default the boards' mean distance along the projector's axis
};

Result<model::Scanner> calibrate(std::span<const model::BoardObservation> observations, const model::Board& board,
                                 int width_px, int height_px, const PatternPlan& plan,
                                 const CalibrationOptions& options = {});

}  // namespace fringecal::calib

// A camera alone from views of a plane: lens and poses by plain least squares, fast.
//
// Minimised is  sum |pi(R_j B_i + t_j) - pixel_ij|^2  over the lens (camera.h, eqs. 1 to 4; with a skew px = fx xd +
// gamma yd + cx) and the poses, every corner with the same weight: what cv::calibrateCamera and mrcal (without
// regularisation) minimise, so that solutions can be compared to the last digits.                              (1)
// Start: homographies by the direct linear transformation, the focal length from the orthogonality of their columns with
// the principal point in the middle, [Zhang2000].
// Solve: Gauss-Newton with analytic derivatives, damped where a step does not lower (1). The poses are eliminated board by
// board: with A_j (6 x 6), W_j, g_j of board j
//   S = sum_j (N_j - W_j^T A_j^-1 W_j)                                                                          (2)
// is all that has to be factorised. The derivatives of a board are laid out by columns over tiles of corners, so that the
// sums of products run over contiguous memory. Boards are handled in parallel and summed in order: the result does not
// depend on the number of threads.
// Stop: when what is left to go, estimated from the last two steps, is below 1e-10 px in focal length and centre.
// px, mm, rad. No result: fewer than three views or four corners in a view, views that leave the lens open.
#pragma once

#include "calib/calibrate.h"
#include "core/result.h"
#include "core/rigid.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

namespace fringecal::calib {

/// Corners of a plane as one picture shows them.
struct PlanarView {
  std::vector<Eigen::Vector2d> board_mm, pixels;
};

enum class Skew { zero, free };
/// fx and fy on their own, or one focal length for both.
enum class Aspect { free, one };

struct CameraSolveOptions {
  DistortionTerms terms = DistortionTerms::radial;  // radial, radial_tangential or full
  Skew skew = Skew::zero;
  Aspect aspect = Aspect::free;
  int max_iterations = 100;
};

struct CameraSolution {
  model::Camera camera;
  double skew_px = 0;
  std::vector<Rigid3> cam_from_board;
  double squares_px2 = 0;  // eq. 1
  double rms_px = 0;       // per coordinate
  int iterations = 0;
  std::vector<std::string>
      names;  // of the lens parameters: fx_px, fy_px (not with Aspect::one), cx_px, cy_px, k1 .., skew_px
  Eigen::MatrixXd covariance;  // of them, S^-1 times the squares over the degrees of freedom
};

Result<CameraSolution> solve_camera(std::span<const PlanarView> views, int width_px, int height_px,
                                    const CameraSolveOptions& options = {});

}  // namespace fringecal::calib

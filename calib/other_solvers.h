// The same camera calibration by OpenCV and by mrcal, for comparison: every corner with the same weight, no
// regularisation, no outlier rejection, run until they stop by themselves (tolerance 1e-16).
//
// OpenCV keeps its points in float; cross_check() rounds the corners to float for all, so that the sums of squares are of
// the same readings. The difference of two solutions is that of the pixels that the same ray is seen at, over a grid of
// the image; in mm it is what that pixel is wide at the boards' mean distance.
//   d_px = |pi_ours(ray) - pi_theirs(ray)|,   d_mm = d_px z / f                                                  (1)
// libmrcal is no part of the program: it is loaded when it is asked for. No result, with the reason, where it is not
// installed, or was not there when the program was built; where the views are not of one grid with equal pitches (mrcal);
// where a library does not solve them. [mrcal] [OpenCV]
#pragma once

#include "calib/camera_solve.h"

#include <span>

namespace fringecal::calib {

enum class OtherSolver { mrcal, opencv };

struct OtherSolution {
  model::Camera camera;
  double squares_px2 = 0;  // from its lens and poses, as camera_solve.h, eq. 1
};

/// terms: radial, radial_tangential or full. `iterations`: OpenCV's limit.
Result<OtherSolution> solve_with_opencv(std::span<const PlanarView> views, int width_px, int height_px,
                                        DistortionTerms terms, int iterations);
/// radial_tangential or full: mrcal has no model of radial terms alone. Corners may be missing in a view.
Result<OtherSolution> solve_with_mrcal(std::span<const PlanarView> views, int width_px, int height_px,
                                       DistortionTerms terms);

struct CrossCheck {
  CameraSolution ours;
  OtherSolution theirs;
  DistortionTerms terms = DistortionTerms::radial;  // as solved by both
  double max_px = 0, rms_px = 0, max_mm = 0;        // eq. 1
  double distance_mm = 0;                           // z
};

Result<CrossCheck> cross_check(std::span<const PlanarView> views, int width_px, int height_px, DistortionTerms terms,
                               OtherSolver solver);

}  // namespace fringecal::calib

// The same camera calibration by OpenCV and mrcal, for comparison: every corner with the same weight, no regularisation,
// no outlier rejection, run until they stop by themselves.
#pragma once

#include "calib/camera_solve.h"

namespace fringecal::test {

struct LibrarySolution {
  model::Camera camera;
  double squares_px2 = 0;
};

/// Views of a full grid, row after row, as known_board() has them. `iterations`: OpenCV's limit; its tolerance is 1e-16.
LibrarySolution solve_with_opencv(const std::vector<calib::PlanarView>& views, int width_px, int height_px,
                                  calib::DistortionTerms terms, int iterations);

/// mrcal's LENSMODEL_OPENCV4: k1, k2, p1, p2. Its own start: OpenCV's closed form and pose of each board.
LibrarySolution solve_with_mrcal(const std::vector<calib::PlanarView>& views, int width_px, int height_px, int columns,
                                 double pitch_mm);

/// `boards` views of columns x rows corners through a known camera, tilted up to 35 degrees, with noise. Radial only:
/// p1 = p2 = 0 in the truth.
std::vector<calib::PlanarView> planar_views(int boards, int columns, int rows, double pitch_mm, double noise_px);

}  // namespace fringecal::test

// Board views computed from a known scanner, for the tests of the calibration: no image, no decoding, errors as asked
// for. The projections come from calib/model, whose own tests compare them with OpenCV and mrcal.
#pragma once

#include "calib/camera_solve.h"
#include "calib/model/board.h"
#include "calib/model/scanner.h"

#include <cstdint>
#include <vector>

namespace fringecal::test {

/// Like the paper's scanner: camera f = 3721 px at 400 mm from the projector, both looking at a point 1000 mm away.
model::Scanner known_scanner(bool two_axes = false);
/// 9 x 7 corners, 30 mm.
model::Board known_board();
PatternPlan known_plan(bool two_axes = false);

struct ViewErrors {
  double u_pixel_px = 0.03;
  double u_coordinate_mm = 0.0004;  // 0.0004 mm of a period of 0.24 mm: 10 mrad
  double print_mm = 0;              // rms of each corner, x and y
  double pitch_relative = 0;        // rms of the scale
  double bow_mm = 0;                // at the ends of the field, both directions
  double bend_mm = 0;               // rms of each second-order term, new in every pose
  double phase_offset_mm = 0;       // rms, one value for all corners of a pose
  std::uint64_t seed = 1;
};

/// Where views() holds its boards: cam from the board's middle.
std::vector<Rigid3> view_places(int poses);
/// `poses` boards, tilted up to 35 degrees about axes that go round, within +-80 mm of the working distance.
/// parallel: all at the same attitude, facing the camera.
std::vector<model::BoardObservation> views(const model::Scanner& scanner, const model::Board& board, int poses,
                                           const ViewErrors& errors);
std::vector<model::BoardObservation> parallel_views(const model::Scanner& scanner, const model::Board& board, int poses,
                                                    const ViewErrors& errors);

/// One board at a place, cam_from_board of its frame; the corners that camera and fringes both cover.
model::BoardObservation view_at(const model::Scanner& scanner, const model::Board& board, const Rigid3& cam_from_board,
                                const ViewErrors& errors);

/// `boards` views of columns x rows corners through a known camera, tilted up to 35 degrees, with noise. Radial only:
/// p1 = p2 = 0 in the truth.
std::vector<calib::PlanarView> planar_views(int boards, int columns, int rows, double pitch_mm, double noise_px);

}  // namespace fringecal::test

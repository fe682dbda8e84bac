// `fringecal calibrate --corners`: a camera alone from corners that another program found; and --cross-check.
#pragma once

#include "calib/calibrate.h"
#include "calib/other_solvers.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {

struct CornerOptions {
  std::vector<std::filesystem::path> corners;
  std::string board, places, output;  // board or places; output may be empty
  double places_unit_mm = 1.0;
  std::vector<int> image_size;  // width, height, px
  calib::DistortionTerms terms = calib::DistortionTerms::automatic;
  bool tsai = false, skew = false, one_focal_length = false, json = false;
  std::optional<calib::OtherSolver> cross_check;
};

void calibrate_corners(const CornerOptions& options);

/// Solves the corners of the views with another library too and prints the differences.
void print_cross_check(const std::vector<calib::PlanarView>& views, int width_px, int height_px,
                       calib::DistortionTerms terms, calib::OtherSolver solver);

}  // namespace fringecal::cli

// How well a commissioned virtual scanner measures, held against its truth: what the acceptance figures of the whole
// instrument are made from. Rendered captures, no part of which any estimator has seen; lengths in mm.
//
//   bound      rms over the kept points of u along the ray times the cosine between ray and surface normal:
//              the scatter that the pixels' phase noise alone would give across the surface                     (1)
//   ripple     |2 / n sum d_i exp(-i h phi_i)|, d the deviations and phi the absolute phase of the n points of one
//              tile of the surface (the plane: 4 x 3 tiles, else the whole), largest over h = 1 .. 4, tiles and
//              repeats                                                                                           (2)
//   flatness of the mean: deviations of the repeats of the plane averaged pixel by pixel and then over blocks of
//              32 x 32 pixels (9 mm), largest minus smallest block: 0.3 um of noise is left per block             (3)
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::test {

struct ArtefactAccuracy {
  std::string name;
  std::optional<double> mean_diameter_error_mm;  // mean of the repeats - true diameter; absent: plane
  double worst_form_sd_mm = 0, worst_sd_over_bound = 0, ripple_mm = 0;
};

/// One length of one position, the mean of its captures as the plan vdi2634-2 has them. `error`: as stated by the verification, with its U; `true_error` by the truth.
struct JudgedError {
  std::string symbol;
  double error_mm = 0, U_mm = 0, true_error_mm = 0, u_later_mm = 0;
};

struct InstrumentAccuracy {
  std::vector<ArtefactAccuracy> artefacts;
  double flatness_of_mean_mm = 0;
  std::vector<JudgedError> lengths;  // of the ball bar at its places: E of the distance, PS of the two spheres
};

/// commissioning: a finished commissioning of the virtual scanner. repeats: of each scene of the plan "paper"; bars:
/// places of the ball bar, at most 7.
InstrumentAccuracy accuracy_of(const std::filesystem::path& commissioning, int repeats, int bars);

}  // namespace fringecal::test

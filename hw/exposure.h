// Exposure: found from test frames, and two exposures merged into one capture.
//
// Test frames. The level of a frame is the grey value that all but 1e-4 of its pixels stay at or below (hot pixels and
// a glint are not the board). With target T (part of saturation) the next exposure is
//     t' = t T sat / level,   t' = t / 4 where the level is saturated (nothing else is known then)             (1)
// at most times 8 in one step, until the level lies in [T - 0.07, T + 0.07] of saturation.
//
// Merging. Per pixel, one exposure gives *all* frames of that pixel, so that Gray threshold and phase come from the
// same light: among the exposures in which no frame of the pixel is saturated, the one of the largest modulation; where
// none is free of saturation, the shortest. The modulation is, over the phase steps of each code,
//     B = 2/N |sum_k I_k exp(2 pi i k / N)|                                                                      (2)
// (of two axes the sum), or max - min over the frames where the plan has no phase steps. Grey values are kept as they
// were captured; nothing is scaled, so the camera's noise model still holds.
#pragma once

#include "core/capture.h"

#include <optional>
#include <vector>

namespace fringecal::hw {

/// The level of a frame, in grey values.
int bright_level(const GrayImage& frame);
/// Part of the pixels at or above the saturation level.
double saturated_part(const GrayImage& frame, int saturation_level);

struct ExposureSearch {
  double target = 0.85;                    // of saturation: room for patterns that were not among the test frames
  double least_ms = 0.01, most_ms = 1000;  // of usual area-scan cameras
  int most_steps = 8;                      // three factors of four down and five refinements
};

/// (1); nothing where the level is good.
std::optional<double> next_exposure_ms(double exposure_ms, int level, int saturation_level,
                                       const ExposureSearch& search);

/// stacks[e][k]: frame k at exposure e, shortest exposure first; all frames of one size and depth.
std::vector<GrayImage> merge_exposures(const PatternPlan& plan, const std::vector<std::vector<GrayImage>>& stacks,
                                       int saturation_level);

}  // namespace fringecal::hw

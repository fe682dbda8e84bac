// The symptoms of one capture: what artefacts of known size, the light and the room show, against what a healthy scanner
// shows, and what each fault would do to it. The pattern is judged by diagnosis.h.
//
// Symptoms, each minus its expectation:
//   distance, diameter   Gaussian fits (fitting/fit.h) minus the certified length at the temperature T_0 of the baseline
//   bend                 of a flat: u^2, v^2 and u v of its deviations, u and v from -1 to 1 over the plate, along world
//                        X and Y: a sag in mm                                                                   (1)
//   modulation           ln of the median modulation over the baseline's
//   scatter              ln of the flat's scatter about (1) over the baseline's
//   room                 temperature, as the capture's sensors or the operator have it, minus T_0
// Healthy covariance: noise of the fits, certificates, kFloor of each kind for what is not noise (blur, ripple, the place
// of each pattern), the calibration's covariance through the derivatives of all symptoms (as calibration_uncertainty.h,
// eq. 1, but jointly), and a room that varies by kRoomSd with all that follows from it.
// Effects of the faults, by central differences: the points as the faulty scanner's pixels and phases would be read with
// the calibrated one (retriangulate()).
//   base line      the camera shifted along the line of the pupils, its direction kept
//   camera         turned about its pupil, three angles
//   warm room      the base line longer by the frame's expansion, taken as (17 +- 6) 1e-6 / K (steel to aluminium), every
//                  artefact by its own. To the shape of things that is the *same* as a changed base line: only the
//                  thermometer and the size of the effect tell them apart                                       (2)
//   projector      modulation down, scatter up by the same logarithm
//   certificate    of one artefact: its lengths off, nothing else
// Frame `world`, mm.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"
#include "metrology/artefact_file.h"
#include "metrology/diagnosis.h"
#include "metrology/point_cloud.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

/// What the light and the room were when the scanner was known to be in order ("fringecal.baseline", version 1).
struct Baseline {
  double modulation = 0;  // median over the cloud, grey levels
  double scatter_mm = 0;  // of the flat about eq. 1
  std::optional<double> temperature_degC;
  std::string date, scanner_file_sha256;
};

Value to_value(const Baseline& baseline);
/// Throws InputError.
Baseline read_baseline(const std::filesystem::path& file);

struct Observation {
  const PointCloud& cloud;
  const model::Scanner& scanner;
  std::vector<Gauge> gauges;  // in the capture, all of them
  std::optional<double> room_degC = {};
};

/// No result: an artefact is missing, or no flat is among them.
Result<Baseline> baseline_of(const Observation& observation);

/// baseline absent: the light and the scatter are not looked at, T_0 is 20 degC. No result: an artefact is missing or
/// cannot be fitted.
Result<Symptoms> symptoms_of(const Observation& observation, const std::optional<Baseline>& baseline);

}  // namespace fringecal::metrology

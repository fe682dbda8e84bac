// What a plan makes of its captures: first each capture by itself, later all of a series together.
//
// A capture's cloud is searched for the series' artefacts (metrology/artefact.h: grazing and gross points left out), each
// feature is fitted to what remains, with the plan's rejection, and described by
//   d, centre       Gaussian least squares                                                    (fitting/fit.h)
//   range           max - min of the signed deviations of the points kept                                       (1)
//   shell_95        the 97.5 % minus the 2.5 % quantile of the deviations                                       (2)
//   sd              their standard deviation, degrees of freedom of the fit                                     (3)
// The uncertainty of a test value [ISO14253-5] holds what the test adds to the scanner's own error:
//   of a length     certificate, expansion, temperature (artefact_file.h, eq. 2); of a mean of n repeats, which estimates
//                   the scanner's systematic error, also s / sqrt(n) with nu = n - 1                            (4)
//   of a form       u^2 = (F / 2)^2 + u^2(F),  F the artefact's certified form error                            (5) [ISO/TS 23165, 5.1]
//                   (for the standard deviation an upper bound)
// of a later measurement of the same length at the same place:
//   u_later^2 = u_ref^2 + s^2 + u_cal^2, s the repeatability where the series has repeats, else the capture's noise (6)
// Where the plan has m captures of each position, what is tested is a length that is the mean of m captures: value and true error
// are those of the mean, and u_later is that of a length measured in the same way,
//   s^2 = (s_1^2 + .. + s_m^2) / m^2                                                                            (7)
// with s_i of the noise and of the mean phase error of each capture. Nothing else becomes less: the certificate, the temperature
// and the calibration are the same in all m.
// The Monte Carlo behind `validation` propagates E = x - l (1 + alpha (t - t_ref)) itself, not its linear form.
// Frame `world`, mm.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"
#include "metrology/artefact.h"
#include "metrology/artefact_file.h"
#include "metrology/plan.h"
#include "metrology/point_cloud.h"
#include "metrology/residual_cloud.h"
#include "metrology/verification.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

// u_noise: of the points, and of the mean phase error of each capture (calibration_uncertainty.h, eq. 2).
struct FeatureResult {
  std::string artefact;                                             // its gauge
  int part = 0;                                                     // of its certificate: 0, 1, ...
  std::optional<double> diameter_mm, u_noise_mm, u_calibration_mm;  // absent for a plane
  double range_mm = 0, shell_95_mm = 0, sd_mm = 0;                  // eqs. 1 to 3
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();
  int n_points = 0, n_rejected = 0;
  ResidualCloud residuals = {};  // of evaluate_capture() only; not in the file
};

/// Between two parts of an artefact: a ball bar's or a plate's centres, a step's planes.
struct DistanceResult {
  std::string artefact;
  int from = 0, to = 1;
  double distance_mm = 0, u_noise_mm = 0, u_calibration_mm = 0;
};

struct EvaluateOptions {
  Environment environment;
  std::int64_t monte_carlo_trials = 200'000;  // ends known to 0.006 u; 0: no validation
};

/// How well the views of a capture fitted together.
struct JoinedViews {
  int views = 0, references = 0;  // reference spheres that they see together
  double rms_mm = 0;              // of the references' centres about their common places
};

struct CaptureResult {
  int capture = 0;
  std::vector<FeatureResult> features;
  std::vector<DistanceResult> distances;
  std::optional<JoinedViews> joined;  // of a series with views
};

/// What of an artefact is looked for in a cloud: a ball bar is two spheres, a step two planes.
std::vector<NominalArtefact> nominals_of(const Gauge& gauge);

/// No result: an artefact that is not in the cloud, or cannot be fitted, with what was there instead.
Result<CaptureResult> evaluate_capture(const Plan& plan, const Series& series, int capture,
                                       const std::vector<Gauge>& gauges, const PointCloud& cloud,
                                       const model::Scanner& scanner);

/// All quantities of a series, judged by the plan's rule. results: one per capture, in any order.
std::vector<Quantity> evaluate_series(const Plan& plan, const Series& series, const std::vector<Gauge>& gauges,
                                      const std::vector<CaptureResult>& results, const EvaluateOptions& options = {});

/// Of each length of the series with at least two captures.
std::vector<GaugeSummary> summaries_of(const Series& series, const std::vector<Gauge>& gauges,
                                       const std::vector<CaptureResult>& results, const Environment& environment);

Value to_value(const CaptureResult& result);
CaptureResult capture_result_from(const Value& value, const std::string& name_in_messages);

}  // namespace fringecal::metrology

// Artefacts in a point cloud: found, cleaned by stated rules, fitted; and the statistics of repeats, as in section 4 of
// the paper. Frame `world`, mm.
//
// 1. Segments: points whose pixels touch and whose distance in space is below `max_gap_mm` belong together.      (1)
// 2. Each segment is tried as each wanted shape (fit of a thinned set; robust only where no plain fit serves) and given
//    to the nominal that it fits best by size; a nominal without a segment is an error by name.
// 3. Grazing points go: with n the normal of the fitted surface, directions c to the camera and l to the projector,
//      n . c < cos(max_incidence)  or  n . l < cos(max_incidence)                                                 (2)
//    (camera blur mixes silhouette and background there, and shading gradients shift the phase). The rule looks at the
//    fitted surface, not at the point's own deviation, so it does not select by noise.
// 4. Gross errors go: |d| > 6 robust standard deviations (a normal distribution loses 2e-9 of its
//    points). Both counted.
// 5. Gaussian least squares of the rest (fitting/fit.h); refitted until the kept set no longer changes.
// The form standard deviation is the paper's: of the signed distances of the kept points from their own fit.
// [Chen2008, section 4]
#pragma once

#include "calib/model/scanner.h"
#include "core/image.h"
#include "core/result.h"
#include "metrology/point_cloud.h"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace fringecal::metrology {

enum class ArtefactKind { plane, sphere, cylinder };

const char* name_of(ArtefactKind kind);

struct NominalArtefact {
  std::string name;  // "sphere 38"
  ArtefactKind kind = ArtefactKind::sphere;
  double diameter_mm = 0;  // nominal; ignored for a plane
};

struct ArtefactOptions {
  double max_incidence_deg = 60;  // eq. 2
  double max_gap_mm = 1.5;        // eq. 1: 3 pixels of 0.3 mm and a slope of 60 degrees stay together
  double max_size_error = 0.10;   // a segment is this nominal only within 10 % of its diameter
  std::size_t min_points = 500;
};

struct ArtefactMeasurement {
  std::string name;
  ArtefactKind kind = ArtefactKind::sphere;
  std::optional<double> diameter_mm;  // absent for a plane
  double u_diameter_noise_mm = 0;     // from the scatter of this cloud alone (independent points)
  double form_standard_deviation_mm = 0;
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();  // centre; point of the axis; centroid
  std::size_t n_points = 0, n_grazing = 0, n_gross = 0;
  std::vector<Eigen::Vector3d> points_mm;  // kept points, row-major
  Image<float> deviation_mm;               // signed distance over the pixels of the segment; NaN where no kept point
};

/// All nominals in the cloud, in their order. No result: a nominal that is not found, with what was there instead.
Result<std::vector<ArtefactMeasurement>> measure_artefacts(const PointCloud& cloud, const model::Scanner& scanner,
                                                           std::span<const NominalArtefact> nominals,
                                                           const ArtefactOptions& options = {});

/// Every segment that is this nominal by size, by falling number of points: reference spheres, of which nobody knows how
/// many a view sees. Segments that fit by size but not by rules 3 to 5 are left out.
std::vector<ArtefactMeasurement> measure_all(const PointCloud& cloud, const model::Scanner& scanner,
                                             const NominalArtefact& nominal, const ArtefactOptions& options = {});

/// Every k-th of the points, at most so many: for what is smooth over a body.
std::vector<Eigen::Vector3d> thinned(std::span<const Eigen::Vector3d> points, std::size_t at_most);

/// u_cal of a measured diameter (metrology/calibration_uncertainty.h), from at most 2000 of its points.
Result<double> u_diameter_from_calibration(const ArtefactMeasurement& measurement, const model::Scanner& scanner);
/// What the mean phase error of its capture makes of it (eq. 2 there), from as many.
Result<double> u_diameter_from_phase_offset(const ArtefactMeasurement& measurement, const model::Scanner& scanner);

/// The paper's evaluation of n repeats.
struct RepeatStatistics {
  int n = 0;
  std::optional<double> mean_diameter_mm, repeatability_sd_mm;  // sd: n - 1; absent for a plane, sd absent for n = 1
  double max_form_sd_mm = 0, mean_form_sd_mm = 0;
};

struct RepeatValue {
  std::optional<double> diameter_mm;
  double form_sd_mm = 0;
};

RepeatStatistics statistics_of(std::span<const RepeatValue> repeats);

/// Standard uncertainty of "mean of n repeats minus certificate":
///   u^2 = s^2 / n + u_cal^2 + u_cert^2                                                                       (3) [GUM]
double u_of_error_mm(const RepeatStatistics& statistics, double u_calibration_mm, double u_certificate_mm);

}  // namespace fringecal::metrology

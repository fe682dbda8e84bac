// A feature of an artefact fitted and described as acceptance.h has it (eqs. 1 to 3), and the length between two of them: of
// spheres the distance of their centres, of a step's planes its height (step.h).
#pragma once

#include "fitting/fit.h"
#include "metrology/acceptance.h"
#include "metrology/artefact.h"

#include <span>
#include <vector>

namespace fringecal::metrology {

inline constexpr std::size_t kPointsForCalibration = 2000;  // of a feature: what the calibration does is smooth over it

struct Feature {
  FeatureResult result;
  Eigen::Vector3d u_centre_mm = Eigen::Vector3d::Zero();  // of a sphere
};

Result<Feature> describe(const ArtefactMeasurement& measurement, fitting::Rejection rejection);

/// The parts of a gauge in the order of its certificate: of a plate as their distances say, of a step the lower plane first,
/// that is the one farther from the camera; of others as they are.
Result<std::vector<ArtefactMeasurement>> in_certified_order(const Gauge& gauge, std::vector<ArtefactMeasurement> parts,
                                                            const Eigen::Vector3d& camera_mm);

/// The length between the features of two sets of points.
Result<double> length_between(GaugeKind kind, std::span<const Eigen::Vector3d> from,
                              std::span<const Eigen::Vector3d> to);

/// From the noise of the points alone, without the calibration's part.
Result<DistanceResult> distance_between(const Gauge& gauge, const CertifiedDistance& certified,
                                        std::span<const ArtefactMeasurement> parts, std::span<const Feature> features);

}  // namespace fringecal::metrology

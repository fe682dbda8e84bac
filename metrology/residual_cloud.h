// Residual clouds: the points that a feature was fitted to, each with its deviation from the fit, as evidence behind a
// result, and where the feature stood. One file per feature beside the verification record, named there with its hash.
//
// File: binary little-endian PLY with x, y, z and deviation as 32-bit floats (steps of 3e-5 mm at 500 mm) and `rejected`
// (1: left out of the fit). At most kLargestCloud points: every n-th in their order, n the smallest that fits.
// Frame `world`, mm.
#pragma once

#include "core/fields.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::metrology {

inline constexpr std::size_t kLargestCloud = 100'000;

struct ResidualPoint {
  Eigen::Vector3f position_mm = Eigen::Vector3f::Zero();
  float deviation_mm = 0;  // signed, from the fit
  bool rejected = false;
};
using ResidualCloud = std::vector<ResidualPoint>;

/// Thinned. The three have one length.
ResidualCloud residual_cloud(std::span<const Eigen::Vector3d> points_mm, std::span<const double> deviations_mm,
                             const std::vector<bool>& rejected);

std::string to_ply(const ResidualCloud& cloud);
/// Only of to_ply(). Throws InputError.
ResidualCloud residual_cloud_from(std::string_view ply, const std::string& name_in_messages);

/// A feature of a verification: where it stood, and its residual cloud if that was kept.
struct MeasuredFeature {
  std::string capture;                                                                  // "ball_bar-03"
  std::string artefact;                                                                 // name in artefacts.toml
  int part = 0;                                                                         // of its certificate: 0, 1, ...
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();                                   // centre; point of the plane
  Eigen::Vector3d low_mm = Eigen::Vector3d::Zero(), high_mm = Eigen::Vector3d::Zero();  // box of its points
  std::string cloud, cloud_sha256;  // "clouds/ball_bar-03-1.ply" beside the record; empty: not kept
};

/// low_mm and high_mm of the points that were not rejected (of all, where each was). At least one point.
void set_box(MeasuredFeature& feature, const ResidualCloud& cloud);

Value to_value(const MeasuredFeature& feature);
MeasuredFeature measured_feature_from(Fields fields);

}  // namespace fringecal::metrology

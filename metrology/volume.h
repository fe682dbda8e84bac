// The working volume of a scanner as samples, and how points in it depend on the scanner's parameters.
//
// Samples: what the scanner measures (pixel, u) at a point P of its world. With P' what a changed scanner makes of the
// same pixel and u,
//   d_i = T P'_i - P_i                                                                                          (1)
// T the rigid motion that brings all P' closest to the P (least squares over the volume): a calibration defines its own
// world, and the place of a world is no property of the measuring. What is left is what lengths and forms would differ by.
// Derivatives are numeric central differences at one standard uncertainty, T adapted. mm, frame world.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"

#include <optional>
#include <span>
#include <vector>

namespace fringecal::metrology {

struct VolumeSample {
  Eigen::Vector2d pixel;
  double u = 0;
  Eigen::Vector3d point_mm;
};

/// A grid of pixels times heights.
struct VolumeGrid {
  // Absent: the volume that the scanner's closed form was fitted over, else 8 % of L either way.
  std::optional<double> z_min_mm = {}, z_max_mm = {};
  int columns = 9, rows = 7, heights = 5;
};

/// Lowest and highest height of a grid on a scanner.
std::pair<double, double> heights_of(const model::Scanner& scanner, const VolumeGrid& grid);
/// What camera and code both cover of the grid.
std::vector<VolumeSample> samples_of(const model::Scanner& scanner, const VolumeGrid& grid);
/// A point of the world; empty where camera or code do not cover it.
std::optional<VolumeSample> sample_at(const model::Scanner& scanner, const Eigen::Vector3d& point_mm);

/// What a scanner makes of the samples, in its own world; empty where one is out of its reach.
std::optional<Eigen::Matrix3Xd> seen_by(const model::Scanner& scanner, std::span<const VolumeSample> samples);

/// Eq. 1 for all points.
Eigen::Matrix3Xd difference(const Eigen::Matrix3Xd& points, const Eigen::Matrix3Xd& onto);

/// dd/d(parameter), a column per parameter, x y z of each point: first of the volume's points (whose motion is taken off),
/// then of `more` with the same motion.
Result<Eigen::MatrixXd> derivatives(const model::Scanner& scanner, std::span<const VolumeSample> volume,
                                    std::span<const VolumeSample> more = {});

}  // namespace fringecal::metrology

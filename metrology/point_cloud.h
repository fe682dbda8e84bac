// PointCloud: what a measurement gives. Frame `world` (calib/model/scanner.h), mm.
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

namespace fringecal::metrology {

struct CloudPoint {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // unit, towards the camera; zero vector where it was not sensible
  double u_along_ray_mm = 0;  // standard uncertainty along the camera's ray, from the phase noise of this pixel alone
  float modulation = 0;       // grey levels: the quality figure that does not depend on the model
  std::uint16_t pixel_x = 0, pixel_y = 0;
};

struct PointCloud {
  std::vector<CloudPoint> points;
  std::vector<Eigen::Vector3d> positions_mm() const;
};

/// For people: the box around the points, and the middle one of their uncertainties. At least one point.
struct CloudSummary {
  Eigen::Vector3d min_mm = Eigen::Vector3d::Zero(), max_mm = Eigen::Vector3d::Zero();
  double median_u_along_ray_mm = 0;
};
CloudSummary summary_of(const PointCloud& cloud);

/// Binary little-endian PLY: x y z nx ny nz u_mm modulation pixel_x pixel_y. Positions are doubles. deviation_mm: empty, or of
/// each point its signed distance from a reference surface, as the last property.
void write_ply(const std::filesystem::path& file, const PointCloud& cloud, std::span<const float> deviation_mm = {});
/// The deviations of a file that has them are left behind.
PointCloud read_ply(const std::filesystem::path& file);

}  // namespace fringecal::metrology

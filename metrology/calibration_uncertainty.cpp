#include "metrology/calibration_uncertainty.h"

#include "calib/model/triangulate.h"

#include <fmt/format.h>

#include <cmath>

namespace fringecal::metrology {

std::vector<Eigen::Vector3d> retriangulate(std::span<const Eigen::Vector3d> points_mm, const model::Scanner& scanner,
                                           const model::Scanner& changed) {
  const CodeAxis axis = scanner.projector.main_axis();
  const Rigid3 cam_from_world = scanner.world_from_cam().inverse();
  const Rigid3 changed_world_from_cam = changed.world_from_cam();
  std::vector<Eigen::Vector3d> out;
  out.reserve(points_mm.size());
  for (const auto& point : points_mm) {
    const Eigen::Vector3d in_cam = cam_from_world * point;
    const auto pixel = scanner.camera.project(in_cam);
    const auto u = scanner.projector.project(axis, scanner.proj_from_cam * in_cam);
    if (!pixel || !u) continue;
    const auto moved = model::triangulate(changed.camera, changed.projector, changed.proj_from_cam, axis, *pixel, *u);
    if (moved) out.push_back(changed_world_from_cam * *moved);
  }
  return out;
}

Result<double> u_from_calibration(std::span<const Eigen::Vector3d> points_mm, const model::Scanner& scanner,
                                  const PointFunction& quantity) {
  const auto& uncertainty = scanner.uncertainty;
  const auto n = static_cast<Eigen::Index>(uncertainty.names.size());
  if (n == 0) return unanswerable("the Scanner file has no covariance, so the calibration's part of u is not known");
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const std::string& name = uncertainty.names[static_cast<std::size_t>(i)];
    const double step = std::sqrt(uncertainty.covariance(i, i));
    if (!(step > 0)) continue;
    double y[2];
    for (const int side : {0, 1}) {
      Eigen::VectorXd change = Eigen::VectorXd::Zero(n);
      change(i) = side == 0 ? -step : step;
      const auto value = quantity(retriangulate(points_mm, scanner, scanner.changed_by(change)));
      if (!value) {
        return unanswerable(fmt::format("with {} changed by its standard uncertainty the quantity has no value: {}",
                                        name, value.error().sentence));
      }
      y[side] = *value;
    }
    gradient(i) = (y[1] - y[0]) / (2.0 * step);  // eq. 1
  }
  const double variance = gradient.dot(uncertainty.covariance * gradient);
  if (!(variance >= 0.0)) return unanswerable("the Scanner file's covariance is not positive; calibrate again");
  return std::sqrt(variance);
}

}  // namespace fringecal::metrology

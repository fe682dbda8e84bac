#include "metrology/calibration_uncertainty.h"

#include "calib/model/triangulate.h"

#include <fmt/format.h>

#include <algorithm>
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
  const PointGroups one = {{points_mm.begin(), points_mm.end()}};
  const auto u =
      u_from_calibration_of_groups(one, scanner, [&](const PointGroups& moved) -> Result<std::vector<double>> {
        const auto value = quantity(moved.front());
        if (!value) return tl::unexpected(value.error());
        return std::vector<double>{*value};
      });
  if (!u) return tl::unexpected(u.error());
  return u->front();
}

namespace {

/// The quantities as a scanner with one parameter changed would have given them.
Result<std::vector<double>> quantities_with(Eigen::Index parameter, double change, const PointGroups& groups_mm,
                                            const model::Scanner& scanner, const GroupsFunction& quantities) {
  const auto& names = scanner.uncertainty.names;
  Eigen::VectorXd changes = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(names.size()));
  changes(parameter) = change;
  const model::Scanner changed = scanner.changed_by(changes);
  PointGroups moved;
  for (const auto& group : groups_mm) moved.push_back(retriangulate(group, scanner, changed));
  auto values = quantities(moved);
  if (!values) {
    return unanswerable(fmt::format("with {} changed by its standard uncertainty the quantity has no value: {}",
                                    names[static_cast<std::size_t>(parameter)], values.error().sentence));
  }
  return values;
}

}  // namespace

Result<std::vector<double>> u_from_phase_offset(const PointGroups& groups_mm, const model::Scanner& scanner,
                                                const GroupsFunction& quantities) {
  const auto& names = scanner.uncertainty.names;
  const std::string shift = scanner.projector.main_axis() == CodeAxis::x ? "projector.x.u0" : "projector.y.u0";
  const auto at = std::find(names.begin(), names.end(), shift);
  const auto prior = std::find_if(scanner.priors.begin(), scanner.priors.end(),
                                  [](const model::Prior& p) { return p.parameter == "capture.phase_offset"; });
  const double offset = at == names.end() || prior == scanner.priors.end() ? 0.0 : prior->u;
  const Eigen::Index parameter = at - names.begin();
  const auto low =
      offset > 0 ? quantities_with(parameter, -offset, groups_mm, scanner, quantities) : quantities(groups_mm);
  if (!low) return tl::unexpected(low.error());
  std::vector<double> out(low->size(), 0.0);
  if (!(offset > 0)) return out;
  const auto high = quantities_with(parameter, offset, groups_mm, scanner, quantities);
  if (!high) return tl::unexpected(high.error());
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = 0.5 * std::abs((*high)[k] - (*low)[k]);  // eq. 2
  return out;
}

Result<std::vector<double>> u_from_calibration_of_groups(const PointGroups& groups_mm, const model::Scanner& scanner,
                                                         const GroupsFunction& quantities) {
  const auto& uncertainty = scanner.uncertainty;
  const auto n = static_cast<Eigen::Index>(uncertainty.names.size());
  if (n == 0) return unanswerable("the Scanner file has no covariance, so the calibration's part of u is not known");
  Eigen::MatrixXd gradient;  // a row per quantity
  for (Eigen::Index i = 0; i < n; ++i) {
    const double step = std::sqrt(uncertainty.covariance(i, i));
    if (!(step > 0)) continue;
    std::vector<double> y[2];
    for (const int side : {0, 1}) {
      auto values = quantities_with(i, side == 0 ? -step : step, groups_mm, scanner, quantities);
      if (!values) return tl::unexpected(values.error());
      y[side] = *std::move(values);
    }
    if (gradient.size() == 0) gradient = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(y[0].size()), n);
    for (std::size_t k = 0; k < y[0].size(); ++k) {
      gradient(static_cast<Eigen::Index>(k), i) = (y[1][k] - y[0][k]) / (2.0 * step);  // eq. 1
    }
  }
  if (gradient.size() == 0) {  // every parameter is known exactly
    const auto values = quantities(groups_mm);
    if (!values) return tl::unexpected(values.error());
    return std::vector<double>(values->size(), 0.0);
  }
  std::vector<double> out;
  for (Eigen::Index k = 0; k < gradient.rows(); ++k) {
    const double variance = gradient.row(k) * uncertainty.covariance * gradient.row(k).transpose();
    if (!(variance >= 0.0)) return unanswerable("the Scanner file's covariance is not positive; calibrate again");
    out.push_back(std::sqrt(variance));
  }
  return out;
}

}  // namespace fringecal::metrology

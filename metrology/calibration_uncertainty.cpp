#include "metrology/calibration_uncertainty.h"

#include "calib/model/triangulate.h"
#include "core/error.h"

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

struct Change {
  Eigen::Index parameter = 0;
  double by = 0;
};

/// The quantities as a scanner with one parameter changed would have given them; of the groups for which `moves` says so.
Result<std::vector<double>> quantities_with(
    const Change& change, const PointGroups& groups_mm, const model::Scanner& scanner, const GroupsFunction& quantities,
    const std::function<bool(std::size_t)>& moves = [](std::size_t) { return true; }) {
  const auto& names = scanner.uncertainty.names;
  Eigen::VectorXd changes = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(names.size()));
  changes(change.parameter) = change.by;
  const model::Scanner changed = scanner.changed_by(changes);
  PointGroups moved;
  for (std::size_t g = 0; g < groups_mm.size(); ++g) {
    moved.push_back(moves(g) ? retriangulate(groups_mm[g], scanner, changed) : groups_mm[g]);
  }
  auto values = quantities(moved);
  if (!values) {
    return unanswerable(fmt::format("with {} changed by its standard uncertainty the quantity has no value: {}",
                                    names[static_cast<std::size_t>(change.parameter)], values.error().sentence));
  }
  return values;
}

}  // namespace

Result<std::vector<double>> u_from_phase_offset(const PointGroups& groups_mm, const model::Scanner& scanner,
                                                const GroupsFunction& quantities,
                                                std::span<const int> capture_of_group) {
  require(capture_of_group.empty() || capture_of_group.size() == groups_mm.size(), "each group is of one capture");
  const auto& names = scanner.uncertainty.names;
  const std::string shift = scanner.projector.main_axis() == CodeAxis::x ? "projector.x.u0" : "projector.y.u0";
  const auto at = std::find(names.begin(), names.end(), shift);
  const auto prior = std::find_if(scanner.priors.begin(), scanner.priors.end(),
                                  [](const model::Prior& p) { return p.parameter == "capture.phase_offset"; });
  const double offset = at == names.end() || prior == scanner.priors.end() ? 0.0 : prior->u;
  if (!(offset > 0)) {
    const auto values = quantities(groups_mm);
    if (!values) return tl::unexpected(values.error());
    return std::vector<double>(values->size(), 0.0);
  }
  const int captures =
      capture_of_group.empty() ? 1 : *std::max_element(capture_of_group.begin(), capture_of_group.end()) + 1;
  std::vector<double> out;
  for (int capture = 0; capture < captures; ++capture) {
    const auto moves = [&](std::size_t g) { return capture_of_group.empty() || capture_of_group[g] == capture; };
    const auto shifted = [&](double by) {
      return quantities_with({at - names.begin(), by}, groups_mm, scanner, quantities, moves);
    };
    const auto low = shifted(-offset), high = shifted(offset);
    if (!low) return tl::unexpected(low.error());
    if (!high) return tl::unexpected(high.error());
    out.resize(low->size(), 0.0);
    for (std::size_t k = 0; k < out.size(); ++k) {
      out[k] = std::hypot(out[k], 0.5 * ((*high)[k] - (*low)[k]));  // eq. 2
    }
  }
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
      auto values = quantities_with({i, side == 0 ? -step : step}, groups_mm, scanner, quantities);
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

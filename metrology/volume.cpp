#include "metrology/volume.h"

#include "calib/model/triangulate.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <cmath>

namespace fringecal::metrology {
namespace {

Eigen::Matrix4d motion(const Eigen::Matrix3Xd& points, const Eigen::Matrix3Xd& onto) {
  return Eigen::umeyama(points, onto, false);
}

Eigen::Matrix3Xd applied(const Eigen::Matrix4d& t, const Eigen::Matrix3Xd& points) {
  return (t.topLeftCorner<3, 3>() * points).colwise() + Eigen::Vector3d(t.topRightCorner<3, 1>());
}

bool covered(const model::Scanner& s, const Eigen::Vector2d& pixel, double u) {
  const auto& code = s.projector.axis(s.projector.main_axis())->code;
  return u > 0 && u < code.stripe_width() * code.stripes() && pixel.x() > -0.5 && pixel.y() > -0.5 &&
         pixel.x() < s.camera.width_px - 0.5 && pixel.y() < s.camera.height_px - 0.5;
}

}  // namespace

std::pair<double, double> heights_of(const model::Scanner& s, const VolumeGrid& grid) {
  const double reach = 0.08 * s.working_distance_mm;
  return {grid.z_min_mm.value_or(s.paper_model ? s.paper_model->z_min_mm : -reach),
          grid.z_max_mm.value_or(s.paper_model ? s.paper_model->z_max_mm : reach)};
}

std::optional<VolumeSample> sample_at(const model::Scanner& s, const Eigen::Vector3d& point) {
  const Eigen::Vector3d in_cam = s.world_from_cam().inverse() * point;
  const auto pixel = s.camera.project(in_cam);
  const auto u = s.projector.project(s.projector.main_axis(), s.proj_from_cam * in_cam);
  if (!pixel || !u || !covered(s, *pixel, *u)) return std::nullopt;
  return VolumeSample{*pixel, *u, point};
}

std::vector<VolumeSample> samples_of(const model::Scanner& s, const VolumeGrid& grid) {
  const auto [low, high] = heights_of(s, grid);
  const Rigid3 world_from_cam = s.world_from_cam(), cam_from_world = world_from_cam.inverse();
  std::vector<VolumeSample> out;
  for (int h = 0; h < grid.heights; ++h) {
    const double z = low + (high - low) * (grid.heights > 1 ? h / (grid.heights - 1.0) : 0.5);
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        const Eigen::Vector2d pixel((column + 0.5) * s.camera.width_px / grid.columns,
                                    (row + 0.5) * s.camera.height_px / grid.rows);
        const auto ray = s.camera.ray(pixel);
        if (!ray) continue;
        const Eigen::Vector3d direction = world_from_cam.rotation * *ray, eye = world_from_cam.translation_mm;
        if (!(direction.z() < 0)) continue;  // world's Z points at the scanner
        const Eigen::Vector3d point = eye + (z - eye.z()) / direction.z() * direction;
        const auto u = s.projector.project(s.projector.main_axis(), s.proj_from_cam * (cam_from_world * point));
        if (u && covered(s, pixel, *u)) out.push_back({pixel, *u, point});
      }
    }
  }
  return out;
}

std::optional<Eigen::Matrix3Xd> seen_by(const model::Scanner& s, std::span<const VolumeSample> samples) {
  Eigen::Matrix3Xd out(3, static_cast<Eigen::Index>(samples.size()));
  const Rigid3 world_from_cam = s.world_from_cam();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto p = model::triangulate(s.camera, s.projector, s.proj_from_cam, s.projector.main_axis(), samples[i].pixel,
                                      samples[i].u);
    if (!p) return std::nullopt;
    out.col(static_cast<Eigen::Index>(i)) = world_from_cam * *p;
  }
  return out;
}

Eigen::Matrix3Xd difference(const Eigen::Matrix3Xd& points, const Eigen::Matrix3Xd& onto) {
  return applied(motion(points, onto), points) - onto;
}

Result<Eigen::MatrixXd> derivatives(const model::Scanner& s, std::span<const VolumeSample> volume,
                                    std::span<const VolumeSample> more) {
  const auto n = static_cast<Eigen::Index>(s.uncertainty.names.size());
  if (n == 0) return unanswerable(fmt::format("the Scanner '{}' has no covariance; calibrate it here", s.name));
  const auto nv = static_cast<Eigen::Index>(volume.size()), nm = static_cast<Eigen::Index>(more.size());
  Eigen::Matrix3Xd onto(3, nv);
  for (Eigen::Index i = 0; i < nv; ++i) onto.col(i) = volume[static_cast<std::size_t>(i)].point_mm;
  Eigen::MatrixXd by(3 * (nv + nm), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double step = std::sqrt(s.uncertainty.covariance(k, k));
    if (!(step > 0)) {
      by.col(k).setZero();
      continue;
    }
    Eigen::Matrix3Xd side[2];
    for (const int sign : {0, 1}) {
      const model::Scanner changed = s.changed_by((sign == 0 ? -step : step) * Eigen::VectorXd::Unit(n, k));
      const auto v = seen_by(changed, volume), m = seen_by(changed, more);
      if (!v || !m) {
        return unanswerable(fmt::format("within its uncertainty of {} the Scanner '{}' does not see the whole volume",
                                        s.uncertainty.names[static_cast<std::size_t>(k)], s.name));
      }
      const Eigen::Matrix4d t = motion(*v, onto);
      side[sign].resize(3, nv + nm);
      side[sign] << applied(t, *v), applied(t, *m);
    }
    const Eigen::Matrix3Xd change = (side[1] - side[0]) / (2.0 * step);
    by.col(k) = Eigen::Map<const Eigen::VectorXd>(change.data(), change.size());
  }
  return by;
}

}  // namespace fringecal::metrology

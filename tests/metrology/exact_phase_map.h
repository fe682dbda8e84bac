// Phase maps without error: surfaces given by their intersection with a ray, seen and lit through a Scanner.
#pragma once

#include "calib/decode/decode.h"
#include "calib/model/scanner.h"

#include <cmath>
#include <functional>
#include <limits>
#include <optional>

namespace fringecal::test {

/// The parameter l > 0 of the first point origin + l direction of the surface, in world.
using Surface = std::function<std::optional<double>(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction)>;

inline Surface plane(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const double l = normal.dot(point - o) / normal.dot(d);
    return l > 0 ? std::optional(l) : std::nullopt;
  };
}

inline Surface sphere(const Eigen::Vector3d& centre, double radius) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const Eigen::Vector3d e = d.normalized();
    const double middle = e.dot(centre - o), h2 = radius * radius - (o + middle * e - centre).squaredNorm();
    // Beyond 75 degrees from the normal a ray is taken to miss: the phase of a real rim is no use either.
    if (h2 < 0.067 * radius * radius) return std::nullopt;
    return (middle - std::sqrt(h2)) / d.norm();
  };
}

/// A camera of 320 x 240 with 1.4 mm per pixel at the working distance of 1000 mm, projector like the default
/// instrument's.
inline model::Scanner sample_scanner() {
  model::Scanner s;
  s.camera = {.width_px = 320,
              .height_px = 240,
              .fx_px = 855,
              .fy_px = 856,
              .cx_px = 161.3,
              .cy_px = 118.2,
              .distortion = {-0.10, 0.06, 2e-4, -1.5e-4, 0.0},
              .pixel_mm = 0.028};
  s.projector.x = model::ProjectorAxis{.code = {7, 4, 2, 0.24, "mm"}, .f = 32.0, .u0 = 7.68 + 0.15};
  s.projector.distortion = {-0.08, 0.03, 0, 0, 0};
  s.working_distance_mm = 1000;
  // The camera stands at +X beside the projector and looks towards the origin on R.
  const Rigid3 world_from_proj = s.world_from_proj();
  const double alpha = std::atan(0.4);
  Eigen::Matrix3d world_from_cam;
  world_from_cam.col(2) = Eigen::Vector3d(-std::sin(alpha), 0.002, -std::cos(alpha)).normalized();
  world_from_cam.col(0) = Eigen::Vector3d(std::cos(alpha), 0.004, -std::sin(alpha)).normalized();
  world_from_cam.col(1) = world_from_cam.col(2).cross(world_from_cam.col(0)).normalized();
  world_from_cam.col(0) = world_from_cam.col(1).cross(world_from_cam.col(2));
  const Rigid3 cam{Eigen::Quaterniond(world_from_cam), Eigen::Vector3d(400, 3, 1000)};
  s.proj_from_cam = world_from_proj.inverse() * cam;
  return s;
}

/// The paper's geometry exactly: base line parallel to R, camera turned about Y only, lenses without distortion.
inline model::Scanner ideal_scanner() {
  model::Scanner s = sample_scanner();
  s.camera.distortion = {};
  s.camera.fy_px = s.camera.fx_px;
  s.projector.distortion = {};
  const double alpha = std::atan(0.4);
  Eigen::Matrix3d world_from_cam;
  world_from_cam.col(2) = Eigen::Vector3d(-std::sin(alpha), 0, -std::cos(alpha));
  world_from_cam.col(0) = Eigen::Vector3d(std::cos(alpha), 0, -std::sin(alpha));
  world_from_cam.col(1) = world_from_cam.col(2).cross(world_from_cam.col(0));
  s.proj_from_cam =
      s.world_from_proj().inverse() * Rigid3{Eigen::Quaterniond(world_from_cam), Eigen::Vector3d(400, 0, 1000)};
  return s;
}

inline decode::PhaseMap exact_map(const model::Scanner& scanner, const Surface& surface, double u_phase_rad = 0.01) {
  const int width = scanner.camera.width_px, height = scanner.camera.height_px;
  decode::PhaseMap map;
  map.axis = CodeAxis::x;
  map.code = scanner.projector.x->code;
  map.phase_rad = Image<float>(width, height, std::numeric_limits<float>::quiet_NaN());
  map.modulation = Image<float>(width, height, 80.0f);
  map.mean = Image<float>(width, height, 100.0f);
  map.u_phase_rad = Image<float>(width, height, static_cast<float>(u_phase_rad));
  map.validity = Image<std::uint8_t>(width, height, 1);
  const Rigid3 world_from_cam = scanner.world_from_cam(), proj_from_world = scanner.world_from_proj().inverse();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto ray = scanner.camera.ray({static_cast<double>(x), static_cast<double>(y)});
      if (!ray) continue;
      const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
      const auto l = surface(world_from_cam.translation_mm, direction);
      if (!l) continue;
      const auto u =
          scanner.projector.project(CodeAxis::x, proj_from_world * (world_from_cam.translation_mm + *l * direction));
      if (!u) continue;
      map.phase_rad(x, y) = static_cast<float>(map.code.phase_from_u(*u));
      map.validity(x, y) = 0;
    }
  }
  return map;
}

}  // namespace fringecal::test

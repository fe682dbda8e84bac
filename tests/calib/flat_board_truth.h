// The true phase of a flat board under the virtual scanner, from its geometry alone, and the periodic part of a map's
// error against it. Nothing of the estimators is in here.
#pragma once

#include "calib/decode/decode.h"
#include "hw/virtual/virtual_scanner.h"

#include <Eigen/Dense>

#include <array>
#include <cmath>

namespace fringecal::test {

/// Absolute phase of the first object's plane (z = 0 of its part frame) at every pixel.
inline Image<double> true_phase(const virt::VirtualScanner& instrument, const virt::Scene& scene,
                                const virt::InstrumentState& state) {
  const model::Scanner truth = instrument.true_scanner(state);
  const Rigid3 cam_from_part = instrument.preset_from_cam(state).inverse() * scene.objects.front().world_from_part;
  const Eigen::Vector3d normal = cam_from_part.rotation * Eigen::Vector3d::UnitZ();
  const double distance = normal.dot(cam_from_part.translation_mm);
  Image<double> out(truth.camera.width_px, truth.camera.height_px);
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      const Eigen::Vector3d ray = truth.camera.ray({x, y}).value();
      const Eigen::Vector3d point = ray * (distance / normal.dot(ray));
      out(x, y) =
          instrument.plan().x->phase_from_u(truth.projector.project(CodeAxis::x, truth.proj_from_cam * point).value());
    }
  }
  return out;
}

struct PeriodicError {
  Eigen::Vector3d amplitude_rad = Eigen::Vector3d::Zero();  // of 1, 2 and 4 cycles per period
  double scatter = 0;                                       // rms of what is left, in units of the map's own u(phi)
};

/// (map - truth) in a rectangle of the picture, every second column; what is smooth (a quadratic in x and y) is fitted
/// with the ripples.
inline PeriodicError periodic_error(const decode::PhaseMap& map, const Image<double>& truth,
                                    std::array<int, 4> x0_y0_x1_y1) {
  using Vector = Eigen::Matrix<double, 12, 1>;
  const auto [x0, y0, x1, y1] = x0_y0_x1_y1;
  const auto terms = [&, x0 = x0, y0 = y0, x1 = x1, y1 = y1](int x, int y) {
    const double phi = truth(x, y), s = 2.0 * (x - x0) / (x1 - x0) - 1, t = 2.0 * (y - y0) / (y1 - y0) - 1;
    Vector f;
    f << 1, s, t, s * s, s * t, t * t, std::cos(phi), std::sin(phi), std::cos(2 * phi), std::sin(2 * phi),
        std::cos(4 * phi), std::sin(4 * phi);
    return f;
  };
  Eigen::Matrix<double, 12, 12> normal = Eigen::Matrix<double, 12, 12>::Zero();
  Vector right = Vector::Zero(), a = Vector::Zero();
  PeriodicError out;
  double sum = 0, n = 0;
  for (const bool solved : {false, true}) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; x += 2) {
        if (!map.valid(x, y)) continue;
        const Vector f = terms(x, y);
        const double error = map.phase_rad(x, y) - truth(x, y);
        if (solved) {
          sum += std::pow((error - f.dot(a)) / map.u_phase_rad(x, y), 2);
          n += 1;
        } else {
          normal.selfadjointView<Eigen::Lower>().rankUpdate(f);
          right += f * error;
        }
      }
    }
    if (!solved) a = normal.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  }
  out.amplitude_rad = {std::hypot(a[6], a[7]), std::hypot(a[8], a[9]), std::hypot(a[10], a[11])};
  out.scatter = std::sqrt(sum / n);
  return out;
}

}  // namespace fringecal::test

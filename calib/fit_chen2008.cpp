#include "calib/fit_chen2008.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

namespace fringecal::calib {
namespace {

using model::Chen2008Model;

constexpr double kDamping_mm = 1e-4;                  // lambda of eq. 1
constexpr int kAcross = 24, kDown = 18, kPlanes = 9;  // the residual field is smooth: cubic in the image, linear in Z
constexpr int kGeometry = 8, kDistortion = 4;

struct Sample {
  Eigen::Vector2d pixel;
  double phi_obj, phi_ref;
  Eigen::Vector3d point_mm;  // world
};

std::vector<Sample> samples_of(const model::Scanner& full, const WorkingVolume& volume) {
  const model::Camera& camera = full.camera;
  const CodeAxis axis = full.projector.main_axis();
  const FringeCode& code = full.projector.axis(axis)->code;
  const Rigid3 world_from_cam = full.world_from_cam(), proj_from_world = full.world_from_proj().inverse();
  std::vector<Sample> samples;
  for (int r = 0; r < kDown; ++r) {
    for (int c = 0; c < kAcross; ++c) {
      const Eigen::Vector2d pixel(c * (camera.width_px - 1.0) / (kAcross - 1),
                                  r * (camera.height_px - 1.0) / (kDown - 1));
      const auto ray = camera.ray(pixel);
      if (!ray) continue;
      const Eigen::Vector3d origin = world_from_cam.translation_mm, direction = world_from_cam.rotation * *ray;
      const auto at = [&](double z) -> std::optional<Eigen::Vector3d> {
        const double l = (z - origin.z()) / direction.z();
        return l > 0 ? std::optional<Eigen::Vector3d>(origin + l * direction) : std::nullopt;
      };
      const auto lit_by = [&](const std::optional<Eigen::Vector3d>& point) {
        return point ? full.projector.project(axis, proj_from_world * *point) : std::nullopt;
      };
      const auto u_ref = lit_by(at(0.0));
      if (!u_ref) continue;
      for (int k = 0; k < kPlanes; ++k) {
        const auto point = at(volume.z_min_mm + k * (volume.z_max_mm - volume.z_min_mm) / (kPlanes - 1));
        const auto u = lit_by(point);
        if (!u || !(*u >= 0 && *u <= code.stripes() * code.stripe_width())) continue;
        samples.push_back({pixel, code.phase_from_u(*u), code.phase_from_u(*u_ref), *point});
      }
    }
  }
  return samples;
}

/// q as the solver has it: x = 1 + (q - q_0) / s, so that the relative step of the numeric derivative is one of s.
class Scaling {
 public:
  Scaling(const model::Scanner& full, const Chen2008Model& start, std::span<const Sample> samples) : start_(start) {
    double sensor2 = 0, field2 = 0;  // largest r^2 on the sensor and on R, mm^2
    for (const Sample& s : samples) {
      const Eigen::Vector2d d = s.pixel - Eigen::Vector2d(full.camera.cx_px, full.camera.cy_px);
      sensor2 = std::max(sensor2, d.squaredNorm() * start.s_mm * start.s_mm);
      field2 = std::max(field2, s.point_mm.head<2>().squaredNorm());
    }
    geometry_ = {0.01 * start.L_mm,
                 0.01 * std::abs(start.b_mm),
                 0.01,
                 0.01 * start.p_R_mm,
                 1.0,
                 0.01 * start.f_C_mm,
                 10.0,
                 10.0};
    distortion_ = {0.01 / sensor2, 0.01 / (sensor2 * sensor2), 0.01 / field2, 0.01 / (field2 * field2)};
  }

  Chen2008Model model(const double* geometry, const double* distortion) const {
    Chen2008Model m = start_;
    const auto geometric = geometric_places(m);
    const auto lens = distortion_places(m);
    for (std::size_t k = 0; k < kGeometry; ++k) *geometric[k] += (geometry[k] - 1.0) * geometry_[k];
    for (std::size_t k = 0; k < kDistortion; ++k) *lens[k] += (distortion[k] - 1.0) * distortion_[k];
    return m;
  }

 private:
  static std::array<double*, kGeometry> geometric_places(Chen2008Model& m) {
    return {&m.L_mm, &m.b_mm, &m.alpha_rad, &m.p_R_mm, &m.phi_O_rad, &m.f_C_mm, &m.i_C_px, &m.j_C_px};
  }
  static std::array<double*, kDistortion> distortion_places(Chen2008Model& m) {
    return {&m.kc1_per_mm2, &m.kc2_per_mm4, &m.kp1_per_mm2, &m.kp2_per_mm4};
  }

  Chen2008Model start_;
  std::array<double, kGeometry> geometry_{};
  std::array<double, kDistortion> distortion_{};
};

/// One sample's share of eq. 1.
struct PointResidual {
  const Scaling& scaling;
  const Sample& sample;
  double weight;

  bool operator()(const double* geometry, const double* distortion, double* residual) const {
    const auto m = scaling.model(geometry, distortion);
    const auto point = m.point_mm(sample.pixel, sample.phi_obj, sample.phi_ref, true);
    if (!point || !point->allFinite()) return false;
    Eigen::Map<Eigen::Vector3d> out(residual);
    out = weight * (*point - sample.point_mm);
    return true;
  }
};

/// The damping of eq. 1 on one block.
template <int N>
struct Damping {
  template <class T>
  bool operator()(const T* x, T* residual) const {
    for (int k = 0; k < N; ++k) residual[k] = kDamping_mm * (x[k] - 1.0);
    return true;
  }
};

}  // namespace

WorkingVolume board_extent(const model::Scanner& scanner) {
  const Rigid3 world_from_cam = scanner.world_from_cam();
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < scanner.observations.size() && scanner.board; ++i) {
    for (const auto& corner : scanner.observations[i].corners) {
      if (!corner.used) continue;
      const Eigen::Vector3d in_board = scanner.board->corner_mm(corner.column, corner.row);
      const double z = (world_from_cam * (scanner.cam_from_board[i] * in_board)).z();
      low = std::min(low, z);
      high = std::max(high, z);
    }
  }
  return low <= high ? WorkingVolume{low, high} : WorkingVolume{0, 0};
}

Result<model::FittedChen2008> fit_chen2008(const model::Scanner& full, const WorkingVolume& volume,
                                           PaperEquations equations) {
  if (!(volume.z_max_mm - volume.z_min_mm >= 0.01 * full.working_distance_mm)) {
    return unanswerable(
        fmt::format("the working volume reaches from Z = {:.2f} mm to {:.2f} mm; the paper's parameters need "
                    "at least 1 % of the working distance of {:.0f} mm",
                    volume.z_min_mm, volume.z_max_mm, full.working_distance_mm));
  }
  const std::vector<Sample> samples = samples_of(full, volume);
  if (samples.size() < 100) {
    return unanswerable(
        fmt::format("the camera sees the grating's light at {} of {} places of the working volume; the "
                    "paper's parameters need 100",
                    samples.size(), kAcross * kDown * kPlanes));
  }
  const bool distorted = equations == PaperEquations::to_20;
  Chen2008Model start = model::chen2008_from(full);
  if (!distorted) start.kc1_per_mm2 = start.kc2_per_mm4 = start.kp1_per_mm2 = start.kp2_per_mm4 = 0;
  // The base line of the paper lies across the fringes; along them, eq. 1 divides by next to nothing.
  if (!(std::abs(start.b_mm) >= 0.01 * full.working_distance_mm)) {
    return unanswerable(
        fmt::format("the base line is {:.2f} mm across the fringes; the paper's formulas need at least 1 % "
                    "of the working distance of {:.0f} mm",
                    start.b_mm, full.working_distance_mm));
  }

  const Scaling scaling(full, start, samples);
  std::array<double, kGeometry> geometry;
  std::array<double, kDistortion> distortion;
  geometry.fill(1.0);
  distortion.fill(1.0);
  ceres::Problem problem;
  const double weight = 1.0 / std::sqrt(static_cast<double>(samples.size()));
  for (const Sample& sample : samples) {
    problem.AddResidualBlock(
        new ceres::NumericDiffCostFunction<PointResidual, ceres::CENTRAL, 3, kGeometry, kDistortion>(
            new PointResidual{scaling, sample, weight}),
        nullptr, geometry.data(), distortion.data());
  }
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<Damping<kGeometry>, kGeometry, kGeometry>(new Damping<kGeometry>), nullptr,
      geometry.data());
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<Damping<kDistortion>, kDistortion, kDistortion>(new Damping<kDistortion>),
      nullptr, distortion.data());
  if (!distorted) problem.SetParameterBlockConstant(distortion.data());

  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-12;
  options.gradient_tolerance = 1e-16;  // mm^2 per s: the cost's unit is mm^2
  options.parameter_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (summary.termination_type != ceres::CONVERGENCE) {
    return unanswerable(
        fmt::format("the paper's closed form cannot be fitted to this scanner's geometry: {}", summary.message));
  }

  model::FittedChen2008 fitted{.model = scaling.model(geometry.data(), distortion.data()),
                               .z_min_mm = volume.z_min_mm,
                               .z_max_mm = volume.z_max_mm,
                               .samples = static_cast<int>(samples.size())};
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  double largest = 0;
  for (const Sample& s : samples) {
    const auto point = fitted.model.point_mm(s.pixel, s.phi_obj, s.phi_ref, distorted);
    if (!point) return unanswerable("the fitted closed form has no point where the full model has one");
    const Eigen::Vector3d error = *point - s.point_mm;
    squares += error.cwiseAbs2();
    largest = std::max(largest, error.norm());
  }
  fitted.rms_xyz_mm = weight * squares.cwiseSqrt();
  fitted.max_mm = largest;
  return fitted;
}

Result<model::Scanner> with_paper_models(model::Scanner scanner) {
  const WorkingVolume volume = board_extent(scanner);
  auto distorted = fit_chen2008(scanner, volume, PaperEquations::to_20);
  if (!distorted) return tl::unexpected(distorted.error());
  auto ideal = fit_chen2008(scanner, volume, PaperEquations::to_17);
  if (!ideal) return tl::unexpected(ideal.error());
  scanner.paper_model = *distorted;
  scanner.paper_ideal_model = *ideal;
  return scanner;
}

}  // namespace fringecal::calib

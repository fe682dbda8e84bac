#include "calib/next_pose.h"

#include "calib/bundle_rows.h"
#include "calib/bundle_system.h"
#include "calib/halves.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::calib {
namespace {

/// The readings' uncertainties so far: root mean square over the corners in use.
struct Noise {
  double pixel = 0, x = 0, y = 0;
};
Noise noise_of(const model::Scanner& s) {
  double sums[3] = {}, counts[3] = {};
  for (const auto& o : s.observations) {
    for (const auto& c : o.corners) {
      if (!c.used) continue;
      const double u[3] = {c.u_pixel_px, c.x ? c.x->u : 0.0, c.y ? c.y->u : 0.0};
      for (const std::size_t k : {0U, 1U, 2U}) {
        sums[k] += u[k] * u[k];
        counts[k] += u[k] > 0;
      }
    }
  }
  const auto rms = [&](std::size_t k) { return counts[k] > 0 ? std::sqrt(sums[k] / counts[k]) : 0.0; };
  return {rms(0), rms(1), rms(2)};
}

double prior_u(const model::Scanner& s, const std::string& parameter) {
  for (const auto& p : s.priors) {
    if (p.parameter == parameter) return p.u;
  }
  return 0.0;
}

/// What one pose would show; the sights of a bundle of that pose alone.
std::vector<Sight> sights_of(const model::Scanner& s, const Bundle& b, const Noise& noise) {
  std::vector<Sight> out;
  const auto inside = [](const std::optional<model::ProjectorAxis>& axis, const std::optional<double>& u) {
    return !axis || (u && *u > 0 && *u < axis->code.stripe_width() * axis->code.stripes());
  };
  for (std::size_t t = 0; t < b.targets_mm.size(); ++t) {
    const Eigen::Vector3d in_cam =
        b.cam_from_board.front() * Eigen::Vector3d(b.targets_mm[t].x(), b.targets_mm[t].y(), 0);
    const Eigen::Vector3d in_proj = s.proj_from_cam * in_cam;
    const auto pixel = s.camera.project(in_cam);
    const auto x = s.projector.project(CodeAxis::x, in_proj), y = s.projector.project(CodeAxis::y, in_proj);
    if (!pixel || !inside(s.projector.x, x) || !inside(s.projector.y, y)) continue;
    if (pixel->x() < 0 || pixel->y() < 0 || pixel->x() > s.camera.width_px - 1 || pixel->y() > s.camera.height_px - 1) {
      continue;
    }
    Sight sight{0, static_cast<int>(t), *pixel, noise.pixel, {}, {}, true};
    if (x && noise.x > 0) sight.x = Uncertain{*x, noise.x};
    if (y && noise.y > 0) sight.y = Uncertain{*y, noise.y};
    out.push_back(sight);
  }
  return out;
}

double worst_of(const Eigen::MatrixXd& by, const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd variances = (by * covariance).cwiseProduct(by).rowwise().sum();
  double worst = 0;
  for (Eigen::Index i = 0; i + 2 < variances.size(); i += 3) worst = std::max(worst, variances.segment<3>(i).sum());
  return std::sqrt(worst);
}

/// Inverse of a symmetric positive definite matrix whose rows have different units.
std::optional<Eigen::MatrixXd> inverse_of(const Eigen::MatrixXd& m) {
  if (!(m.diagonal().minCoeff() > 0)) return std::nullopt;
  const Eigen::VectorXd scale = m.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LLT<Eigen::MatrixXd> llt(scale.asDiagonal() * m * scale.asDiagonal());
  if (llt.info() != Eigen::Success) return std::nullopt;
  return Eigen::MatrixXd(scale.asDiagonal() *
                         Eigen::MatrixXd(llt.solve(Eigen::MatrixXd::Identity(m.rows(), m.rows()))) *
                         scale.asDiagonal());
}

}  // namespace

Result<NextPose> propose_next_pose(const model::Scanner& s, const Eigen::MatrixXd& by,
                                   std::pair<double, double> heights_mm) {
  if (!s.board || s.observations.empty()) {
    return unanswerable(fmt::format("the Scanner '{}' does not keep the views of its board", s.name));
  }
  const auto now = inverse_of(s.uncertainty.covariance);
  if (!now)
    return unanswerable("the Scanner's covariance cannot be inverted: parameters that were held, or one for two");
  Bundle bundle;
  const Eigen::Vector3d last = s.board->corner_mm(s.board->columns - 1, s.board->rows - 1), middle = 0.5 * last;
  for (int row = 0; row < s.board->rows; ++row) {
    for (int column = 0; column < s.board->columns; ++column) {
      bundle.targets_mm.push_back(s.board->corner_mm(column, row).head<2>());
    }
  }
  bundle.camera = s.camera;
  bundle.projector = s.projector;
  bundle.proj_from_cam = s.proj_from_cam;
  bundle.print_mm.resize(bundle.targets_mm.size(), Eigen::Vector3d::Zero());
  bundle.bend_mm.resize(1, Eigen::Vector3d::Zero());
  bundle.phase_offset.resize(1, Eigen::Vector2d::Zero());
  bundle.cam_from_board.resize(1);
  const std::string along =
      s.projector.main_axis() == CodeAxis::x ? "proj_from_cam.translation_y_mm" : "proj_from_cam.translation_x_mm";
  const FreeTerms free{terms_of(s.camera.distortion), terms_of(s.projector.distortion)};
  const Components components{.bend_mm = prior_u(s, "board.bend_mm"),
                              .phase_offset = prior_u(s, "capture.phase_offset"),
                              .along_mm = prior_u(s, along)};
  const Noise noise = noise_of(s);
  NextPose out;
  out.worst_now_mm = worst_of(by, s.uncertainty.covariance);
  const Rigid3 world_from_cam = s.world_from_cam();
  const std::pair<double, double> turns[] = {{0, 0},  {25, 0},  {-25, 0}, {0, 25}, {0, -25},
                                             {40, 0}, {-40, 0}, {0, 40},  {0, -40}};
  for (int place = 0; place < 27; ++place) {
    const int column = place % 3, row = place / 3 % 3, layer = place / 9;
    const Eigen::Vector2d pixel((0.3 + 0.2 * column) * s.camera.width_px, (0.3 + 0.2 * row) * s.camera.height_px);
    const double z = heights_mm.first + (heights_mm.second - heights_mm.first) * 0.5 * layer;
    const auto ray = s.camera.ray(pixel);
    if (!ray) continue;
    const Eigen::Vector3d direction = world_from_cam.rotation * *ray, eye = world_from_cam.translation_mm;
    if (!(direction.z() < 0)) continue;
    const Eigen::Vector3d at = (z - eye.z()) / direction.z() * *ray;  // the middle, in cam
    for (const auto& [about_x, about_y] : turns) {
      const double radians = std::numbers::pi / 180.0;
      const Eigen::Quaterniond turn(Eigen::AngleAxisd(about_x * radians, Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(about_y * radians, Eigen::Vector3d::UnitY()));
      bundle.cam_from_board.front() = {turn, at - turn * middle};
      bundle.sights = sights_of(s, bundle, noise);
      if (2 * bundle.sights.size() < bundle.targets_mm.size() || bundle.sights.size() < 8) continue;
      rows::set_slopes(bundle);
      BundleSystem system(bundle, free, components);
      if (system.reported() != now->rows() ||
          !std::equal(s.uncertainty.names.begin(), s.uncertainty.names.end(), system.names().begin())) {
        return unanswerable("the Scanner's covariance is not of a joint solve of all its parameters");
      }
      const auto information = system.information(bundle);
      if (!information) continue;
      const auto after = inverse_of(*now + *information);  // eq. 1
      if (!after) continue;
      out.best.push_back(
          {world_from_cam * at, about_x, about_y, static_cast<int>(bundle.sights.size()), worst_of(by, *after)});
    }
  }
  if (out.best.empty()) {
    return unanswerable(
        "no place in the volume shows half of the board to both camera and projector; use a smaller board");
  }
  std::stable_sort(out.best.begin(), out.best.end(),
                   [](const auto& a, const auto& b) { return a.worst_mm < b.worst_mm; });
  if (out.best.size() > 5) out.best.resize(5);
  return out;
}

std::string words_of(const ProposedPose& p, double worst_now_mm) {
  const std::string turned =
      p.about_x_deg != 0   ? fmt::format("turned by {:+.0f} degrees about the image's x axis", p.about_x_deg)
      : p.about_y_deg != 0 ? fmt::format("turned by {:+.0f} degrees about the image's y axis", p.about_y_deg)
                           : std::string("facing the camera");
  return fmt::format(
      "hold the board with its middle at ({:.0f}, {:.0f}, {:.0f}) mm, {}: the worst point goes from {:.4f} to {:.4f} "
      "mm",
      p.middle_in_world_mm.x(), p.middle_in_world_mm.y(), p.middle_in_world_mm.z(), turned, worst_now_mm, p.worst_mm);
}

}  // namespace fringecal::calib

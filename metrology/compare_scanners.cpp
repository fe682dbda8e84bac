#include "metrology/compare_scanners.h"

#include "calib/model/triangulate.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <cmath>

namespace fringecal::metrology {
namespace {

struct Sample {
  Eigen::Vector2d pixel;
  double u = 0;
  Eigen::Vector3d point;  // P_A, world of A
};

std::vector<Sample> samples_of(const model::Scanner& a, const CompareOptions& o) {
  const double reach = 0.08 * a.working_distance_mm;
  const double low = o.z_min_mm.value_or(a.paper_model ? a.paper_model->z_min_mm : -reach);
  const double high = o.z_max_mm.value_or(a.paper_model ? a.paper_model->z_max_mm : reach);
  const CodeAxis axis = a.projector.main_axis();
  const auto& code = a.projector.axis(axis)->code;
  const double end = code.stripe_width() * code.stripes();
  const Rigid3 world_from_cam = a.world_from_cam(), cam_from_world = world_from_cam.inverse();
  std::vector<Sample> out;
  for (int h = 0; h < o.heights; ++h) {
    const double z = low + (high - low) * (o.heights > 1 ? h / (o.heights - 1.0) : 0.5);
    for (int row = 0; row < o.rows; ++row) {
      for (int column = 0; column < o.columns; ++column) {
        const Eigen::Vector2d pixel((column + 0.5) * a.camera.width_px / o.columns,
                                    (row + 0.5) * a.camera.height_px / o.rows);
        const auto ray = a.camera.ray(pixel);
        if (!ray) continue;
        const Eigen::Vector3d direction = world_from_cam.rotation * *ray, eye = world_from_cam.translation_mm;
        if (!(direction.z() < 0)) continue;  // world's Z points at the scanner
        const Eigen::Vector3d point = eye + (z - eye.z()) / direction.z() * direction;
        const auto u = a.projector.project(axis, a.proj_from_cam * (cam_from_world * point));
        if (u && *u > 0 && *u < end) out.push_back({pixel, *u, point});
      }
    }
  }
  return out;
}

/// What a scanner makes of the samples, in its own world; empty where one is out of its reach.
std::optional<Eigen::Matrix3Xd> seen_by(const model::Scanner& s, const std::vector<Sample>& samples) {
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

/// Eq. 1 for all points.
Eigen::Matrix3Xd difference(const Eigen::Matrix3Xd& points, const Eigen::Matrix3Xd& onto) {
  const Eigen::Matrix4d t = Eigen::umeyama(points, onto, false);
  return ((t.topLeftCorner<3, 3>() * points).colwise() + Eigen::Vector3d(t.topRightCorner<3, 1>())) - onto;
}

/// Diagonals of one scanner's part of eq. 2.
Result<Eigen::Matrix3Xd> variances(const model::Scanner& s, const std::vector<Sample>& samples,
                                   const Eigen::Matrix3Xd& onto) {
  const auto n = static_cast<Eigen::Index>(s.uncertainty.names.size());
  if (n == 0) return unanswerable(fmt::format("the Scanner '{}' has no covariance", s.name));
  Eigen::MatrixXd by(onto.size(), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double step = std::sqrt(s.uncertainty.covariance(k, k));
    const auto up = seen_by(s.changed_by(step * Eigen::VectorXd::Unit(n, k)), samples);
    const auto down = seen_by(s.changed_by(-step * Eigen::VectorXd::Unit(n, k)), samples);
    if (!up || !down) {
      return unanswerable(fmt::format("within its uncertainty of {} the Scanner '{}' does not see the whole volume",
                                      s.uncertainty.names[static_cast<std::size_t>(k)], s.name));
    }
    const Eigen::Matrix3Xd change = (difference(*up, onto) - difference(*down, onto)) / (2.0 * step);
    by.col(k) = Eigen::Map<const Eigen::VectorXd>(change.data(), change.size());
  }
  const Eigen::VectorXd diagonal = (by * s.uncertainty.covariance).cwiseProduct(by).rowwise().sum();
  return Eigen::Matrix3Xd(Eigen::Map<const Eigen::Matrix3Xd>(diagonal.data(), 3, onto.cols()));
}

}  // namespace

Result<ScannerComparison> compare_scanners(const model::Scanner& a, const model::Scanner& b,
                                           const CompareOptions& options) {
  if (a.camera.width_px != b.camera.width_px || a.camera.height_px != b.camera.height_px ||
      a.projector.main_axis() != b.projector.main_axis()) {
    return unanswerable(fmt::format("'{}' and '{}' are not calibrations of one scanner: image size or code axis differ",
                                    a.name, b.name));
  }
  std::vector<Sample> samples;
  for (const Sample& s : samples_of(a, options)) {
    if (seen_by(b, {s})) samples.push_back(s);
  }
  if (samples.size() < 20) {
    return unanswerable(fmt::format("only {} points of the volume are seen by both scanners; give --z-min and --z-max",
                                    samples.size()));
  }
  Eigen::Matrix3Xd onto(3, static_cast<Eigen::Index>(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) onto.col(static_cast<Eigen::Index>(i)) = samples[i].point;
  const auto in_b = seen_by(b, samples);
  const auto from_a = variances(a, samples, onto), from_b = variances(b, samples, onto);
  if (!from_a) return tl::unexpected(from_a.error());
  if (!from_b) return tl::unexpected(from_b.error());
  const Eigen::Matrix3Xd d = difference(*in_b, onto), u2 = *from_a + *from_b;
  ScannerComparison out;
  for (Eigen::Index i = 0; i < d.cols(); ++i) {
    out.points.push_back({onto.col(i), d.col(i), u2.col(i).cwiseMax(0.0).cwiseSqrt()});
  }
  const double n = static_cast<double>(d.cols());
  out.rms_mm = std::sqrt(d.squaredNorm() / n);
  out.max_mm = d.colwise().norm().maxCoeff();
  out.allowed_rms_mm = std::sqrt(u2.sum() / n);
  if (!(out.allowed_rms_mm > 0)) return unanswerable("the covariances allow no difference at all; calibrate again");
  out.ratio = out.rms_mm / out.allowed_rms_mm;
  return out;
}

std::string verdict_of(const ScannerComparison& c) {
  return fmt::format("{}: they differ by {:.4f} mm rms ({:.4f} mm at most), their uncertainties allow {:.4f} mm rms",
                     c.ratio > 2.0 ? "the calibrations disagree" : "the calibrations agree", c.rms_mm, c.max_mm,
                     c.allowed_rms_mm);
}

Value to_value(const ScannerComparison& c) {
  Value points = Value::array();
  for (const auto& p : c.points) {
    points.append(Value::object()
                      .set("point_mm", Value::numbers(p.point_mm))
                      .set("difference_mm", Value::numbers(p.difference_mm))
                      .set("u_mm", Value::numbers(p.u_mm)));
  }
  return Value::object()
      .set("verdict", verdict_of(c))
      .set("rms_mm", c.rms_mm)
      .set("max_mm", c.max_mm)
      .set("allowed_rms_mm", c.allowed_rms_mm)
      .set("ratio", c.ratio)
      .set("points", points);
}

}  // namespace fringecal::metrology

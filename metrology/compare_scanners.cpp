#include "metrology/compare_scanners.h"

#include <fmt/format.h>
#include <boost/math/distributions/chi_squared.hpp>

#include <cmath>
#include <map>

namespace fringecal::metrology {
namespace {

constexpr double kByChance = 0.01;  // eq. 4

/// Diagonals of J C J^T, eq. 2, a column per point.
Eigen::Matrix3Xd variances(const Eigen::MatrixXd& by, const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd diagonal = (by * covariance).cwiseProduct(by).rowwise().sum();
  return Eigen::Map<const Eigen::Matrix3Xd>(diagonal.data(), 3, diagonal.size() / 3);
}

/// Eq. 3, with U = J C J^T for J = (J_A, J_B) and C of both: tr U^2 = tr (J^T J C)^2, as small as the parameters are few.
double ways_to_differ(const Eigen::MatrixXd& by_a, const Eigen::MatrixXd& c_a, const Eigen::MatrixXd& by_b,
                      const Eigen::MatrixXd& c_b) {
  Eigen::MatrixXd by(by_a.rows(), by_a.cols() + by_b.cols());
  by << by_a, by_b;
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(by.cols(), by.cols());
  c.topLeftCorner(c_a.rows(), c_a.cols()) = c_a;
  c.bottomRightCorner(c_b.rows(), c_b.cols()) = c_b;
  const Eigen::MatrixXd m = by.transpose() * by * c;
  return m.trace() * m.trace() / m.cwiseProduct(m.transpose()).sum();
}

}  // namespace

Result<ScannerComparison> compare_scanners(const model::Scanner& a, const model::Scanner& b,
                                           const CompareOptions& options) {
  if (a.camera.width_px != b.camera.width_px || a.camera.height_px != b.camera.height_px ||
      a.projector.main_axis() != b.projector.main_axis()) {
    return unanswerable(fmt::format("'{}' and '{}' are not calibrations of one scanner: image size or code axis differ",
                                    a.name, b.name));
  }
  std::vector<VolumeSample> samples;
  for (const VolumeSample& s : samples_of(a, options)) {
    if (seen_by(b, std::span(&s, 1))) samples.push_back(s);
  }
  if (samples.size() < 20) {
    return unanswerable(fmt::format("only {} points of the volume are seen by both scanners; give --z-min and --z-max",
                                    samples.size()));
  }
  Eigen::Matrix3Xd onto(3, static_cast<Eigen::Index>(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) onto.col(static_cast<Eigen::Index>(i)) = samples[i].point_mm;
  const auto in_b = seen_by(b, samples);
  const auto by_a = derivatives(a, samples), by_b = derivatives(b, samples);
  if (!by_a) return tl::unexpected(by_a.error());
  if (!by_b) return tl::unexpected(by_b.error());
  const Eigen::MatrixXd &c_a = a.uncertainty.covariance, &c_b = b.uncertainty.covariance;
  const Eigen::Matrix3Xd d = difference(*in_b, onto), u2 = variances(*by_a, c_a) + variances(*by_b, c_b);
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
  out.ways = ways_to_differ(*by_a, c_a, *by_b, c_b);
  const boost::math::chi_squared chi2(out.ways);
  out.limit = std::sqrt(boost::math::quantile(boost::math::complement(chi2, kByChance)) / out.ways);
  return out;
}

std::string verdict_of(const ScannerComparison& c) {
  return fmt::format(
      "{}: they differ by {:.4f} mm rms ({:.4f} mm at most), their uncertainties allow {:.4f} mm rms, by chance up to "
      "{:.4f} mm in 99 of 100 cases",
      c.ratio > c.limit ? "the calibrations disagree" : "the calibrations agree", c.rms_mm, c.max_mm, c.allowed_rms_mm,
      c.limit * c.allowed_rms_mm);
}

std::vector<ComparedHeight> by_height(const ScannerComparison& c) {
  std::map<long, ComparedHeight> heights;  // by the height in um: points of one height differ by rounding only
  for (const auto& p : c.points) {
    auto& h = heights[std::lround(1e3 * p.point_mm.z())];
    if (h.points == 0 || p.difference_mm.norm() > h.worst.difference_mm.norm()) h.worst = p;
    h.rms_mm += p.difference_mm.squaredNorm();
    h.allowed_rms_mm += p.u_mm.squaredNorm();
    ++h.points;
  }
  std::vector<ComparedHeight> out;
  for (auto& [um, h] : heights) {
    h.z_mm = h.worst.point_mm.z();
    h.rms_mm = std::sqrt(h.rms_mm / h.points);
    h.allowed_rms_mm = std::sqrt(h.allowed_rms_mm / h.points);
    out.push_back(h);
  }
  return out;
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
      .set("limit", c.limit)
      .set("ways", c.ways)
      .set("points", points);
}

}  // namespace fringecal::metrology

#include "metrology/step.h"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

#include <array>
#include <cmath>
#include <numbers>

namespace fringecal::metrology {
namespace {

constexpr double kMaxAngle_rad = std::numbers::pi / 180;

struct Side {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  double n = 0;
};

Side side_of(std::span<const Eigen::Vector3d> points) {
  Side out{.n = static_cast<double>(points.size())};
  for (const auto& p : points) out.centre += p / out.n;
  for (const auto& p : points) out.scatter += (p - out.centre) * (p - out.centre).transpose();
  return out;
}

using Eigen3 = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>;

}  // namespace

Result<StepFit> fit_step(std::span<const Eigen::Vector3d> lower_mm, std::span<const Eigen::Vector3d> upper_mm) {
  if (lower_mm.size() < 3 || upper_mm.size() < 3) return unanswerable("a step needs three points on each plane");
  const std::array sides = {side_of(lower_mm), side_of(upper_mm)};
  const Eigen3 solved(sides[0].scatter + sides[1].scatter), first(sides[0].scatter), second(sides[1].scatter);
  StepFit out{.normal = solved.eigenvectors().col(0)};  // eq. 1: eigenvalues come in rising order
  const Eigen::Vector3d a = first.eigenvectors().col(0), b = second.eigenvectors().col(0);
  out.angle_rad = std::atan2(a.cross(b).norm(), std::abs(a.dot(b)));
  if (!(out.angle_rad <= kMaxAngle_rad)) {
    return unanswerable(fmt::format("its two planes stand at {:.2f} degrees to each other; a step's are parallel",
                                    out.angle_rad * 180 / std::numbers::pi));
  }
  const Eigen::Vector3d between = sides[1].centre - sides[0].centre;
  if (out.normal.dot(between) < 0) out.normal = -out.normal;
  out.height_mm = out.normal.dot(between);  // eq. 2
  const double s2 = solved.eigenvalues()(0) / (sides[0].n + sides[1].n - 4);
  double variance = s2 * (1 / sides[0].n + 1 / sides[1].n);
  for (const int k : {1, 2}) {
    const double aside = solved.eigenvectors().col(k).dot(between);
    variance += s2 * aside * aside / solved.eigenvalues()(k);  // eq. 3
  }
  out.u_noise_mm = std::sqrt(variance);
  return out;
}

}  // namespace fringecal::metrology

#include "hw/virtual/free_form.h"

#include "core/error.h"
#include "hw/virtual/random.h"

#include <cmath>
#include <numbers>

namespace fringecal::virt {

FreeFormSurface::FreeFormSurface(const Eigen::Vector3d& half_mm, double relief, std::uint64_t seed)
    : half_(half_mm), inverse_half_(half_mm.cwiseInverse()), bound_(1 + relief) {
  require(relief >= 0 && relief < 0.25 && half_mm.minCoeff() > 0, "a free form has half axes and a relief below 1/4");
  Stream random(seed, "free form");
  double slope = 0;
  for (Wave& w : waves_) {
    w.k = (3.0 + 3.0 * random.uniform()) * random.normal3().normalized();
    w.amplitude = relief / static_cast<double>(waves_.size());
    w.phase = 2 * std::numbers::pi * random.uniform();
    slope += w.amplitude * w.k.norm();
  }
  safe_step_ = half_.minCoeff() / (1 + 2 * slope);  // eq. 2
}

double FreeFormSurface::value(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d q = inverse_half_.cwiseProduct(p);
  const double length = q.norm();
  double f = length - 1;
  for (const Wave& w : waves_) f -= w.amplitude * std::cos(w.k.dot(q) / length + w.phase);
  return f;
}

Eigen::Vector3d FreeFormSurface::gradient(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d q = inverse_half_.cwiseProduct(p);
  const double length = q.norm();
  const Eigen::Vector3d u = q / length;
  Eigen::Vector3d slope = Eigen::Vector3d::Zero();
  for (const Wave& w : waves_) slope += w.amplitude * std::sin(w.k.dot(u) + w.phase) * w.k;
  return inverse_half_.cwiseProduct(u + (slope - u * u.dot(slope)) / length);
}

Eigen::Vector3d FreeFormSurface::normal(const Eigen::Vector3d& p) const { return gradient(p).normalized(); }

double FreeFormSurface::distance_mm(const Eigen::Vector3d& p) const { return value(p) / gradient(p).norm(); }

std::optional<double> FreeFormSurface::hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                           double t_min) const {
  // Between the two ends of the ray within |q| <= bound_.
  const Eigen::Vector3d o = inverse_half_.cwiseProduct(origin), d = inverse_half_.cwiseProduct(direction);
  const double a = d.squaredNorm(), b = o.dot(d), c = o.squaredNorm() - bound_ * bound_;
  const double discriminant = b * b - a * c;
  if (!(discriminant > 0)) return std::nullopt;
  const double root = std::sqrt(discriminant), end = (-b + root) / a, per_length = 1 / direction.norm();
  double t = std::max(t_min, (-b - root) / a);
  // Of eq. 1: below, a safe step no longer pays. On a body of 100 mm it is a step of 0.2 mm; a ray that is inside for less
  // dips below the surface by less than 0.1^2 / (2 x 100) mm = 50 nm.
  constexpr double kNear = 3e-3;
  double before = t;
  while (t < end) {
    const double f = value(origin + t * direction);
    if (f <= 0) break;
    before = t;
    t += std::max(f, kNear) * safe_step_ * per_length;
  }
  if (!(t < end) && value(origin + end * direction) > 0) return std::nullopt;
  if (t <= t_min) return std::nullopt;  // begins inside
  double after = std::min(t, end);
  for (int i = 0; i < 60 && after - before > 1e-10; ++i) {
    const double middle = 0.5 * (before + after);
    (value(origin + middle * direction) > 0 ? before : after) = middle;
  }
  return after;
}

}  // namespace fringecal::virt

#include "hw/virtual/shapes.h"

#include "hw/virtual/random.h"

#include <cmath>
#include <numbers>

namespace fringecal::virt {
namespace {

// The smaller root of a t^2 + 2 b t + c = 0 beyond t_min, a > 0.
std::optional<double> first_root(double a, double b, double c, double t_min) {
  const double discriminant = b * b - a * c;
  if (!(discriminant >= 0)) return std::nullopt;
  const double root = std::sqrt(discriminant);
  if (const double t = (-b - root) / a; t > t_min) return t;
  if (const double t = (-b + root) / a; t > t_min) return t;
  return std::nullopt;
}

}  // namespace

Solid::Solid(const SceneObject& object, const Preset& preset, std::uint64_t instrument_seed)
    : albedo_(object.albedo), texture_(object.texture), world_from_part_(object.world_from_part) {
  if (const auto* flat = std::get_if<FlatBoard>(&object.shape)) {
    half_ = 0.5 * Eigen::Vector2d(flat->width_mm, flat->height_mm);
  } else if (const auto* board = std::get_if<PatternBoard>(&object.shape)) {
    print_.emplace(*board, preset, instrument_seed);
    half_ = print_->half_size_mm();
    curvature_ = print_->bow_per_mm2();
  } else if (const auto* sphere = std::get_if<Sphere>(&object.shape)) {
    kind_ = Kind::sphere;
    radius_ = 0.5 * sphere->diameter_mm;
  } else if (const auto* cylinder = std::get_if<Cylinder>(&object.shape)) {
    kind_ = Kind::cylinder;
    radius_ = 0.5 * cylinder->diameter_mm;
    half_length_ = 0.5 * cylinder->length_mm;
  } else if (const auto* form = std::get_if<FreeForm>(&object.shape)) {
    kind_ = Kind::free_form;
    free_form_.emplace(0.5 * Eigen::Vector3d(form->length_mm, form->height_mm, form->depth_mm), form->relief,
                       static_cast<std::uint64_t>(form->seed));
  }
  if (texture_ > 0) {
    // Eight plane waves of 15 to 60 mm in random directions: smooth, rms sqrt(8 / 2) of one wave's amplitude.
    Stream random(instrument_seed, "texture " + object.name);
    for (int k = 0; k < 8; ++k) {
      const double length_mm = 15.0 * std::pow(4.0, random.uniform());
      waves_.push_back(
          {2 * std::numbers::pi / length_mm * random.normal3().normalized(), 2 * std::numbers::pi * random.uniform()});
    }
  }
}

std::optional<double> Solid::hit(const Ray& ray, double t_min) const {
  const Eigen::Vector3d &o = ray.origin, &d = ray.direction;
  if (kind_ == Kind::free_form) return free_form_->hit(o, d, t_min);
  if (kind_ == Kind::sphere) return first_root(d.squaredNorm(), o.dot(d), o.squaredNorm() - radius_ * radius_, t_min);
  if (kind_ == Kind::sheet) {
    // c |o_xy + t d_xy|^2 = o_z + t d_z; the root that goes over into the plane's for c -> 0.
    const double a = curvature_ * d.head<2>().squaredNorm();
    const double b = curvature_ * 2.0 * o.head<2>().dot(d.head<2>()) - d.z();
    const double c = curvature_ * o.head<2>().squaredNorm() - o.z();
    const double discriminant = b * b - 4.0 * a * c;
    if (!(discriminant > 0)) return std::nullopt;
    const double t = -2.0 * c / (b + std::copysign(std::sqrt(discriminant), b));
    const double x = o.x() + t * d.x(), y = o.y() + t * d.y();
    if (!(t > t_min) || std::abs(x) > half_.x() || std::abs(y) > half_.y()) return std::nullopt;
    return t;
  }
  std::optional<double> best;
  const auto offer = [&](double t) {
    if (t > t_min && (!best || t < *best)) best = t;
  };
  const double a = d.head<2>().squaredNorm();
  const double b = o.head<2>().dot(d.head<2>()), c = o.head<2>().squaredNorm() - radius_ * radius_;
  if (const double discriminant = b * b - a * c; a > 0 && discriminant >= 0) {
    for (const double root : {-std::sqrt(discriminant), std::sqrt(discriminant)}) {
      const double t = (-b + root) / a;
      if (std::abs(o.z() + t * d.z()) <= half_length_) offer(t);
    }
  }
  if (d.z() != 0) {
    for (const double z : {-half_length_, half_length_}) {
      const double t = (z - o.z()) / d.z();
      if ((o + t * d).head<2>().squaredNorm() <= radius_ * radius_) offer(t);
    }
  }
  return best;
}

Eigen::Vector3d Solid::normal(const Eigen::Vector3d& p) const {
  if (kind_ == Kind::free_form) return free_form_->normal(p);
  if (kind_ == Kind::sphere) return p.normalized();
  if (kind_ == Kind::sheet) {
    return Eigen::Vector3d(-2.0 * curvature_ * p.x(), -2.0 * curvature_ * p.y(), 1.0).normalized();
  }
  if (std::abs(p.z()) > half_length_ * (1.0 - 1e-9)) return {0, 0, p.z() > 0 ? 1.0 : -1.0};
  return Eigen::Vector3d(p.x(), p.y(), 0).normalized();
}

double Solid::albedo_without_print(const Eigen::Vector3d& point) const {
  double sum = 0;
  for (const Wave& w : waves_) sum += std::cos(w.k.dot(point) + w.phase);
  return albedo_ * std::max(0.0, 1.0 + texture_ * 0.5 * sum);
}

double Solid::albedo(const Eigen::Vector3d& point) const {
  return albedo_without_print(point) * (print_ ? print_->albedo(point.head<2>()) : 1.0);
}

}  // namespace fringecal::virt

#include "calib/model/triangulate.h"

#include <cmath>

namespace fringecal::model {
namespace {

/// A distorted coordinate and its derivatives by the undistorted x and y.
struct Distorted {
  double value, by_x, by_y, determinant;
};

Distorted distorted(const Distortion& k, double x, double y, CodeAxis axis) {
  const double r2 = x * x + y * y;
  const double s = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double ds = 2.0 * (k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]));  // (ds/dx) / x = (ds/dy) / y
  double xd, yd;
  distort(k.data(), x, y, xd, yd);
  const double jxx = s + ds * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
  const double jxy = ds * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
  const double jyy = s + ds * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
  const double determinant = jxx * jyy - jxy * jxy;
  return axis == CodeAxis::x ? Distorted{xd, jxx, jxy, determinant} : Distorted{yd, jxy, jyy, determinant};
}

}  // namespace

std::optional<Eigen::Vector3d> triangulate_ray(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis,
                                               const Eigen::Vector3d& ray_in_cam, double u) {
  const auto& coded = projector.axis(axis);
  if (!coded) return std::nullopt;
  const Eigen::Vector3d a = proj_from_cam.rotation * ray_in_cam;
  const Eigen::Vector3d& t = proj_from_cam.translation_mm;
  const int across = axis == CodeAxis::x ? 0 : 1;
  const double target = (u - coded->u0) / coded->f;  // distorted normalised coordinate

  // Without distortion (2) reads a_x + t_x w = target (a_z + t_z w).
  const double slope = t[across] - target * t.z();
  if (!(std::abs(slope) > 0.0)) return std::nullopt;
  double w = (target * a.z() - a[across]) / slope;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const Eigen::Vector3d q = a + t * w;  // eq. 1
    if (!(q.z() > 0.0)) return std::nullopt;
    const double x = q.x() / q.z(), y = q.y() / q.z();
    const Distorted d = distorted(projector.distortion, x, y, axis);
    // As in undistort(): a determinant that is not positive means that the polynomial has turned over.
    if (!(d.determinant > 1e-6)) return std::nullopt;
    const double derivative = (d.by_x * (t.x() - x * t.z()) + d.by_y * (t.y() - y * t.z())) / q.z();
    if (!(std::abs(derivative) > 0.0)) return std::nullopt;
    const double step = (d.value - target) / derivative;  // eq. 2
    w -= step;
    // Rounding of g moves w by about 1e-16 / |derivative|: a step below that says no more.
    if (std::abs(step) <= 1e-14 * std::abs(w) + 4e-16 / std::abs(derivative)) {
      if (!(w > 0.0)) return std::nullopt;
      const Eigen::Vector3d point = ray_in_cam / w;
      return point.allFinite() ? std::optional(point) : std::nullopt;
    }
  }
  return std::nullopt;
}

std::optional<Eigen::Vector3d> triangulate(const Camera& camera, const Projector& projector,
                                           const Rigid3& proj_from_cam, CodeAxis axis, const Eigen::Vector2d& pixel,
                                           double u) {
  const auto ray = camera.ray(pixel);
  if (!ray) return std::nullopt;
  return triangulate_ray(projector, proj_from_cam, axis, *ray, u);
}

}  // namespace fringecal::model

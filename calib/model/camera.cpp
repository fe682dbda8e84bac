#include "calib/model/camera.h"

#include <cmath>

namespace fringecal::model {

std::optional<Eigen::Vector2d> undistort(const Distortion& k, const Eigen::Vector2d& distorted) {
  // Newton in two unknowns. The Jacobian of eqs. 2, 3 is written out; it is positive definite wherever the lens model
  // is one-to-one, so a determinant that is not positive means that the polynomial has turned over.
  double x = distorted.x(), y = distorted.y();
  for (int iteration = 0; iteration < 30; ++iteration) {
    const double r2 = x * x + y * y;
    const double s = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    const double ds = 2.0 * (k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]));  // (ds/dx) / x = (ds/dy) / y
    double xd, yd;
    distort(k.data(), x, y, xd, yd);
    const double ex = xd - distorted.x(), ey = yd - distorted.y();
    const double jxx = s + ds * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
    const double jxy = ds * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
    const double jyy = s + ds * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
    const double determinant = jxx * jyy - jxy * jxy;
    if (!(determinant > 1e-6) || !(jxx > 0.0)) return std::nullopt;
    const double dx = (jyy * ex - jxy * ey) / determinant, dy = (jxx * ey - jxy * ex) / determinant;
    x -= dx;
    y -= dy;
    if (std::abs(dx) + std::abs(dy) < 1e-14 * (1.0 + std::abs(x) + std::abs(y))) return Eigen::Vector2d(x, y);
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2d> Camera::project(const Eigen::Vector3d& p) const {
  if (!(p.z() > 0.0)) return std::nullopt;
  double xd, yd;
  distort(distortion.data(), p.x() / p.z(), p.y() / p.z(), xd, yd);
  return Eigen::Vector2d(fx_px * xd + cx_px, fy_px * yd + cy_px);  // eq. 4
}

std::optional<Eigen::Vector3d> Camera::ray(const Eigen::Vector2d& pixel) const {
  const auto normalised = undistort(distortion, {(pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px});
  if (!normalised) return std::nullopt;
  return Eigen::Vector3d(normalised->x(), normalised->y(), 1.0);
}

Value to_value(const Camera& c) {
  Value out = Value::object()
                  .set("width_px", c.width_px)
                  .set("height_px", c.height_px)
                  .set("fx_px", c.fx_px)
                  .set("fy_px", c.fy_px)
                  .set("cx_px", c.cx_px)
                  .set("cy_px", c.cy_px)
                  .set("distortion_k1_k2_p1_p2_k3", Value::numbers(c.distortion));
  if (c.pixel_mm) out.set("pixel_mm", *c.pixel_mm);
  return out;
}

Camera camera_from(Fields fields) {
  Camera c;
  c.width_px = fields.integer("width_px");
  c.height_px = fields.integer("height_px");
  c.fx_px = fields.number("fx_px");
  c.fy_px = fields.number("fy_px");
  c.cx_px = fields.number("cx_px");
  c.cy_px = fields.number("cy_px");
  const auto k = fields.numbers("distortion_k1_k2_p1_p2_k3", 5);
  std::copy(k.begin(), k.end(), c.distortion.begin());
  c.pixel_mm = fields.optional_number("pixel_mm");
  fields.finish();
  if (!(c.fx_px > 0 && c.fy_px > 0)) fields.complain("fx_px and fy_px must be positive");
  if (c.width_px <= 0 || c.height_px <= 0) fields.complain("width_px and height_px must be positive");
  return c;
}

}  // namespace fringecal::model

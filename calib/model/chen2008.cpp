#include "calib/model/chen2008.h"

#include "calib/model/scanner.h"
#include "core/parallel.h"

#include <Eigen/Dense>

#include <cmath>
#include <limits>
#include <numbers>

namespace fringecal::model {
namespace {

/// Least-squares c1, c2 of  offset_true = offset (1 + c1 r^2 + c2 r^4)  over samples (offset, r, offset_true) of a
/// field.
class RadialFit {
 public:
  void add(double offset, double r2, double offset_true) {
    // Columns scaled by the field's r^2 stay within double precision for any unit.
    const double a = offset * r2, b = offset * r2 * r2, y = offset_true - offset;
    aa_ += a * a;
    ab_ += a * b;
    bb_ += b * b;
    ay_ += a * y;
    by_ += b * y;
  }
  std::pair<double, double> coefficients() const {
    const double determinant = aa_ * bb_ - ab_ * ab_;
    if (!(determinant > 1e-12 * aa_ * bb_)) return {0.0, 0.0};
    return {(bb_ * ay_ - ab_ * by_) / determinant, (aa_ * by_ - ab_ * ay_) / determinant};
  }

 private:
  double aa_ = 0, ab_ = 0, bb_ = 0, ay_ = 0, by_ = 0;
};

}  // namespace

std::optional<Eigen::Vector3d> Chen2008Model::point_mm(const Eigen::Vector2d& pixel, double phi_obj, double phi_ref,
                                                       bool with_distortion) const {
  // Across and along the fringes. Coded along y the image lies on its side: j runs with the rows, i against the
  // columns.
  double j = axis == CodeAxis::x ? pixel.x() : pixel.y();
  double i = axis == CodeAxis::x ? pixel.y() : -pixel.x();
  if (with_distortion) {  // eq. 18: the measured pixel is carried to where an ideal lens would have put it
    const double r2 = s_mm * s_mm * ((i - i_C_px) * (i - i_C_px) + (j - j_C_px) * (j - j_C_px));
    const double factor = kc1_per_mm2 * r2 + kc2_per_mm4 * r2 * r2;
    i += (i - i_C_px) * factor;
    j += (j - j_C_px) * factor;
  }
  const double beta = std::atan((j_C_px - j) * s_mm / f_C_mm);                              // eq. 14
  const double d_Y = L_mm * s_mm * std::cos(beta) / (f_C_mm * std::cos(alpha_rad + beta));  // eq. 13
  const double Y_E = d_Y * (i_C_px - i);                                                    // eq. 16

  const auto X_A = [&](double phi) {
    double X = p_R_mm * (phi - phi_O_rad) / (2.0 * std::numbers::pi);  // eq. 6
    if (with_distortion) {
      const double r2 = X * X + Y_E * Y_E;
      X += X * (kp1_per_mm2 * r2 + kp2_per_mm4 * r2 * r2);  // eqs. 19, 20
    }
    return X;
  };
  const double X_obj = X_A(phi_obj);
  const double S = X_obj - X_A(phi_ref);  // eq. 5
  if (!(b_mm * (b_mm + S) > 0.0)) return std::nullopt;
  const double Z = L_mm * S / (b_mm + S);                                       // eqs. 1, 2
  return Eigen::Vector3d(X_obj * (1.0 - Z / L_mm), Y_E * (1.0 - Z / L_mm), Z);  // eqs. 8, 17
}

Chen2008Model chen2008_from(const Scanner& scanner) {
  const Camera& camera = scanner.camera;
  const CodeAxis axis = scanner.projector.main_axis();
  const ProjectorAxis& coded = *scanner.projector.axis(axis);
  const Rigid3 world_from_cam = scanner.world_from_cam();

  Chen2008Model m;
  m.L_mm = scanner.working_distance_mm;
  m.b_mm = world_from_cam.translation_mm.x();
  // alpha: the angle between the optical axes in the plane across the fringes; positive when a camera at +X looks
  // towards -X.
  const Eigen::Vector3d view = world_from_cam.rotation * Eigen::Vector3d::UnitZ();
  m.alpha_rad = std::atan2(-view.x(), -view.z());
  m.s_mm = camera.pixel_mm.value_or(1.0);
  m.f_C_mm = 0.5 * (camera.fx_px + camera.fy_px) * m.s_mm;
  m.axis = axis;
  m.i_C_px = axis == CodeAxis::x ? camera.cy_px : -camera.cx_px;
  m.j_C_px = axis == CodeAxis::x ? camera.cx_px : camera.cy_px;
  m.p_R_mm = coded.code.period * m.L_mm / std::abs(coded.f);  // eq. 6: p_R = L p / f_P
  m.phi_O_rad = coded.code.phase_from_u(coded.u0);

  RadialFit camera_fit;
  constexpr int kSteps = 40;  // samples per side of the field; the fit is of a smooth function
  for (int a = 0; a <= kSteps; ++a) {
    for (int b = 0; b <= kSteps; ++b) {
      const Eigen::Vector2d pixel(a * (camera.width_px - 1.0) / kSteps, b * (camera.height_px - 1.0) / kSteps);
      const auto ray = camera.ray(pixel);
      if (!ray) continue;
      const Eigen::Vector2d d = (pixel - Eigen::Vector2d(camera.cx_px, camera.cy_px)) * m.s_mm;
      camera_fit.add(d.x(), d.squaredNorm(), camera.fx_px * m.s_mm * ray->x());
      camera_fit.add(d.y(), d.squaredNorm(), camera.fy_px * m.s_mm * ray->y());
    }
  }
  std::tie(m.kc1_per_mm2, m.kc2_per_mm4) = camera_fit.coefficients();

  // Eq. 19 from pairs on R: a place (X', Y) that the projector lights, and the X that eq. 6 makes of its phase. Sampled
  // over what the camera sees of R.
  RadialFit projector_fit;
  for (int a = 0; a <= kSteps; ++a) {
    for (int b = 0; b <= kSteps; ++b) {
      const auto ray = camera.ray({a * (camera.width_px - 1.0) / kSteps, b * (camera.height_px - 1.0) / kSteps});
      if (!ray) continue;
      const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
      const double l = -world_from_cam.translation_mm.z() / direction.z();
      if (!(l > 0)) continue;
      const Eigen::Vector3d lit = world_from_cam.translation_mm + l * direction;
      const auto u = scanner.projector.project(axis, scanner.world_from_proj().inverse() * lit);
      if (!u) continue;
      const double X = (*u - coded.u0) / std::abs(coded.f) * m.L_mm;
      projector_fit.add(X, X * X + lit.y() * lit.y(), lit.x());
    }
  }
  std::tie(m.kp1_per_mm2, m.kp2_per_mm4) = projector_fit.coefficients();
  return m;
}

Value to_value(const FittedChen2008& fitted) {
  const Chen2008Model& m = fitted.model;
  return Value::object()
      .set("L_mm", m.L_mm)
      .set("b_mm", m.b_mm)
      .set("alpha_rad", m.alpha_rad)
      .set("p_R_mm", m.p_R_mm)
      .set("phi_O_rad", m.phi_O_rad)
      .set("f_C_mm", m.f_C_mm)
      .set("s_mm", m.s_mm)
      .set("i_C_px", m.i_C_px)
      .set("j_C_px", m.j_C_px)
      .set("kc1_per_mm2", m.kc1_per_mm2)
      .set("kc2_per_mm4", m.kc2_per_mm4)
      .set("kp1_per_mm2", m.kp1_per_mm2)
      .set("kp2_per_mm4", m.kp2_per_mm4)
      .set("z_min_mm", fitted.z_min_mm)
      .set("z_max_mm", fitted.z_max_mm)
      .set("rms_xyz_mm", Value::numbers(fitted.rms_xyz_mm))
      .set("max_mm", fitted.max_mm)
      .set("samples", fitted.samples);
}

FittedChen2008 fitted_chen2008_from(Fields f, CodeAxis axis) {
  FittedChen2008 fitted;
  Chen2008Model& m = fitted.model;
  m.axis = axis;
  m.L_mm = f.number("L_mm");
  m.b_mm = f.number("b_mm");
  m.alpha_rad = f.number("alpha_rad");
  m.p_R_mm = f.number("p_R_mm");
  m.phi_O_rad = f.number("phi_O_rad");
  m.f_C_mm = f.number("f_C_mm");
  m.s_mm = f.number("s_mm");
  m.i_C_px = f.number("i_C_px");
  m.j_C_px = f.number("j_C_px");
  m.kc1_per_mm2 = f.number("kc1_per_mm2");
  m.kc2_per_mm4 = f.number("kc2_per_mm4");
  m.kp1_per_mm2 = f.number("kp1_per_mm2");
  m.kp2_per_mm4 = f.number("kp2_per_mm4");
  fitted.z_min_mm = f.number("z_min_mm");
  fitted.z_max_mm = f.number("z_max_mm");
  const auto rms = f.numbers("rms_xyz_mm", 3);
  fitted.rms_xyz_mm = {rms[0], rms[1], rms[2]};
  fitted.max_mm = f.number("max_mm");
  fitted.samples = f.integer("samples");
  f.finish();
  return fitted;
}

Image<double> reference_phase(const Scanner& scanner) {
  const Camera& camera = scanner.camera;
  const CodeAxis axis = scanner.projector.main_axis();
  const FringeCode& code = scanner.projector.axis(axis)->code;
  const Rigid3 world_from_cam = scanner.world_from_cam();
  const Rigid3 proj_from_world = scanner.world_from_proj().inverse();
  Image<double> phase(camera.width_px, camera.height_px, std::numeric_limits<double>::quiet_NaN());
  parallel_for(camera.height_px, [&](int y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const auto ray = camera.ray({static_cast<double>(x), static_cast<double>(y)});
      if (!ray) continue;
      const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
      const double l = -world_from_cam.translation_mm.z() / direction.z();
      if (!(l > 0)) continue;
      const auto u = scanner.projector.project(axis, proj_from_world * (world_from_cam.translation_mm + l * direction));
      if (u) phase(x, y) = code.phase_from_u(*u);
    }
  });
  return phase;
}

}  // namespace fringecal::model

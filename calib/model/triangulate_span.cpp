#include "calib/model/triangulate_span.h"

#include "core/parallel.h"

#include <algorithm>
#include <limits>
#include <numbers>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "calib/model/triangulate_span.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fringecal::model {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<double>;
using V = hn::Vec<D>;

/// A task's constants in vectors.
struct Constants {
  V r[9], t[3], k[5], per_rad, at_zero, f;
};

HWY_INLINE Constants constants_of(const SpanTask& task) {
  const D d;
  Constants c;
  for (int i = 0; i < 9; ++i) c.r[i] = hn::Set(d, task.rotation.data()[i]);
  for (int i = 0; i < 3; ++i) c.t[i] = hn::Set(d, task.translation_mm[i]);
  for (std::size_t i = 0; i < 5; ++i) c.k[i] = hn::Set(d, task.distortion[i]);
  c.per_rad = hn::Set(d, task.per_rad);
  c.at_zero = hn::Set(d, task.at_zero);
  c.f = hn::Set(d, task.f);
  return c;
}

/// u_d - target at w, its derivative by w, and whether the point is one (triangulate.cpp).
struct Place {
  V residual, derivative;
  hn::Mask<D> sound;
};

template <int kAcross>
HWY_INLINE Place place_at(const Constants& c, const V* a, V w, V target) {
  const D d;
  const V one = hn::Set(d, 1.0), two = hn::Set(d, 2.0);
  const V qz = hn::Add(a[2], hn::Mul(c.t[2], w));
  const V inverse = hn::Div(one, qz);
  const V x = hn::Mul(hn::Add(a[0], hn::Mul(c.t[0], w)), inverse);
  const V y = hn::Mul(hn::Add(a[1], hn::Mul(c.t[1], w)), inverse);
  const V xx = hn::Mul(x, x), xy = hn::Mul(x, y), yy = hn::Mul(y, y), r2 = hn::Add(xx, yy);
  const V s = hn::Add(one, hn::Mul(r2, hn::Add(c.k[0], hn::Mul(r2, hn::Add(c.k[1], hn::Mul(r2, c.k[4]))))));
  const V ds = hn::Mul(
      two, hn::Add(c.k[0], hn::Mul(r2, hn::Add(hn::Mul(two, c.k[1]), hn::Mul(hn::Set(d, 3.0), hn::Mul(r2, c.k[4]))))));
  const V px = hn::Mul(c.k[2], x), py = hn::Mul(c.k[2], y), qx = hn::Mul(c.k[3], x), qy = hn::Mul(c.k[3], y);
  const V six = hn::Set(d, 6.0);
  const V jxx = hn::Add(hn::Add(s, hn::Mul(ds, xx)), hn::Add(hn::Mul(two, py), hn::Mul(six, qx)));
  const V jxy = hn::Add(hn::Mul(ds, xy), hn::Mul(two, hn::Add(px, qy)));
  const V jyy = hn::Add(hn::Add(s, hn::Mul(ds, yy)), hn::Add(hn::Mul(six, py), hn::Mul(two, qx)));
  V value, by_x, by_y;
  if constexpr (kAcross == 0) {  // camera.h, eqs. 2 and 3
    value = hn::Add(hn::Add(hn::Mul(x, s), hn::Mul(two, hn::Mul(c.k[2], xy))),
                    hn::Mul(c.k[3], hn::Add(r2, hn::Mul(two, xx))));
    by_x = jxx, by_y = jxy;
  } else {
    value = hn::Add(hn::Add(hn::Mul(y, s), hn::Mul(c.k[2], hn::Add(r2, hn::Mul(two, yy)))),
                    hn::Mul(two, hn::Mul(c.k[3], xy)));
    by_x = jxy, by_y = jyy;
  }
  Place out;
  out.residual = hn::Sub(value, target);
  out.derivative = hn::Mul(
      hn::Add(hn::Mul(by_x, hn::Sub(c.t[0], hn::Mul(x, c.t[2]))), hn::Mul(by_y, hn::Sub(c.t[1], hn::Mul(y, c.t[2])))),
      inverse);
  const V determinant = hn::Sub(hn::Mul(jxx, jyy), hn::Mul(jxy, jxy));
  out.sound = hn::And(hn::And(hn::Gt(qz, hn::Zero(d)), hn::Gt(determinant, hn::Set(d, 1e-6))),
                      hn::Gt(hn::Abs(out.derivative), hn::Zero(d)));
  return out;
}

template <int kAcross>
HWY_INLINE void step(const SpanTask& task, const Constants& c, std::size_t at) {
  constexpr int kSteps = 4;
  const D d;
  const V rx = hn::LoadU(d, task.ray_x + at), ry = hn::LoadU(d, task.ray_y + at);
  const V phase = hn::PromoteTo(d, hn::LoadU(hn::Rebind<float, D>(), task.phase_rad + at));
  const V target = hn::Add(hn::Mul(phase, c.per_rad), c.at_zero);
  V a[3];
  for (int i = 0; i < 3; ++i) a[i] = hn::Add(hn::Add(hn::Mul(c.r[i], rx), hn::Mul(c.r[3 + i], ry)), c.r[6 + i]);
  const V slope = hn::Sub(c.t[kAcross], hn::Mul(target, c.t[2]));
  V w = hn::Div(hn::Sub(hn::Mul(target, a[2]), a[kAcross]), slope);
  Place place = place_at<kAcross>(c, a, w, target);
  V move = hn::Zero(d);
  for (int i = 0; i < kSteps; ++i) {
    if (i > 0) place = place_at<kAcross>(c, a, w, target);
    move = hn::Div(place.residual, place.derivative);
    w = hn::Sub(w, move);
  }
  // The limit of triangulate_ray(), ten times as wide: its last step is the rounding of g itself.
  const V limit =
      hn::Add(hn::Mul(hn::Set(d, 1e-13), hn::Abs(w)), hn::Div(hn::Set(d, 4e-15), hn::Abs(place.derivative)));
  const auto good = hn::And(hn::And(place.sound, hn::Gt(w, hn::Zero(d))), hn::Le(hn::Abs(move), limit));
  const V z = hn::IfThenElseZero(good, hn::Div(hn::Set(d, 1.0), w));
  const auto or_zero = [&](V v) { return hn::IfThenElseZero(good, v); };
  hn::StoreInterleaved3(or_zero(hn::Mul(rx, z)), or_zero(hn::Mul(ry, z)), z, d, task.points_mm[at].data());
  const V length = hn::Sqrt(hn::Add(hn::Add(hn::Mul(rx, rx), hn::Mul(ry, ry)), hn::Set(d, 1.0)));
  const V along = hn::Div(hn::Mul(hn::Abs(hn::Mul(c.f, place.derivative)), hn::Mul(w, w)), length);  // (1)
  hn::StoreU(or_zero(along), d, task.du_per_mm + at);
}

template <int kAcross>
void span_along(const SpanTask& task, std::size_t first, std::size_t count) {
  const Constants c = constants_of(task);
  const std::size_t lanes = hn::Lanes(D()), whole = count / lanes * lanes, rest = count - whole;
  for (std::size_t at = first; at < first + whole; at += lanes) step<kAcross>(task, c, at);
  if (rest == 0) return;
  constexpr std::size_t kMost = HWY_MAX_BYTES / sizeof(double);
  double x[kMost] = {}, y[kMost] = {}, du[kMost];
  float phase[kMost] = {};
  Eigen::Vector3d points[kMost];
  const std::size_t from = first + whole;
  std::copy_n(task.ray_x + from, rest, x);
  std::copy_n(task.ray_y + from, rest, y);
  std::copy_n(task.phase_rad + from, rest, phase);
  SpanTask last = task;
  last.ray_x = x, last.ray_y = y, last.phase_rad = phase, last.points_mm = points, last.du_per_mm = du;
  step<kAcross>(last, c, 0);
  std::copy_n(points, rest, task.points_mm + from);
  std::copy_n(du, rest, task.du_per_mm + from);
}

void span(const SpanTask& task, std::size_t first, std::size_t count) {
  if (task.across == 0) {
    span_along<0>(task, first, count);
  } else {
    span_along<1>(task, first, count);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace fringecal::model
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fringecal::model {

HWY_EXPORT(span);

void triangulate_span(const SpanTask& task, std::size_t first, std::size_t count) {
  HWY_DYNAMIC_DISPATCH(span)(task, first, count);
}

RayTable ray_table(const Camera& camera) {
  RayTable out{Image<double>(camera.width_px, camera.height_px), Image<double>(camera.width_px, camera.height_px)};
  parallel_for(camera.height_px, [&](int y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const auto ray = camera.ray({static_cast<double>(x), static_cast<double>(y)});
      out.x(x, y) = ray ? ray->x() : std::numeric_limits<double>::quiet_NaN();
      out.y(x, y) = ray ? ray->y() : std::numeric_limits<double>::quiet_NaN();
    }
  });
  return out;
}

SpanTask span_task(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis) {
  const auto& coded = projector.axis(axis);
  require(coded.has_value(), "the projector codes that axis");
  SpanTask task;
  task.rotation = proj_from_cam.rotation_matrix();
  task.translation_mm = proj_from_cam.translation_mm;
  task.distortion = projector.distortion;
  task.across = axis == CodeAxis::x ? 0 : 1;
  task.per_rad = coded->code.period / (2.0 * std::numbers::pi) / coded->f;
  task.at_zero = (coded->code.u_from_phase(0.0) - coded->u0) / coded->f;
  task.f = std::abs(coded->f);
  return task;
}

std::optional<double> du_per_mm(const Projector& projector, const Rigid3& proj_from_cam, CodeAxis axis,
                                const Eigen::Vector3d& point_in_cam_mm, const Eigen::Vector3d& direction_in_cam) {
  // A central difference over 0.02 mm: its error, the third derivative, is below 1e-9 of du/dl.
  const Eigen::Vector3d direction = proj_from_cam.rotation * direction_in_cam.normalized();
  const Eigen::Vector3d in_proj = proj_from_cam * point_in_cam_mm;
  const auto ahead = projector.project(axis, in_proj + 0.01 * direction);
  const auto behind = projector.project(axis, in_proj - 0.01 * direction);
  const double slope = ahead && behind ? std::abs(*ahead - *behind) / 0.02 : 0.0;
  return slope > 0 ? std::optional(slope) : std::nullopt;
}

}  // namespace fringecal::model
#endif

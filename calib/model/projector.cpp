#include "calib/model/projector.h"

#include <cmath>

namespace fringecal::model {
namespace {

Value to_value(const ProjectorAxis& axis) {
  return Value::object().set("code", fringecal::to_value(axis.code)).set("f", axis.f).set("u0", axis.u0);
}

ProjectorAxis axis_from(Fields fields) {
  ProjectorAxis axis{fringe_code_from(fields.table("code")), fields.number("f"), fields.number("u0")};
  fields.finish();
  if (!(std::abs(axis.f) > 0)) fields.complain("f must not be zero");
  return axis;
}

}  // namespace

std::optional<double> Projector::project(CodeAxis a, const Eigen::Vector3d& p) const {
  const auto& coded = axis(a);
  if (!coded || !(p.z() > 0.0)) return std::nullopt;
  double xd, yd;
  distort(distortion.data(), p.x() / p.z(), p.y() / p.z(), xd, yd);
  return coded->f * (a == CodeAxis::x ? xd : yd) + coded->u0;  // eq. 1
}

Value to_value(const Projector& projector) {
  Value out = Value::object();
  if (projector.x) out.set("x", to_value(*projector.x));
  if (projector.y) out.set("y", to_value(*projector.y));
  return out.set("distortion_k1_k2_p1_p2_k3", Value::numbers(projector.distortion));
}

Projector projector_from(Fields fields) {
  Projector p;
  if (auto t = fields.optional_table("x")) p.x = axis_from(*t);
  if (auto t = fields.optional_table("y")) p.y = axis_from(*t);
  const auto k = fields.numbers("distortion_k1_k2_p1_p2_k3", 5);
  std::copy(k.begin(), k.end(), p.distortion.begin());
  fields.finish();
  if (!p.x && !p.y) fields.complain("a projector needs the table 'x' or 'y'");
  return p;
}

}  // namespace fringecal::model

#include "calib/model/phase_linearisation.h"

#include "core/error.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace fringecal::model {
namespace {

Value pair_of(std::complex<double> z) { return Value::numbers(std::array{z.real(), z.imag()}); }

std::complex<double> complex_from(Fields& f, const char* key) {
  const auto n = f.numbers(key, 2);
  return {n[0], n[1]};
}

}  // namespace

std::complex<double> PhaseLinearisation::ripple_at(double x_px, double y_px) const {
  const auto split = [](double place, int pixels, int nodes) {
    const double at = pixels > 1 && nodes > 1 ? place * (nodes - 1) / (pixels - 1) : 0.0;
    const int first = std::clamp(static_cast<int>(at), 0, std::max(0, nodes - 2));
    return std::pair(first, at - first);
  };
  const auto [i, s] = split(x_px, width_px, columns);
  const auto [j, t] = split(y_px, height_px, rows);
  const auto node = [&](int column, int row) {
    return ripple_rad[static_cast<std::size_t>(std::min(row, rows - 1) * columns + std::min(column, columns - 1))];
  };
  return (1 - t) * ((1 - s) * node(i, j) + s * node(i + 1, j)) +
         t * ((1 - s) * node(i, j + 1) + s * node(i + 1, j + 1));
}

Value to_value(const PhaseLinearisation& table) {
  std::vector<double> cosine, sine;
  for (const auto& z : table.ripple_rad) {
    cosine.push_back(z.real());
    sine.push_back(z.imag());
  }
  Value inputs = Value::object();
  for (const auto& [name, hash] : table.inputs) inputs.set(name, hash);
  return Value::object()
      .set("axis", table.axis == CodeAxis::x ? "x" : "y")
      .set("phase_steps", table.phase_steps)
      .set("period", table.period)
      .set("width_px", table.width_px)
      .set("height_px", table.height_px)
      .set("columns", table.columns)
      .set("rows", table.rows)
      .set("ripple_cosine_rad", Value::numbers(cosine))
      .set("ripple_sine_rad", Value::numbers(sine))
      .set("u_ripple_rad", Value::numbers(table.u_ripple_rad))
      .set("fixed_offset", pair_of(table.fixed.offset))
      .set("u_fixed_offset", table.fixed.u_offset)
      .set("fixed_conjugate", pair_of(table.fixed.conjugate))
      .set("u_fixed_conjugate", table.fixed.u_conjugate)
      .set("third_harmonic", table.fixed.third)
      .set("sd_offset", table.sd_offset)
      .set("sd_conjugate", table.sd_conjugate)
      .set("stacks", table.stacks)
      .set("inputs_sha256", inputs);
}

PhaseLinearisation phase_linearisation_from(Fields f) {
  PhaseLinearisation t;
  const std::string axis = f.text("axis");
  if (axis != "x" && axis != "y") f.complain("'axis' must be x or y");
  t.axis = axis == "x" ? CodeAxis::x : CodeAxis::y;
  t.phase_steps = f.integer("phase_steps");
  t.period = f.number("period");
  t.width_px = f.integer("width_px");
  t.height_px = f.integer("height_px");
  t.columns = f.integer("columns");
  t.rows = f.integer("rows");
  if (t.phase_steps < 3 || t.columns < 1 || t.rows < 1 || t.columns > 1000 || t.rows > 1000) {
    f.complain("'phase_steps' must be at least 3, 'columns' and 'rows' 1 to 1000");
  }
  const auto nodes = static_cast<std::size_t>(t.columns) * static_cast<std::size_t>(t.rows);
  const auto cosine = f.numbers("ripple_cosine_rad", nodes), sine = f.numbers("ripple_sine_rad", nodes);
  for (std::size_t i = 0; i < nodes; ++i) t.ripple_rad.emplace_back(cosine[i], sine[i]);
  t.u_ripple_rad = f.numbers("u_ripple_rad", nodes);
  t.fixed.offset = complex_from(f, "fixed_offset");
  t.fixed.u_offset = f.number("u_fixed_offset");
  t.fixed.conjugate = complex_from(f, "fixed_conjugate");
  t.fixed.u_conjugate = f.number("u_fixed_conjugate");
  t.fixed.third = f.number("third_harmonic");
  if (!(std::norm(t.fixed.conjugate) < 0.25 && std::norm(t.fixed.offset) < 0.25)) {
    f.complain("'fixed_offset' and 'fixed_conjugate' must be below 0.5");
  }
  t.sd_offset = f.number("sd_offset");
  t.sd_conjugate = f.number("sd_conjugate");
  t.stacks = f.integer("stacks");
  const Value inputs = f.raw("inputs_sha256");
  if (const auto* object = inputs.if_object()) {
    for (const auto& [name, hash] : *object) t.inputs.emplace_back(name, hash.if_text() ? *hash.if_text() : "");
  }
  f.finish();
  return t;
}

}  // namespace fringecal::model

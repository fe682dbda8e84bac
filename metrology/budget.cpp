#include "metrology/budget.h"

#include "core/error.h"

#include <fmt/format.h>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include <array>
#include <cmath>
#include <utility>

namespace fringecal::metrology {
namespace {

constexpr std::array kForms = {std::pair(Form::normal, "normal"), std::pair(Form::student_t, "student_t"),
                               std::pair(Form::rectangular, "rectangular"), std::pair(Form::triangular, "triangular"),
                               std::pair(Form::arcsine, "arcsine")};
// Beyond this, t_p differs from its limit by less than 1e-5 of it.
constexpr double kEndlessNu = 1e6;

void set_nu(Value& out, double nu) {
  if (std::isfinite(nu)) out.set("nu", nu);
}

}  // namespace

const char* name_of(Evaluation evaluation) { return evaluation == Evaluation::type_a ? "A" : "B"; }

const char* name_of(Form form) {
  for (const auto& [known, name] : kForms) {
    if (known == form) return name;
  }
  throw std::logic_error("a form of distribution without a name");
}

Form form_from(const std::string& name) {
  for (const auto& [form, known] : kForms) {
    if (name == known) return form;
  }
  throw InputError(fmt::format(
      "\"{}\" is no form of distribution; known: normal, student_t, rectangular, triangular, arcsine", name));
}

double student_factor(double nu, double coverage) {
  require(coverage > 0 && coverage < 1, "a coverage probability lies between 0 and 1");
  require(nu >= 1, "degrees of freedom are at least 1");
  const double p = 0.5 + coverage / 2;
  if (nu > kEndlessNu) return boost::math::quantile(boost::math::normal(), p);
  return boost::math::quantile(boost::math::students_t(nu), p);
}

Combined combine(const std::vector<Contribution>& budget, double coverage) {
  double variance = 0, fourth_over_nu = 0;
  for (const auto& c : budget) {
    require(c.u >= 0 && c.nu >= 1, "a contribution has u >= 0 and nu >= 1");
    const double u = c.u_of_quantity();
    variance += u * u;                                                // eq. 2
    if (std::isfinite(c.nu)) fourth_over_nu += u * u * u * u / c.nu;  // eq. 3
  }
  Combined out{.u = std::sqrt(variance), .coverage = coverage};
  const double nu = fourth_over_nu > 0 ? variance * variance / fourth_over_nu : kInfiniteNu;
  out.nu = nu > kEndlessNu ? kInfiniteNu : std::max(1.0, std::floor(nu));
  out.k = student_factor(out.nu, coverage);
  out.U = out.k * out.u;  // eq. 4
  return out;
}

Value to_value(const Contribution& c) {
  Value out = Value::object()
                  .set("name", c.name)
                  .set("type", name_of(c.evaluation))
                  .set("form", name_of(c.form))
                  .set("u", c.u)
                  .set("unit", c.unit)
                  .set("sensitivity", c.sensitivity);
  set_nu(out, c.nu);
  return out;
}

Contribution read_contribution(Fields fields) {
  Contribution out{.name = fields.text("name")};
  const std::string type = fields.text("type");
  if (type != "A" && type != "B") fields.complain(fmt::format("type is \"{}\"; known: A, B", type));
  out.evaluation = type == "A" ? Evaluation::type_a : Evaluation::type_b;
  out.form = form_from(fields.text("form"));
  out.u = fields.number("u");
  out.unit = fields.text("unit");
  out.sensitivity = fields.number("sensitivity");
  out.nu = fields.optional_number("nu").value_or(kInfiniteNu);
  if (!(out.u >= 0) || !(out.nu >= 1)) fields.complain("u must not be negative, and nu is at least 1");
  fields.finish();
  return out;
}

Value to_value(const Combined& c) {
  Value out = Value::object().set("u", c.u).set("k", c.k).set("U", c.U).set("coverage", c.coverage);
  set_nu(out, c.nu);
  return out;
}

Combined read_combined(Fields fields) {
  Combined out;
  out.u = fields.number("u");
  out.k = fields.number("k");
  out.U = fields.number("U");
  out.coverage = fields.number("coverage");
  out.nu = fields.optional_number("nu").value_or(kInfiniteNu);
  fields.finish();
  return out;
}

}  // namespace fringecal::metrology

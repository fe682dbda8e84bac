#include "metrology/plan.h"

#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "metrology/plan_texts.h"

#include <fmt/format.h>

#include <array>
#include <utility>

namespace fringecal::metrology {
namespace {

constexpr std::array kMeasurands = {std::pair(Measurand::diameter_error, "diameter_error"),
                                    std::pair(Measurand::mean_diameter_error, "mean_diameter_error"),
                                    std::pair(Measurand::distance_error, "distance_error"),
                                    std::pair(Measurand::form_range, "form_range"),
                                    std::pair(Measurand::form_95, "form_95"),
                                    std::pair(Measurand::form_sd, "form_sd")};

Measurand measurand_from(Fields& fields) {
  const std::string name = fields.text("measurand");
  std::string known;
  for (const auto& [measurand, word] : kMeasurands) {
    if (name == word) return measurand;
    known += fmt::format("{}{}", known.empty() ? "" : ", ", word);
  }
  fields.complain(fmt::format("measurand is \"{}\"; known: {}", name, known));
}

PlannedQuantity read_quantity(Fields fields) {
  PlannedQuantity q{.measurand = measurand_from(fields)};
  q.symbol = fields.text("symbol");
  q.name = fields.text("name");
  const auto lower = fields.optional_number("lower_mm"), upper = fields.optional_number("upper_mm");
  if (lower && upper && !(*lower <= *upper)) fields.complain("lower_mm is above upper_mm");
  if (lower || upper) q.limits = Limits{lower, upper};
  fields.finish();
  return q;
}

Series read_series(Fields fields) {
  Series s{
      .scene = fields.text("scene"), .artefacts = fields.texts("artefacts"), .captures = fields.integer("captures")};
  s.repeats = fields.optional_boolean("repeats").value_or(false);
  if (s.artefacts.empty()) fields.complain("artefacts is empty; name at least one of artefacts.toml");
  if (s.captures < 1 || s.captures > 999) fields.complain(fmt::format("captures is {}; give 1 to 999", s.captures));
  for (auto& q : fields.tables("quantity")) s.quantities.push_back(read_quantity(std::move(q)));
  if (s.quantities.empty()) fields.complain("there is no [[series.quantity]]: nothing would be evaluated");
  fields.finish();
  return s;
}

}  // namespace

const char* name_of(Measurand measurand) {
  for (const auto& [known, name] : kMeasurands) {
    if (known == measurand) return name;
  }
  throw std::logic_error("a measurand without a name");
}

std::vector<std::string> shipped_plans() {
  std::vector<std::string> out;
  for (const auto& [name, text] : kPlanTexts) out.emplace_back(name);
  return out;
}

std::string plan_text(const std::string& name) {
  for (const auto& [known, text] : kPlanTexts) {
    if (name == known) return std::string(text);
  }
  throw InputError(
      fmt::format("\"{}\" is neither a file nor a shipped plan; shipped: {}", name, fmt::join(shipped_plans(), ", ")));
}

Plan read_plan(const std::string& name) {
  const bool is_file = std::filesystem::exists(name);
  Fields fields(parse_toml(is_file ? read_bytes(name) : plan_text(name), name), name);
  fields.expect_schema("fringecal.plan", 1);
  Plan plan{.name = fields.text("name"), .title = fields.text("title"), .source = fields.text("source")};
  plan.unchecked = fields.texts("unchecked");
  plan.decision_rule = decision_rule_from(fields.optional_text("decision_rule").value_or("iso_14253_1"));
  const std::string rejection = fields.optional_text("rejection").value_or("none");
  if (rejection != "none" && rejection != "vdi_2634") {
    fields.complain(fmt::format("rejection is \"{}\"; known: none, vdi_2634 (at most 0.3 % of the points)", rejection));
  }
  plan.rejection = rejection == "none" ? fitting::Rejection::none : fitting::Rejection::vdi_2634;
  for (auto& s : fields.tables("series")) plan.series.push_back(read_series(std::move(s)));
  if (plan.series.empty()) fields.complain("there is no [[series]] in it");
  fields.finish();
  return plan;
}

std::string capture_name(const Series& series, int capture) { return fmt::format("{}-{:02}", series.scene, capture); }

}  // namespace fringecal::metrology

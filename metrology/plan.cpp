#include "metrology/plan.h"

#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "metrology/plan_texts.h"

#include <fmt/format.h>

#include <algorithm>
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

constexpr int kMostPerPosition = 26;  // a letter each

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

void read_places(Fields& fields, Series& s) {
  const Value places = fields.raw("places");
  if (places.is_null()) return;
  if (!places.if_array()) fields.complain("places is a list of places");
  for (std::size_t k = 0; k < places.if_array()->size(); ++k) {
    Fields one(Value::object().set("place", (*places.if_array())[k]), fields.file(), "places");
    const auto numbers = one.numbers("place", 6);
    std::array<double, 6> place{};
    std::copy(numbers.begin(), numbers.end(), place.begin());
    s.places.push_back(place);
  }
  const bool one_for_all = s.repeats || s.positions() == 1;
  const std::size_t wanted =
      one_for_all ? s.artefacts.size() : static_cast<std::size_t>(s.positions()) * s.artefacts.size();
  if (s.places.size() != wanted) {
    fields.complain(fmt::format("places has {} entries where {} positions of {} artefacts need {}", s.places.size(),
                                s.positions(), s.artefacts.size(), wanted));
  }
}

std::vector<std::array<double, 3>> triples(Fields& fields, const char* key) {
  std::vector<std::array<double, 3>> out;
  const Value list = fields.raw(key);
  if (list.is_null()) return out;
  if (!list.if_array()) fields.complain(fmt::format("{} is a list of [x, y, z]", key));
  for (const Value& entry : *list.if_array()) {
    Fields one(Value::object().set(key, entry), fields.file(), key);
    const auto numbers = one.numbers(key, 3);
    out.push_back({numbers[0], numbers[1], numbers[2]});
  }
  return out;
}

SeriesViews read_views(Fields fields) {
  SeriesViews out{.turns_deg = triples(fields, "turns_deg"),
                  .reference_diameter_mm = fields.number("reference_diameter_mm"),
                  .references_mm = triples(fields, "references_mm")};
  constexpr std::size_t kFewest = 2, kMost = 36;
  if (out.turns_deg.size() < kFewest || out.turns_deg.size() > kMost) {
    fields.complain(fmt::format("turns_deg has {} views; give {} to {}", out.turns_deg.size(), kFewest, kMost));
  }
  if (!(out.reference_diameter_mm > 0)) fields.complain("reference_diameter_mm must be positive");
  fields.finish();
  return out;
}

Series read_series(Fields fields) {
  Series s{
      .scene = fields.text("scene"), .artefacts = fields.texts("artefacts"), .captures = fields.integer("captures")};
  s.repeats = fields.optional_boolean("repeats").value_or(false);
  if (s.artefacts.empty()) fields.complain("artefacts is empty; name at least one of artefacts.toml");
  if (s.captures < 1 || s.captures > 999) fields.complain(fmt::format("captures is {}; give 1 to 999", s.captures));
  s.captures_per_position = fields.optional_integer("captures_per_position").value_or(1);
  if (s.captures_per_position < 1 || s.captures_per_position > kMostPerPosition) {
    fields.complain(
        fmt::format("captures_per_position is {}; give 1 to {}", s.captures_per_position, kMostPerPosition));
  }
  if (s.captures % s.captures_per_position != 0) {
    fields.complain(fmt::format("captures is {}, which is not a multiple of captures_per_position, {}", s.captures,
                                s.captures_per_position));
  }
  if (s.repeats && s.captures_per_position > 1) {
    fields.complain("repeats are captures of one place already; leave captures_per_position out");
  }
  for (auto& q : fields.tables("quantity")) s.quantities.push_back(read_quantity(std::move(q)));
  read_places(fields, s);
  if (auto views = fields.optional_table("views")) s.views = read_views(*std::move(views));
  if (s.views && s.artefacts.size() != 1) fields.complain("a series with views has one artefact");
  if (s.quantities.empty()) fields.complain("there is no [[series.quantity]]: nothing would be evaluated");
  fields.finish();
  return s;
}

}  // namespace

std::vector<std::array<double, 6>> Series::places_of(int capture) const {
  const std::size_t n = artefacts.size();
  if (places.empty()) return {};
  const std::size_t first = places.size() == n ? 0 : static_cast<std::size_t>(position_of(capture)) * n;
  return {places.begin() + static_cast<std::ptrdiff_t>(first), places.begin() + static_cast<std::ptrdiff_t>(first + n)};
}

const char* name_of(Measurand measurand) {
  for (const auto& [known, name] : kMeasurands) {
    if (known == measurand) return name;
  }
  throw std::logic_error("a measurand without a name");
}

std::vector<std::string> shipped_plans() {
  std::vector<std::string> out;
  out.reserve(kPlanTexts.size());
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
  plan.diagnose = fields.optional_boolean("diagnose").value_or(false);
  if (plan.diagnose && (plan.series.size() != 1 || plan.series.front().captures != 1)) {
    fields.complain("diagnose is for a plan of one series with one capture");
  }
  fields.finish();
  return plan;
}

std::string capture_name(const Series& series, int capture) {
  const std::string position = fmt::format("{}-{:02}", series.scene, series.position_of(capture));
  const int which = capture % series.captures_per_position;
  return series.captures_per_position > 1 ? position + static_cast<char>('a' + which) : position;
}

std::string view_name(const Series& series, int capture, int view) {
  const std::string name = capture_name(series, capture);
  return series.views ? fmt::format("{}-{}", name, view) : name;
}

}  // namespace fringecal::metrology

#include "metrology/verification.h"

#include "core/provenance_reader.h"

#include <fmt/format.h>

namespace fringecal::metrology {
namespace {

constexpr const char* kSchema = "fringecal.verification";
constexpr int kVersion = 1;

Value texts(const std::vector<std::string>& lines) {
  Value out = Value::array();
  for (const auto& line : lines) out.append(line);
  return out;
}

Value to_value(const Validation& v) {
  return Value::object()
      .set("d_low", v.d_low)
      .set("d_high", v.d_high)
      .set("tolerance", v.tolerance)
      .set("valid", v.valid);
}

Validation read_validation(Fields fields) {
  Validation out;
  out.d_low = fields.number("d_low");
  out.d_high = fields.number("d_high");
  out.tolerance = fields.number("tolerance");
  out.valid = fields.boolean("valid");
  fields.finish();
  return out;
}

Value to_value(const Quantity& q) {
  Value budget = Value::array();
  for (const auto& c : q.budget) budget.append(metrology::to_value(c));
  Value out = Value::object()
                  .set("symbol", q.symbol)
                  .set("name", q.name)
                  .set("artefact", q.artefact)
                  .set("position", q.position)
                  .set("unit", q.unit)
                  .set("value", q.value)
                  .set("uncertainty", metrology::to_value(q.uncertainty))
                  .set("budget", budget)
                  .set("n_points", q.n_points)
                  .set("n_rejected", q.n_rejected);
  if (q.validation) out.set("monte_carlo_validation", to_value(*q.validation));
  if (q.limits && q.limits->lower) out.set("lower_limit", *q.limits->lower);
  if (q.limits && q.limits->upper) out.set("upper_limit", *q.limits->upper);
  if (q.judgement) out.set("judgement", metrology::to_value(*q.judgement));
  if (q.u_of_later_measurements) out.set("u_of_later_measurements", *q.u_of_later_measurements);
  return out;
}

Quantity read_quantity(Fields fields) {
  Quantity q;
  q.symbol = fields.text("symbol");
  q.name = fields.text("name");
  q.artefact = fields.text("artefact");
  q.position = fields.text("position");
  q.unit = fields.text("unit");
  q.value = fields.number("value");
  q.uncertainty = read_combined(fields.table("uncertainty"));
  for (auto& c : fields.tables("budget")) q.budget.push_back(read_contribution(std::move(c)));
  q.n_points = fields.integer("n_points");
  q.n_rejected = fields.integer("n_rejected");
  if (auto validation = fields.optional_table("monte_carlo_validation")) q.validation = read_validation(*validation);
  const auto lower = fields.optional_number("lower_limit"), upper = fields.optional_number("upper_limit");
  if (lower || upper) q.limits = Limits{lower, upper};
  if (auto judgement = fields.optional_table("judgement")) q.judgement = read_judgement(*judgement);
  q.u_of_later_measurements = fields.optional_number("u_of_later_measurements");
  fields.finish();
  return q;
}

Value to_value(const ArtefactUsed& a) {
  Value values = Value::array();
  for (const auto& v : a.values) {
    values.append(Value::object().set("name", v.name).set("value_mm", v.value_mm).set("U_mm", v.U_mm).set("k", v.k));
  }
  return Value::object()
      .set("name", a.name)
      .set("kind", a.kind)
      .set("certificate", a.certificate)
      .set("laboratory", a.laboratory)
      .set("date", a.date)
      .set("valid_until", a.valid_until)
      .set("expired_accepted", a.expired_accepted)
      .set("values", values);
}

ArtefactUsed read_artefact(Fields fields) {
  ArtefactUsed a;
  a.name = fields.text("name");
  a.kind = fields.text("kind");
  a.certificate = fields.text("certificate");
  a.laboratory = fields.text("laboratory");
  a.date = fields.text("date");
  a.valid_until = fields.text("valid_until");
  a.expired_accepted = fields.boolean("expired_accepted");
  for (auto& v : fields.tables("values")) {
    a.values.push_back({v.text("name"), v.number("value_mm"), v.number("U_mm"), v.number("k")});
    v.finish();
  }
  fields.finish();
  return a;
}

Value to_value(const GaugeSummary& s) {
  return Value::object()
      .set("symbol", s.symbol)
      .set("artefact", s.artefact)
      .set("captures", s.captures)
      .set("repeats", s.repeats)
      .set("mean_mm", s.mean_mm)
      .set("repeatability_mm", s.repeatability_mm)
      .set("reproducibility_mm", s.reproducibility_mm);
}

Environment read_environment(Fields fields) {
  Environment out;
  out.temperature_degC = fields.number("temperature_degC");
  out.u_temperature_degC = fields.number("u_temperature_degC");
  out.humidity_percent = fields.optional_number("humidity_percent");
  fields.finish();
  return out;
}

}  // namespace

std::optional<Verdict> verdict_of(const Verification& verification) {
  std::optional<Verdict> out;
  for (const auto& q : verification.quantities) {
    if (q.judgement) out = out ? worst(*out, q.judgement->verdict) : q.judgement->verdict;
  }
  return out;
}

Value to_value(const Verification& v) {
  Value artefacts = Value::array(), quantities = Value::array();
  for (const auto& a : v.artefacts) artefacts.append(to_value(a));
  for (const auto& q : v.quantities) quantities.append(to_value(q));
  Value environment = Value::object()
                          .set("temperature_degC", v.environment.temperature_degC)
                          .set("u_temperature_degC", v.environment.u_temperature_degC);
  if (v.environment.humidity_percent) environment.set("humidity_percent", *v.environment.humidity_percent);
  Value out = Value::object()
                  .set("schema", kSchema)
                  .set("schema_version", kVersion)
                  .set("plan", v.plan)
                  .set("plan_source", v.plan_source)
                  .set("plan_unchecked", texts(v.plan_unchecked))
                  .set("scanner", v.scanner)
                  .set("scanner_file_sha256", v.scanner_file_sha256)
                  .set("begun", v.begun)
                  .set("ended", v.ended)
                  .set("environment", environment)
                  .set("decision_rule", name_of(v.decision_rule))
                  .set("artefacts", artefacts)
                  .set("quantities", quantities)
                  .set("deviations", texts(v.deviations));
  if (!v.summaries.empty()) {
    Value list = Value::array();
    for (const auto& s : v.summaries) list.append(to_value(s));
    out.set("summaries", list);
  }
  if (v.diagnosis) out.set("diagnosis", metrology::to_value(*v.diagnosis));
  if (!v.features.empty()) {
    Value features = Value::array();
    for (const auto& f : v.features) features.append(to_value(f));
    out.set("features", features);
  }
  if (const auto verdict = verdict_of(v)) out.set("verdict", name_of(*verdict));
  return out.set("provenance", fringecal::to_value(v.provenance));
}

Verification verification_from(const Value& value, const std::string& name) {
  Fields fields(value, name);
  fields.expect_schema(kSchema, kVersion);
  Verification v;
  v.plan = fields.text("plan");
  v.plan_source = fields.text("plan_source");
  v.plan_unchecked = fields.texts("plan_unchecked");
  v.scanner = fields.text("scanner");
  v.scanner_file_sha256 = fields.text("scanner_file_sha256");
  v.begun = fields.text("begun");
  v.ended = fields.text("ended");
  v.environment = read_environment(fields.table("environment"));
  v.decision_rule = decision_rule_from(fields.text("decision_rule"));
  for (auto& a : fields.tables("artefacts")) v.artefacts.push_back(read_artefact(std::move(a)));
  for (auto& q : fields.tables("quantities")) v.quantities.push_back(read_quantity(std::move(q)));
  v.deviations = fields.texts("deviations");
  for (auto& s : fields.tables("summaries")) {
    GaugeSummary one{s.text("symbol"), s.text("artefact"), s.integer("captures"), s.boolean("repeats")};
    one.mean_mm = s.number("mean_mm");
    one.repeatability_mm = s.number("repeatability_mm");
    one.reproducibility_mm = s.number("reproducibility_mm");
    s.finish();
    v.summaries.push_back(one);
  }
  if (auto diagnosis = fields.optional_table("diagnosis")) v.diagnosis = diagnosis_from(*diagnosis);
  for (auto& f : fields.tables("features")) v.features.push_back(measured_feature_from(std::move(f)));
  const auto stated = fields.optional_text("verdict");
  v.provenance = provenance_from(fields.table("provenance"));
  fields.finish();
  const auto found = verdict_of(v);
  if (stated.value_or("") != (found ? name_of(*found) : "")) {
    fields.complain(fmt::format("the verdict \"{}\" is not the worst of its quantities, \"{}\"; the file was altered",
                                stated.value_or(""), found ? name_of(*found) : ""));
  }
  return v;
}

Verification read_verification(const std::filesystem::path& file) {
  return verification_from(read_json(file), file.string());
}

}  // namespace fringecal::metrology

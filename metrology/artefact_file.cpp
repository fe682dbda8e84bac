#include "metrology/artefact_file.h"

#include "core/error.h"
#include "core/fields.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace fringecal::metrology {
namespace {

constexpr const char* kSchema = "fringecal.artefacts";
constexpr int kVersion = 1;
constexpr std::array kKinds = {std::pair(GaugeKind::sphere, "sphere"),
                               std::pair(GaugeKind::ball_bar, "ball_bar"),
                               std::pair(GaugeKind::sphere_plate, "sphere_plate"),
                               std::pair(GaugeKind::flat, "flat"),
                               std::pair(GaugeKind::cylinder, "cylinder"),
                               std::pair(GaugeKind::step, "step")};
constexpr std::size_t kFewestCentres = 3, kMostCentres = 12;  // orders of more take long to try

GaugeKind kind_from(Fields& fields) {
  const std::string name = fields.text("kind");
  for (const auto& [kind, known] : kKinds) {
    if (name == known) return kind;
  }
  fields.complain(fmt::format("kind is \"{}\"; known: sphere, ball_bar, sphere_plate, flat, cylinder, step", name));
}

std::size_t diameters_of(const Gauge& g) {
  if (g.kind == GaugeKind::flat || g.kind == GaugeKind::step) return 0;
  if (g.kind == GaugeKind::sphere_plate) return g.centres_mm.size();
  return g.kind == GaugeKind::ball_bar ? 2 : 1;
}

std::vector<Eigen::Vector3d> centres_from(Fields& fields) {
  const Value list = fields.raw("centres_mm");
  if (!list.if_array() || list.if_array()->size() < kFewestCentres || list.if_array()->size() > kMostCentres) {
    fields.complain(fmt::format("centres_mm is a list of {} to {} centres [x, y, z]", kFewestCentres, kMostCentres));
  }
  std::vector<Eigen::Vector3d> out;
  for (const Value& one : *list.if_array()) {
    Fields centre(Value::object().set("centre", one), fields.file(), "centres_mm");
    const auto x = centre.numbers("centre", 3);
    out.emplace_back(x[0], x[1], x[2]);
  }
  return out;
}

double positive(Fields& fields, const char* key) {
  const double x = fields.number(key);
  if (!(x > 0)) fields.complain(fmt::format("{} is {}; it must be positive", key, x));
  return x;
}

double not_negative(Fields& fields, const char* key) {
  const double x = fields.optional_number(key).value_or(0);
  if (!(x >= 0)) fields.complain(fmt::format("{} is {}; it must not be negative", key, x));
  return x;
}

std::string day(Fields& fields, const char* key) {
  std::string text = fields.text(key);
  const bool looks = text.size() == 10 && text[4] == '-' && text[7] == '-' &&
                     std::all_of(text.begin(), text.end(), [](char c) { return c == '-' || (c >= '0' && c <= '9'); });
  if (!looks) fields.complain(fmt::format("{} is \"{}\"; write a day as 2026-03-01", key, text));
  return text;
}

Gauge read_gauge(Fields fields) {
  Gauge g{.name = fields.text("name"), .kind = kind_from(fields)};
  if (g.kind == GaugeKind::sphere_plate) g.centres_mm = centres_from(fields);
  if (const std::size_t n = diameters_of(g); n > 0) {
    g.diameter_mm = n == 1 ? std::vector<double>{positive(fields, "diameter_mm")} : fields.numbers("diameter_mm", n);
    for (const double d : g.diameter_mm) {
      if (!(d > 0)) fields.complain(fmt::format("diameter_mm has {}; a diameter is positive", d));
    }
    g.U_diameter_mm = positive(fields, "U_diameter_mm");
  }
  if (g.kind == GaugeKind::ball_bar) {
    g.distance_mm = positive(fields, "distance_mm");
  } else if (g.kind == GaugeKind::step) {
    g.distance_mm = positive(fields, "height_mm");
    g.U_distance_mm = positive(fields, "U_height_mm");
  }
  if (g.kind == GaugeKind::ball_bar || g.kind == GaugeKind::sphere_plate) {
    g.U_distance_mm = positive(fields, "U_distance_mm");
  }
  g.form_mm = not_negative(fields, "form_mm");
  g.U_form_mm = not_negative(fields, "U_form_mm");
  g.fixture_mm = not_negative(fields, "fixture_mm");
  g.k = positive(fields, "k");
  g.expansion_per_K = fields.number("expansion_per_K");
  g.u_expansion_per_K = not_negative(fields, "u_expansion_per_K");
  g.reference_temperature_degC = fields.optional_number("reference_temperature_degC").value_or(20);
  g.certificate = fields.text("certificate");
  g.laboratory = fields.text("laboratory");
  g.date = day(fields, "date");
  g.valid_until = day(fields, "valid_until");
  if (g.valid_until < g.date) fields.complain("valid_until is before date");
  fields.finish();
  return g;
}

}  // namespace

const char* name_of(GaugeKind kind) {
  for (const auto& [known, name] : kKinds) {
    if (known == kind) return name;
  }
  throw std::logic_error("a kind of artefact without a name");
}

std::vector<Gauge> read_gauges(const std::filesystem::path& file) {
  Fields fields(read_toml(file), file.string());
  fields.expect_schema(kSchema, kVersion);
  std::vector<Gauge> out;
  for (auto& table : fields.tables("artefact")) out.push_back(read_gauge(std::move(table)));
  fields.finish();
  if (out.empty()) fields.complain("there is no [[artefact]] in it");
  for (std::size_t i = 0; i < out.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (out[i].name == out[j].name) fields.complain(fmt::format("two artefacts are named \"{}\"", out[i].name));
    }
  }
  return out;
}

Value to_value(const std::vector<Gauge>& gauges) {
  Value list = Value::array();
  for (const auto& g : gauges) {
    Value one = Value::object().set("name", g.name).set("kind", name_of(g.kind));
    if (g.diameter_mm.size() == 1) one.set("diameter_mm", g.diameter_mm.front());
    if (g.diameter_mm.size() > 1) one.set("diameter_mm", Value::numbers(g.diameter_mm));
    if (!g.diameter_mm.empty()) one.set("U_diameter_mm", g.U_diameter_mm);
    if (g.kind == GaugeKind::step) {
      one.set("height_mm", *g.distance_mm).set("U_height_mm", g.U_distance_mm);
    } else if (g.distance_mm) {
      one.set("distance_mm", *g.distance_mm).set("U_distance_mm", g.U_distance_mm);
    }
    if (!g.centres_mm.empty()) {
      Value centres = Value::array();
      for (const auto& c : g.centres_mm) centres.append(Value::numbers(c));
      one.set("U_distance_mm", g.U_distance_mm).set("centres_mm", centres);
    }
    list.append(one.set("form_mm", g.form_mm)
                    .set("U_form_mm", g.U_form_mm)
                    .set("fixture_mm", g.fixture_mm)
                    .set("k", g.k)
                    .set("expansion_per_K", g.expansion_per_K)
                    .set("u_expansion_per_K", g.u_expansion_per_K)
                    .set("reference_temperature_degC", g.reference_temperature_degC)
                    .set("certificate", g.certificate)
                    .set("laboratory", g.laboratory)
                    .set("date", g.date)
                    .set("valid_until", g.valid_until));
  }
  return Value::object().set("schema", kSchema).set("schema_version", kVersion).set("artefact", list);
}

std::string to_toml(const std::vector<Gauge>& gauges) {
  // A JSON text of plain values is a TOML value; one table per artefact.
  std::string out = fmt::format("schema = \"{}\"\nschema_version = {}\n", kSchema, kVersion);
  const Value all = to_value(gauges);
  for (const auto& gauge : *all.find("artefact")->if_array()) {
    out += "\n[[artefact]]\n";
    for (const auto& [key, value] : *gauge.if_object()) {
      std::string text = to_json(value);
      while (!text.empty() && text.back() == '\n') text.pop_back();
      out += fmt::format("{} = {}\n", key, text);
    }
  }
  return out;
}

std::vector<CertifiedDistance> distances_of(const Gauge& g) {
  if (g.kind == GaugeKind::step) return {{0, 1, *g.distance_mm, "height"}};
  if (g.distance_mm) return {{0, 1, *g.distance_mm, "distance"}};
  std::vector<CertifiedDistance> out;
  for (std::size_t i = 0; i < g.centres_mm.size(); ++i) {
    for (std::size_t j = i + 1; j < g.centres_mm.size(); ++j) {
      out.push_back({static_cast<int>(i), static_cast<int>(j), (g.centres_mm[i] - g.centres_mm[j]).norm(),
                     fmt::format("distance {}-{}", i + 1, j + 1)});
    }
  }
  return out;
}

std::string part_name(const Gauge& g, int part) {
  if (g.kind == GaugeKind::ball_bar) return part == 0 ? "A" : "B";
  if (g.kind == GaugeKind::step) return part == 0 ? "lower" : "upper";
  return g.kind == GaugeKind::sphere_plate ? std::to_string(part + 1) : "";
}

const Gauge& gauge_named(const std::vector<Gauge>& gauges, const std::string& name) {
  std::string known;
  for (const auto& g : gauges) {
    if (g.name == name) return g;
    known += (known.empty() ? "" : ", ") + g.name;
  }
  throw InputError(fmt::format("the plan asks for the artefact \"{}\"; there are: {}", name, known));
}

bool is_expired(const Gauge& gauge, const std::string& day) { return gauge.valid_until < day.substr(0, 10); }

double length_at(const Gauge& g, double length_mm, const Environment& environment) {
  return length_mm * (1 + g.expansion_per_K * (environment.temperature_degC - g.reference_temperature_degC));  // eq. 1
}

std::vector<Contribution> contributions_of(const Gauge& g, double length_mm, double U_mm, const Environment& e) {
  const double difference = e.temperature_degC - g.reference_temperature_degC;
  std::vector<Contribution> out = {
      {.name = "certificate of the artefact", .u = U_mm / g.k, .sensitivity = -1},  // eq. 2
      {.name = "thermal expansion coefficient",
       .u = g.u_expansion_per_K,
       .unit = "1/K",
       .sensitivity = -length_mm * difference},
      {.name = "temperature of the artefact",
       .form = Form::rectangular,
       .u = e.u_temperature_degC,
       .unit = "K",
       .sensitivity = -length_mm * g.expansion_per_K},
      {.name = "expansion coefficient and temperature, second order",
       .u = g.u_expansion_per_K * e.u_temperature_degC,
       .unit = "1",
       .sensitivity = -length_mm}};
  if (g.fixture_mm > 0) out.push_back({.name = "fixture", .u = g.fixture_mm, .sensitivity = -1});
  return out;
}

ArtefactUsed used(const Gauge& g, bool expired_accepted) {
  ArtefactUsed out{.name = g.name,
                   .kind = name_of(g.kind),
                   .certificate = g.certificate,
                   .laboratory = g.laboratory,
                   .date = g.date,
                   .valid_until = g.valid_until,
                   .expired_accepted = expired_accepted};
  for (const double d : g.diameter_mm) out.values.push_back({"diameter", d, g.U_diameter_mm, g.k});
  for (const auto& d : distances_of(g)) out.values.push_back({d.name, d.value_mm, g.U_distance_mm, g.k});
  if (g.U_form_mm > 0) out.values.push_back({"form", g.form_mm, g.U_form_mm, g.k});
  return out;
}

}  // namespace fringecal::metrology

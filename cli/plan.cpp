// fringecal plan: what a verification plan asks for, its text to start from, what it will know, and what is still missing.
#include "metrology/plan.h"
#include "cli/commands.h"
#include "cli/virtual_verification.h"
#include "core/error.h"
#include "core/file.h"
#include "core/value.h"
#include "metrology/prediction.h"
#include "reports/plan_page.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <memory>

namespace fringecal::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string name, scanner, artefacts, commissioning, page, record;
  double u_phase_mrad = 9, temperature_degC = 20, u_temperature_degC = 0.2;
  bool print = false, json = false;
};

Value to_value(const metrology::Plan& plan) {
  Value series = Value::array(), unchecked = Value::array();
  for (const auto& line : plan.unchecked) unchecked.append(line);
  for (const auto& s : plan.series) {
    Value artefacts = Value::array(), captures = Value::array(), quantities = Value::array();
    for (const auto& name : s.artefacts) artefacts.append(name);
    for (int i = 0; i < s.captures; ++i) {
      for (int view = 0; view < s.views_of_a_capture(); ++view) captures.append(metrology::view_name(s, i, view));
    }
    for (const auto& q : s.quantities) {
      Value one = Value::object().set("symbol", q.symbol).set("name", q.name);
      if (q.limits && q.limits->lower) one.set("lower_mm", *q.limits->lower);
      if (q.limits && q.limits->upper) one.set("upper_mm", *q.limits->upper);
      quantities.append(one);
    }
    series.append(Value::object()
                      .set("scene", s.scene)
                      .set("artefacts", artefacts)
                      .set("repeats", s.repeats)
                      .set("captures_per_position", s.captures_per_position)
                      .set("captures", captures)
                      .set("quantities", quantities));
  }
  return Value::object()
      .set("name", plan.name)
      .set("title", plan.title)
      .set("source", plan.source)
      .set("unchecked", unchecked)
      .set("decision_rule", metrology::name_of(plan.decision_rule))
      .set("series", series);
}

std::string limits_of(const std::optional<metrology::Limits>& limits) {
  if (!limits) return "no limit";
  if (limits->lower && limits->upper) return fmt::format("{:+g} .. {:+g}", *limits->lower, *limits->upper);
  return limits->upper ? fmt::format("<= {:g}", *limits->upper) : fmt::format(">= {:g}", *limits->lower);
}

void show(const metrology::Plan& plan) {
  fmt::print("{}: {}\nsource: {}\nrule: {}\n", plan.name, plan.title, plan.source,
             metrology::sentence_of(plan.decision_rule));
  for (const auto& line : plan.unchecked) fmt::print("not checked: {}\n", line);
  for (const auto& series : plan.series) {
    const int views = series.views_of_a_capture();
    fmt::print("\n{} {} of {}{}{}, captures {} .. {}\n", series.positions(), series.repeats ? "repeats" : "positions",
               fmt::join(series.artefacts, ", "),
               series.captures_per_position > 1
                   ? fmt::format(", the mean of {} captures each", series.captures_per_position)
                   : "",
               series.views ? fmt::format(", {} views each", views) : "", metrology::view_name(series, 0, 0),
               metrology::view_name(series, series.captures - 1, views - 1));
    if (series.views) {
      fmt::print("  on a carrier with reference spheres of {:g} mm, turned for each view\n",
                 series.views->reference_diameter_mm);
    }
    for (const auto& q : series.quantities) {
      fmt::print("  {:<18}{:<48}{}{}\n", q.symbol, q.name, limits_of(q.limits), q.limits ? " mm" : "");
    }
  }
}

/// The larger of the limits' distances from zero: what U is a share of.
std::optional<double> width_of(const std::optional<metrology::Limits>& limits) {
  if (!limits) return std::nullopt;
  return std::max(std::abs(limits->lower.value_or(0)), std::abs(limits->upper.value_or(0)));
}

std::string share_of(const metrology::Quantity& q) {
  const auto width = width_of(q.limits);
  return width && *width > 0 ? fmt::format("{:.0f} %", 100 * q.uncertainty.U / *width) : "-";
}

std::string later_of(const metrology::Quantity& q) {
  return q.u_of_later_measurements ? fmt::format("{:.4f}", *q.u_of_later_measurements) : "-";
}

/// Outlines of the artefacts of a series at all their places.
reports::PlanPageSeries outlines(const metrology::Series& series, const std::vector<metrology::Gauge>& gauges) {
  reports::PlanPageSeries out{.label = series.scene, .lines = {}};
  for (int i = 0; i < (series.repeats ? 1 : series.positions()); ++i) {
    for (const auto& line : metrology::outlines_of(series, i * series.captures_per_position, gauges)) {
      reports::SpaceLine one;
      for (const auto& p : line) {
        one.x.push_back(p.x());
        one.y.push_back(p.y());
        one.z.push_back(p.z());
      }
      out.lines.push_back(std::move(one));
    }
  }
  return out;
}

std::vector<reports::SpaceLine> closed(const std::vector<std::vector<Eigen::Vector3d>>& lines) {
  std::vector<reports::SpaceLine> out;
  for (const auto& line : lines) {
    reports::SpaceLine one;
    for (std::size_t k = 0; k <= line.size() && !line.empty(); ++k) {
      const auto& p = line[k % line.size()];
      one.x.push_back(p.x());
      one.y.push_back(p.y());
      one.z.push_back(p.z());
    }
    out.push_back(std::move(one));
  }
  return out;
}

void predict(const metrology::Plan& plan, const Options& o) {
  const auto gauges =
      o.artefacts.empty() ? VirtualVerification(o.commissioning).gauges() : metrology::read_gauges(o.artefacts);
  const auto scanner =
      model::read_scanner(o.scanner.empty() ? (fs::path(o.commissioning) / "scanner.json").string() : o.scanner);
  const metrology::PredictOptions options{.u_phase_rad = 1e-3 * o.u_phase_mrad,
                                          .environment = {o.temperature_degC, o.u_temperature_degC, {}}};
  const auto predicted = metrology::predict(plan, gauges, scanner, options);
  if (!predicted) throw InputError(fmt::format("{}: {}", plan.name, predicted.error().sentence));
  reports::PlanPage page{.title = fmt::format("{}: {}", plan.name, plan.title),
                         .scanner = fmt::format("Scanner {}, base line {:.1f} mm, working distance {:.0f} mm",
                                                scanner.name, scanner.base_mm(), scanner.working_distance_mm),
                         .assumption = fmt::format(
                             "Phase noise {:g} mrad on a white board square to the light, {:g} degC with u = {:g} K; "
                             "certificates and calibration as in their files.",
                             o.u_phase_mrad, o.temperature_degC, o.u_temperature_degC)};
  fmt::print("\n{}\n{:<16}{:<10}{:<22}{:>10}  {:<18}{:>14}{:>12}\n", page.assumption, "quantity", "artefact",
             "position", "U / mm", "limits / mm", "U of the limit", "u later / mm");
  for (const auto& series : *predicted) {
    for (const auto& q : series.quantities) {
      const std::string U = fmt::format("{:.4f}", q.uncertainty.U);
      fmt::print("{:<16}{:<10}{:<22}{:>10}  {:<18}{:>14}{:>12}\n", q.symbol, q.artefact, q.position, U,
                 limits_of(q.limits), share_of(q), later_of(q));
      page.rows.push_back({q.symbol, q.artefact, q.position, U, limits_of(q.limits), share_of(q), later_of(q)});
    }
    for (const auto& problem : series.problems) {
      fmt::print("cannot be evaluated: {}\n", problem);
      page.problems.push_back("Cannot be evaluated: " + problem);
    }
  }
  if (o.page.empty()) return;
  for (const auto& series : plan.series) page.series.push_back(outlines(series, gauges));
  const auto fields = metrology::fields_of(plan, scanner);
  page.camera_field = closed(fields.camera);
  page.coded_field = closed(fields.code);
  write_atomically(o.page, reports::plan_page(page));
  fmt::print("\npositions drawn in {}\n", o.page);
}

/// What of the plan a folder of captures, or of a verification, has.
void compare_with(const metrology::Plan& plan, const fs::path& folder) {
  if (!fs::is_directory(folder)) throw InputError(fmt::format("{}: is not a folder", folder.string()));
  std::vector<std::string> missing;
  int all = 0, evaluated = 0, captured = 0;
  for (const auto& series : plan.series) {
    for (int i = 0; i < series.captures; ++i) {
      for (int view = 0; view < series.views_of_a_capture(); ++view) {
        const std::string name = metrology::view_name(series, i, view);
        ++all;
        if (fs::exists(folder / "captures" / (metrology::capture_name(series, i) + ".json"))) {
          ++evaluated;
        } else if (fs::exists(folder / name / "capture.json")) {
          ++captured;
        } else {
          missing.push_back(name);
        }
      }
    }
  }
  fmt::print("\n{}: {} of {} captures evaluated, {} captured; ", folder.string(), evaluated, all, captured);
  fmt::print("{}\n", missing.empty() ? "nothing is missing" : fmt::format("missing: {}", fmt::join(missing, ", ")));
}

void plan(const Options& o) {
  if (o.json) {
    Value plans = Value::array();
    for (const auto& name : metrology::shipped_plans()) plans.append(to_value(metrology::read_plan(name)));
    fmt::print("{}", to_json(o.name.empty() ? plans : to_value(metrology::read_plan(o.name))));
    return;
  }
  if (o.name.empty()) {
    for (const auto& name : metrology::shipped_plans()) {
      fmt::print("{:<14}{}\n", name, metrology::read_plan(name).title);
    }
    return;
  }
  if (o.print) {
    fmt::print("{}", metrology::plan_text(o.name));
    return;
  }
  const auto plan = metrology::read_plan(o.name);
  show(plan);
  if (!o.scanner.empty() && o.artefacts.empty() && o.commissioning.empty()) {
    throw InputError("--scanner needs the artefacts that will be used; give --artefacts");
  }
  if (!o.commissioning.empty() || !o.scanner.empty()) predict(plan, o);
  if (!o.record.empty()) compare_with(plan, o.record);
}

}  // namespace

void add_plan(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto* command =
      app.add_subcommand("plan",
                         "What a verification plan asks for, and with a scanner what it will know; without a "
                         "name: the shipped plans");
  command->add_option("name", o->name, "A shipped plan or a plan file");
  command->add_flag("--print", o->print, "Print the text of a shipped plan, to start a plan of one's own from");
  command->add_option("--scanner", o->scanner,
                      "Scanner file: predict the uncertainty of each quantity before any capture");
  command->add_option("--artefacts", o->artefacts, "artefacts.toml, for the prediction");
  command->add_option("--commissioning", o->commissioning,
                      "Commissioning of the virtual scanner, instead of --scanner and --artefacts");
  command->add_option("--phase-noise", o->u_phase_mrad, "Of a pixel, on a white board square to the light, mrad")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--temperature", o->temperature_degC, "Expected of the artefacts, degC")->capture_default_str();
  command->add_option("--u-temperature", o->u_temperature_degC, "Its standard uncertainty, K")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--page", o->page, "HTML page to write: the positions drawn in the volume, and the prediction");
  command->add_option("--record", o->record,
                      "Folder of captures or of a verification: say what of the plan is missing");
  command->add_flag("--json", o->json, "Print the plan, or all shipped ones, as JSON")
      ->excludes("--print")
      ->excludes("--scanner")
      ->excludes("--commissioning")
      ->excludes("--record");
  command->footer(
      "Examples:\n  fringecal plan vdi2634-2 --print > acceptance.toml\n"
      "  fringecal plan vdi2634-2 --scanner scanner.json --artefacts artefacts.toml --page plan.html\n"
      "  fringecal plan vdi2634-2 --record acceptance");
  command->callback([o] { plan(*o); });
}

}  // namespace fringecal::cli

// fringecal plan: what a verification plan asks for, and its text to start from.
#include "metrology/plan.h"
#include "cli/commands.h"
#include "core/value.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string name;
  bool print = false, json = false;
};

Value to_value(const metrology::Plan& plan) {
  Value series = Value::array(), unchecked = Value::array();
  for (const auto& line : plan.unchecked) unchecked.append(line);
  for (const auto& s : plan.series) {
    Value artefacts = Value::array(), captures = Value::array(), quantities = Value::array();
    for (const auto& name : s.artefacts) artefacts.append(name);
    for (int i = 0; i < s.captures; ++i) captures.append(metrology::capture_name(s, i));
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

void show(const metrology::Plan& plan) {
  fmt::print("{}: {}\nsource: {}\nrule: {}\n", plan.name, plan.title, plan.source,
             metrology::sentence_of(plan.decision_rule));
  for (const auto& line : plan.unchecked) fmt::print("not checked: {}\n", line);
  for (const auto& series : plan.series) {
    fmt::print("\n{} {} of {}, captures {} .. {}\n", series.captures, series.repeats ? "repeats" : "positions",
               fmt::join(series.artefacts, ", "), metrology::capture_name(series, 0),
               metrology::capture_name(series, series.captures - 1));
    for (const auto& q : series.quantities) {
      std::string limits = "no limit";
      if (q.limits && q.limits->lower && q.limits->upper) {
        limits = fmt::format("{:+g} .. {:+g} mm", *q.limits->lower, *q.limits->upper);
      } else if (q.limits) {
        limits =
            q.limits->upper ? fmt::format("<= {:g} mm", *q.limits->upper) : fmt::format(">= {:g} mm", *q.limits->lower);
      }
      fmt::print("  {:<18}{:<48}{}\n", q.symbol, q.name, limits);
    }
  }
}

void plan(const Options& o) {
  if (o.json) {
    Value plans = Value::array();
    for (const auto& name : metrology::shipped_plans()) plans.append(to_value(metrology::read_plan(name)));
    fmt::print("{}", to_json(o.name.empty() ? plans : to_value(metrology::read_plan(o.name))));
  } else if (o.name.empty()) {
    for (const auto& name : metrology::shipped_plans()) {
      fmt::print("{:<14}{}\n", name, metrology::read_plan(name).title);
    }
  } else if (o.print) {
    fmt::print("{}", metrology::plan_text(o.name));
  } else {
    show(metrology::read_plan(o.name));
  }
}

}  // namespace

void add_plan(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto* command = app.add_subcommand("plan", "What a verification plan asks for; without a name: the shipped plans");
  command->add_option("name", o->name, "A shipped plan or a plan file");
  command->add_flag("--print", o->print, "Print the text of a shipped plan, to start a plan of one's own from");
  command->add_flag("--json", o->json, "Print the plan, or all shipped ones, as JSON")->excludes("--print");
  command->footer("Example: fringecal plan vdi2634-2 --print > acceptance.toml");
  command->callback([o] { plan(*o); });
}

}  // namespace fringecal::cli

// fringecal plan: what a verification plan asks for, and its text to start from.
#include "metrology/plan.h"
#include "cli/commands.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string name;
  bool print = false;
};

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
  if (o.name.empty()) {
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
  command->footer("Example: fringecal plan vdi2634-2 --print > acceptance.toml");
  command->callback([o] { plan(*o); });
}

}  // namespace fringecal::cli

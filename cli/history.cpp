// fringecal history: what was recorded, whether it was altered, and where its quantities go.
#include "metrology/history.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/history_series.h"
#include "metrology/instrument_record.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <memory>

namespace fringecal::cli {
namespace {

using metrology::History;

struct Options {
  std::string file = "history.db", kind, head, symbol, artefact, position, output;
  int last = 40;
  bool json = false;
};

void list(const Options& o) {
  const History history(o.file, History::Access::read);
  Value out = Value::array();
  std::string lines;
  history.each(
      [&](const metrology::HistoryView& e) {
        if (o.json) {
          out.append(Value::object()
                         .set("number", e.number)
                         .set("date", std::string(e.date))
                         .set("kind", std::string(e.kind))
                         .set("hash", std::string(e.hash)));
        } else {
          lines += fmt::format("{:>6}  {}  {:<14}{}  {}\n", e.number, e.date, e.kind, e.hash.substr(0, 12),
                               metrology::summary_of(e));
        }
      },
      o.kind.empty() ? std::nullopt : std::optional(o.kind));
  fmt::print("{}", o.json ? to_json(out) : lines);
}

void show(const Options& o, std::int64_t number) {
  fmt::print("{}", History(o.file, History::Access::read).entry(number).document);
}

void check(const Options& o) {
  const History history(o.file, History::Access::read);
  const auto fault = history.check(o.head.empty() ? std::nullopt : std::optional(o.head));
  if (fault) throw InputError(fmt::format("{}: {}", o.file, fault->sentence));
  fmt::print("{}: {} entries, unaltered; newest hash {}\n", o.file, history.size(), history.head());
}

std::string csv_field(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

void export_csv(const Options& o) {
  const History history(o.file, History::Access::read);
  std::string out = "number,date,plan,scanner,symbol,artefact,position,unit,value,u,U,k,verdict,hash\n";
  for (const auto& e : history.entries("verification")) {
    const auto v = metrology::verification_of(e);
    for (const auto& q : v.quantities) {
      out += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", e.number, v.ended, csv_field(v.plan),
                         csv_field(v.scanner), csv_field(q.symbol), csv_field(q.artefact), csv_field(q.position),
                         q.unit, q.value, q.uncertainty.u, q.uncertainty.U, fmt::format("{:.4g}", q.uncertainty.k),
                         q.judgement ? name_of(q.judgement->verdict) : "", e.hash);
    }
  }
  if (o.output.empty()) {
    fmt::print("{}", out);
  } else {
    write_atomically(o.output, out);
  }
}

void chart(const Options& o) {
  const History history(o.file, History::Access::read);
  if (o.symbol.empty()) {
    for (const auto& key : metrology::quantities_of(history)) fmt::print("{:<36}{}\n", key.symbol, key.artefact);
    return;
  }
  const auto series =
      metrology::series_of(history, {o.symbol, o.artefact.empty() ? metrology::kScannerItself : o.artefact,
                                     o.position.empty() ? std::nullopt : std::optional(o.position)});
  if (series.values.empty()) {
    throw InputError(fmt::format("{}: no record has {}{}; \"fringecal history chart\" lists what there is", o.file,
                                 o.symbol, o.artefact.empty() ? " of the scanner itself" : " of " + o.artefact));
  }
  const auto chart = metrology::control_chart(series.values);
  fmt::print("{} ({}){}, {}\n\n", series.name, o.symbol, o.artefact.empty() ? "" : ", " + o.artefact, series.unit);
  const std::size_t shown = std::min<std::size_t>(series.values.size(), static_cast<std::size_t>(o.last));
  if (shown < series.values.size()) fmt::print("the last {} of {} values:\n", shown, series.values.size());
  for (std::size_t i = series.values.size() - shown; i < series.values.size(); ++i) {
    std::string signals;
    if (chart) {
      for (const auto signal : chart->points[i].signals) signals += fmt::format(" {}", name_of(signal));
    }
    fmt::print("{:>6}  {:+.6g}{}{}{}\n", series.numbers[i], series.values[i].value,
               series.U[i] ? fmt::format(" ± {:.2g}", *series.U[i]) : "", signals.empty() ? "" : "  signal:", signals);
  }
  if (chart) {
    fmt::print("\nmean of the first {}: {:+.6g}, s {:.2g}, limits of control {:+.6g} .. {:+.6g}\n", chart->n_baseline,
               chart->mean, chart->s, chart->mean - 3 * chart->s, chart->mean + 3 * chart->s);
  } else {
    fmt::print("\n{}\n", chart.error().sentence);
  }
  if (!series.limits) return;
  const auto forecast = metrology::forecast(series.values, *series.limits);
  if (!forecast) {
    fmt::print("{}\n", forecast.error().sentence);
  } else if (!forecast->earliest_day) {
    fmt::print("trend {:+.2g} per day (u {:.1g}): no limit is within reach for two years\n", forecast->slope_per_day,
               forecast->u_slope_per_day);
  } else {
    const double today = series.values.back().day;
    fmt::print(
        "trend {:+.2g} per day (u {:.1g}): a limit can be reached in {:.0f} days{}; a warning, not a date of "
        "recalibration\n",
        forecast->slope_per_day, forecast->u_slope_per_day, *forecast->earliest_day - today,
        forecast->expected_day ? fmt::format(", is expected in {:.0f}", *forecast->expected_day - today) : "");
  }
}

}  // namespace

void add_history(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto number = std::make_shared<std::int64_t>(0);
  auto* command = app.add_subcommand("history", "The record of calibrations, alignments and verifications");
  command->add_option("--file", o->file, "The history")->capture_default_str();
  command->require_subcommand(1);
  auto* list_command = command->add_subcommand("list", "One line per entry");
  list_command->add_option("--kind", o->kind, "Only alignment, calibration, verification or certificate entries");
  list_command->add_flag("--json", o->json, "As JSON");
  list_command->callback([o] { list(*o); });
  auto* show_command = command->add_subcommand("show", "The document of one entry");
  show_command->add_option("number", *number, "Number of the entry")->required();
  show_command->callback([o, number] { show(*o, *number); });
  auto* check_command = command->add_subcommand("check", "Whether an entry, or any byte of the file, was altered");
  check_command->add_option("--head", o->head, "A hash that a report printed; it must stand in the chain");
  check_command->callback([o] { check(*o); });
  auto* chart_command =
      command->add_subcommand("chart", "Control chart and forecast of a quantity; without one: which there are");
  chart_command->add_option("symbol", o->symbol,
                            "PS, PF, SD, F, ...; delta, theta, kc1, kc2, kp1, kp2, ...; temperature (of the room)");
  chart_command->add_option("artefact", o->artefact, "Name of the artefact (default: the scanner itself)");
  chart_command->add_option("--position", o->position, "Only this position (default: the worst of each verification)");
  chart_command->add_option("--last", o->last, "Print this many of the newest values; all take part")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  chart_command->callback([o] { chart(*o); });
  auto* export_command = command->add_subcommand("export", "All quantities of all verifications as CSV");
  export_command->add_option("-o,--output", o->output, "File to write (default: stdout)");
  export_command->callback([o] { export_csv(*o); });
  command->footer(
      "Example: fringecal history --file history.db chart SD bar150; ... chart delta --position \"as found\"");
}

}  // namespace fringecal::cli

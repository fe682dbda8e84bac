// fringecal commission: the whole way of a new scanner - align, calibrate, verify, report - in one resumable command.
#include "cli/commands.h"
#include "cli/commission_steps.h"
#include "cli/interrupt.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  bool on_virtual = false, fresh = false, json = false;
  std::string output = "commissioning", history;
  CommissionChoices choices;
  CommissionScannerOptions scanner;
};

void commission(const Options& options) {
  if (!options.on_virtual) {
    throw InputError(
        "commission: only the virtual scanner is connected in this version; add --virtual, or use align, "
        "calibrate and measure on captures of your own");
  }
  if (options.choices.repeats < 1 || options.choices.repeats > 99) {
    throw InputError(fmt::format("--repeats {}: give 1 to 99", options.choices.repeats));
  }
  reports::check_report_tools();  // before a run of minutes, not after it
  const Interrupt interrupt;
  const CommissionSession session(options.output, options.choices, options.fresh);
  CommissionScanner instrument(session, options.scanner, interrupt.token());
  Progress progress(Weights::total(options.choices.repeats));
  const Stopwatch watch;
  std::string times;
  double before_s = 0;
  const auto took = [&](const char* what) {
    const double now_s = watch.seconds();
    times += fmt::format("{}{} {:.1f} s", times.empty() ? "" : ", ", what, now_s - before_s);
    before_s = now_s;
  };
  align_step(session, instrument, progress);
  took("aligning");
  linearise_step(session, instrument, progress);
  took("linearising");
  calibrate_step(session, instrument, progress);
  took("calibrating");
  verify_step(session, instrument, progress);
  took("verifying");
  instrument.check_stop();
  progress.start("writing the report");
  const auto report = gather_report(session, instrument);
  reports::write_commissioning_report(session.folder(), report);
  write_atomically(session.path("truth.json"), to_json(instrument.truth()));
  progress.done(Weights::report);
  took("report");
  progress.finish_step(fmt::format("report written: {}; {}", session.path("report.html").string(), times));
  if (!options.history.empty()) record_step(session, options.history);
  fmt::print("{}", options.json ? to_json(reports::to_value(report)) : summary_table(report));
}

}  // namespace

double Weights::total(int repeats) {
  return 3 * alignment + kFlatStacks * flat + kBoardPoses * pose + solve +
         static_cast<double>(verification_scenes().size()) * repeats * repeat + report;
}

void add_commission(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* command =
      app.add_subcommand("commission", "Align, calibrate, verify and report: the whole way of a new scanner");
  command->add_flag("--virtual", options->on_virtual, "Commission the virtual scanner (no hardware is needed)");
  command->add_option("-o,--output", options->output, "Folder of the commissioning; a second call continues in it")
      ->capture_default_str();
  command->add_flag("--fresh", options->fresh, "Start over: remove what an earlier commissioning left in the folder");
  command->add_option("--seed", options->choices.seed, "Seed of the virtual instrument: its errors, its noise")
      ->capture_default_str();
  command->add_option("--preset", options->choices.preset, "Virtual instrument: chen2008, or a TOML file")
      ->capture_default_str();
  command
      ->add_option("--theta", options->choices.theta_mrad, "Fringe angle to start from, mrad (default: the preset's)")
      ->check(CLI::Range(-1.5, 1.5));
  command->add_flag("!--no-linearisation", options->choices.linearisation,
                    "Verify without the phase linearisation, for comparison");
  command->add_flag("!--no-stack-correction", options->choices.stack_correction,
                    "Verify without the correction of each stack's step and lamp errors, for comparison");
  command->add_option("--repeats", options->choices.repeats, "Measurements of each artefact")->capture_default_str();
  auto* in_process = command->add_flag("--in-process", options->scanner.in_process,
                                       "Without a second process and its protocols; the results are the same");
  command
      ->add_option("--frame-log", options->scanner.frame_log,
                   "Have the virtual scanner append id and SHA-256 of every frame that it sends to this file")
      ->excludes(in_process);
  command->add_option("--history", options->history,
                      "History to append the alignment and the calibration to (made if it is not there)");
  command->add_flag("--json", options->json, "Print report.json instead of the table");
  command->footer("Example: fringecal commission --virtual --output ./commissioning --seed 7 --history history.db");
  command->callback([options] { commission(*options); });
}

}  // namespace fringecal::cli

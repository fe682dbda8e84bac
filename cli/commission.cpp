// fringecal commission: the whole way of a new scanner - align, calibrate, verify, report - in one resumable command.
#include "cli/commands.h"
#include "cli/commission_steps.h"
#include "cli/interrupt.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  bool on_virtual = false, fresh = false, json = false, accept_expired = false;
  std::string output = "commissioning", history, wiring, sheet;
  double temperature_degC = 20, u_temperature_degC = 0.2;
  CommissionChoices choices;
  CommissionScannerOptions scanner;
};

/// The sheet of a scanner of one's own, fit to be judged by.
InstrumentSheet sheet_for(const Options& options, const hw::ScannerFile& wiring) {
  InstrumentSheet sheet =
      read_sheet(options.sheet, wiring.plan, {options.temperature_degC, options.u_temperature_degC, {}});
  if (sheet.expired.empty()) return sheet;
  const std::string names = fmt::format("{}", fmt::join(sheet.expired, ", "));
  if (!options.accept_expired) {
    throw InputError(fmt::format(
        "{}: the certificate of {} has run out; have it calibrated, or add --accept-expired, which the report states",
        options.sheet, names));
  }
  sheet.note = fmt::format("The certificate of {} had run out; this was accepted.", names);
  return sheet;
}

void commission(const Options& options) {
  if (!options.on_virtual && options.wiring.empty()) {
    throw InputError("commission: give --scanner scanner.toml and --sheet instrument.toml, or --virtual");
  }
  if (options.choices.repeats < 1 || options.choices.repeats > 99) {
    throw InputError(fmt::format("--repeats {}: give 1 to 99", options.choices.repeats));
  }
  reports::check_report_tools();  // before a run of minutes, not after it
  const Interrupt interrupt;
  CommissionChoices choices = options.choices;
  std::optional<hw::ScannerFile> wiring;
  std::optional<InstrumentSheet> sheet;
  if (!options.on_virtual) {  // whatever is wrong with the files is said before the folder is made
    wiring = hw::read_scanner_file(options.wiring);
    sheet = sheet_for(options, *wiring);
    choices.sheet_sha256 = fingerprint_of_sheet(options.sheet);
  }
  const CommissionSession session(options.output, choices, options.fresh);
  std::unique_ptr<CommissionScanner> commissioned;
  if (options.on_virtual) {
    commissioned = std::make_unique<VirtualCommission>(session, options.scanner, interrupt.token());
  } else {
    commissioned = std::make_unique<OperatedCommission>(session, *sheet, *wiring, interrupt.token());
  }
  CommissionScanner& instrument = *commissioned;
  Progress progress(Weights::total(instrument.sheet().scenes.size(), choices.repeats));
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
  if (const auto truth = instrument.truth()) write_atomically(session.path("truth.json"), to_json(*truth));
  progress.done(Weights::report);
  took("report");
  progress.finish_step(fmt::format("report written: {}; {}", session.path("report.html").string(), times));
  if (!options.history.empty()) record_step(session, instrument.sheet(), options.history);
  fmt::print("{}", options.json ? to_json(reports::to_value(report)) : summary_table(report));
}

}  // namespace

double Weights::total(std::size_t scenes, int repeats) {
  return 3 * alignment + kFlatStacks * flat + kBoardPoses * pose + solve +
         static_cast<double>(scenes) * repeats * repeat + report;
}

std::string times(int n) { return n == 1 ? "once" : fmt::format("{} times", n); }

void add_commission(CLI::App& app) {
  auto options = std::make_shared<Options>();
  auto* command =
      app.add_subcommand("commission", "Align, calibrate, verify and report: the whole way of a new scanner");
  auto* on_virtual =
      command->add_flag("--virtual", options->on_virtual, "Commission the virtual scanner (no hardware is needed)");
  auto* wiring = command->add_option("--scanner", options->wiring,
                                     "scanner.toml of a scanner of one's own; the operator is asked for every step");
  auto* sheet = command->add_option("--sheet", options->sheet,
                                    "instrument.toml: its data sheets, board, artefacts and limits (docs/formats.md)");
  wiring->needs(sheet)->excludes(on_virtual);
  sheet->needs(wiring);
  command->add_option("--temperature", options->temperature_degC, "Own scanner: of the artefacts, degC")
      ->capture_default_str()
      ->needs(wiring);
  command->add_option("--u-temperature", options->u_temperature_degC, "Own scanner: its standard uncertainty, K")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber)
      ->needs(wiring);
  command
      ->add_flag("--accept-expired", options->accept_expired,
                 "Own scanner: measure with artefacts whose certificate has run out; the report states it")
      ->needs(wiring);
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
  command->footer(
      "Examples:\n  fringecal commission --virtual --output ./commissioning --seed 7 --history history.db\n"
      "  fringecal commission --scanner scanner.toml --sheet instrument.toml -o commissioning --history history.db");
  command->callback([options] { commission(*options); });
}

}  // namespace fringecal::cli

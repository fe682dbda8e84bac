#include "calib/align.h"

#include "calib/align_map.h"
#include "calib/align_record.h"
#include "cli/alignment_entry.h"
#include "cli/commands.h"
#include "core/capture.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "hw/virtual/virtual_scanner.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <filesystem>
#include <memory>

namespace fringecal::cli {
namespace {

namespace fs = std::filesystem;
constexpr int kMaxTurns = 8;

struct Options {
  std::vector<std::string> captures;
  std::string axis = "x", order = "gray-first", record, output, history, identification;
  double pattern_pitch_mm = 0, tolerance = calib::AlignmentLoopOptions{}.tolerance_of_period, turned_mrad = 0;
  std::optional<double> mrad_per_division, theta_mrad;
  std::uint64_t seed = 1;
  bool json = false, on_virtual = false;
};

calib::AlignmentLoopOptions loop_options(const Options& o) {
  calib::AlignmentLoopOptions loop{.tolerance_of_period = o.tolerance, .rad_per_division = std::nullopt};
  if (o.mrad_per_division) loop.rad_per_division = 1e-3 * *o.mrad_per_division;
  return loop;
}

/// Slots by the order of the patterns along the slide.
calib::GratingLayout layout_of(const Options& o, const std::optional<FringeCode>& code) {
  calib::GratingLayout layout{.pattern_pitch_mm = o.pattern_pitch_mm};
  if (o.order == "gray-first" || !code) return layout;
  for (int k = 0; k < code->phase_steps; ++k) layout.phase_slots.push_back(k);
  for (int b = 0; b < code->gray_bits; ++b) layout.gray_slots.push_back(code->phase_steps + b);
  return layout;
}

calib::Misalignment measure(const Capture& capture, const std::string& name, const calib::GratingLayout& layout,
                            CodeAxis axis) {
  const auto measured = calib::measure_misalignment(capture, layout, axis);
  if (!measured) throw InputError(fmt::format("{}: {}", name, measured.error().sentence));
  return *measured;
}

void print(const calib::AlignmentIteration& iteration) {
  const calib::Misalignment& m = iteration.measured;
  fmt::print("{}\n  bit   delta um    u um  of a period   rising  falling um  jump px  period px   edges\n",
             iteration.capture);
  for (const auto& b : m.bits) {
    fmt::print("  {:3} {:+10.3f} {:7.3f} {:+12.5f} {:+8.2f} {:+9.2f} {:9g} {:9g} {:9}\n", b.bit, 1e3 * b.delta_mm.value,
               1e3 * b.delta_mm.u, b.fraction_of_period, 1e3 * b.rising_mm, 1e3 * b.falling_mm, b.jump_px, b.period_px,
               b.n_edges);
  }
  fmt::print("  theta = {:+.4f} mrad, u = {:.4f} mrad (chi2/dof {:.2f})\n", 1e3 * m.theta_rad.value,
             1e3 * m.theta_rad.u, m.chi2_per_dof);
  if (m.theta_from_steps_rad) {
    fmt::print("  from the phase steps alone: {:+.4f} mrad, u = {:.4f} mrad\n", 1e3 * m.theta_from_steps_rad->value,
               1e3 * m.theta_from_steps_rad->u);
  }
  for (const auto& remark : m.remarks) fmt::print("  remark: {}\n", remark);
  fmt::print("  {}\n", iteration.step.sentence);
}

void align_capture(const Options& o) {
  const CodeAxis axis = o.axis == "x" ? CodeAxis::x : CodeAxis::y;
  calib::AlignmentHistory history;
  if (!o.record.empty() && fs::exists(o.record)) history = calib::read_record(o.record);
  if (o.turned_mrad != 0 && history.readings.empty()) {
    throw InputError("--turned needs the record of the capture before the turn; give it with --record");
  }
  calib::GratingLayout layout;
  calib::AlignmentIteration iteration{.capture = fmt::format("{}", fmt::join(o.captures, ", ")),
                                      .turn_before_rad = 1e-3 * o.turned_mrad};
  std::vector<calib::Misalignment> stacks;
  AlignmentEntry entry{.scanner = o.identification.empty() ? "not stated" : o.identification, .ended = utc_now()};
  FringeCode code;
  for (const auto& name : o.captures) {
    if (std::count(o.captures.begin(), o.captures.end(), name) > 1) {
      throw InputError(fmt::format("{}: given twice; averaging needs captures of their own", name));
    }
    const Capture capture = read_capture(name);
    layout = layout_of(o, capture.info.plan.code(axis));
    stacks.push_back(measure(capture, name, layout, axis));
    entry.captures.push_back(capture.info);
    entry.inputs.emplace_back(name, sha256_of_file(fs::path(name) / "capture.json"));
    code = *capture.info.plan.code(axis);
  }
  iteration.measured = stacks.size() == 1 ? stacks.front() : calib::average_of(stacks, layout, code);
  history.readings.push_back({iteration.measured.theta_rad, iteration.turn_before_rad});
  iteration.step = calib::next_step(history.readings, iteration.measured, code.period, loop_options(o));
  if (!o.record.empty()) write_atomically(o.record, to_json(calib::record_of(history, iteration)));
  std::string recorded;
  if (!o.history.empty()) {
    history.iterations.push_back(calib::to_value(iteration));
    recorded = append_words(o.history, record_of(entry, history.iterations, entry.inputs.back().first));
  }
  if (o.json) {
    fmt::print("{}", to_json(calib::to_value(iteration)));
  } else {
    print(iteration);
    fmt::print("{}", recorded);
  }
}

void align_virtual(const Options& o) {
  if (o.output.empty()) throw InputError("--virtual needs a folder for its results; give it with -o");
  virt::PresetOverrides overrides;
  overrides.theta_mrad = o.theta_mrad;
  virt::VirtualScanner instrument("chen2008", o.seed, overrides);
  virt::InstrumentState state;
  const calib::GratingLayout layout{.pattern_pitch_mm = instrument.pattern_pitch_mm()};
  const virt::Scene scene = instrument.standard_scene("alignment");
  FolderTransaction folder(o.output);
  std::vector<calib::AlignmentIteration> iterations;
  std::vector<calib::AlignmentReading> readings;
  double turn_mrad = 0;
  for (int i = 0; i <= kMaxTurns; ++i) {
    calib::AlignmentIteration iteration{.capture = fmt::format("setting {}", i), .turn_before_rad = 1e-3 * turn_mrad};
    const auto take = [&](int k) {
      const Capture capture = instrument.capture(scene, state, o.seed * 1000 + static_cast<std::uint64_t>(20 * i + k));
      if (k == 0) {
        const auto profile = calib::alignment_profile(capture, CodeAxis::x, capture.info.height_px / 2);
        write_atomically(folder.working() / fmt::format("profile-{}.json", i), to_json(calib::to_value(profile)));
      }
      auto one = calib::measure_misalignment(capture, layout);
      if (k == 0 && one) {
        write_atomically(folder.working() / fmt::format("delta-{}.tiff", i),
                         encode_tiff(calib::delta_map_um(capture, *one, CodeAxis::x)));
      }
      return one;
    };
    const auto reading = calib::read_setting(take, readings,
                                             {.turn_before_rad = iteration.turn_before_rad,
                                              .layout = layout,
                                              .code = *instrument.plan().x,
                                              .loop = loop_options(o)});
    if (!reading) throw InputError(fmt::format("{}: {}", iteration.capture, reading.error().sentence));
    iteration.measured = reading->measured;
    iteration.step = reading->step;
    readings.push_back({iteration.measured.theta_rad, iteration.turn_before_rad});
    iterations.push_back(iteration);
    if (!o.json) print(iteration);
    if (iteration.step.decision != calib::AlignmentDecision::turn) break;
    turn_mrad = 1e3 * iteration.step.turn_rad;
    instrument.turn_adjuster(turn_mrad, state);
  }
  const Value record = calib::record_of(iterations);
  write_atomically(folder.working() / "alignment.json", to_json(record));
  folder.commit();
  std::string recorded;
  if (!o.history.empty()) {
    const fs::path file = fs::path(o.output) / "alignment.json";
    recorded = append_words(
        o.history,
        record_of({.scanner = o.identification.empty() ? fmt::format("virtual scanner chen2008, instrument {}", o.seed)
                                                       : o.identification,
                   .ended = utc_now(),
                   .inputs = {{"alignment.json", sha256_of_file(file)}}},
                  calib::read_record(file).iterations, file.string()));
  }
  if (o.json) {
    fmt::print("{}", to_json(record));
  } else {
    fmt::print("{} after {} turns; record and profiles in {}\n", calib::name_of(iterations.back().step.decision),
               iterations.size() - 1, o.output);
    fmt::print("{}", recorded);
  }
}

}  // namespace

void add_align(CLI::App& app) {
  auto* command = app.add_subcommand(
      "align", "Measure how far the grating's fringes are off the slide direction, and say how to turn the adjuster");
  auto o = std::make_shared<Options>();
  auto* capture = command->add_option(
      "captures", o->captures,
      "Capture folder of a flat board that fills the field; several of one setting of the adjuster are averaged");
  auto* pitch = command
                    ->add_option("--pattern-pitch-mm", o->pattern_pitch_mm,
                                 "Distance of neighbouring patterns along the slide, from the grating's data sheet")
                    ->check(CLI::PositiveNumber);
  capture->needs(pitch);
  command->add_option("--axis", o->axis, "Axis of the code across the slide")
      ->check(CLI::IsMember({"x", "y"}))
      ->capture_default_str();
  command->add_option("--order", o->order, "Patterns along the slide: Gray patterns first, or phase patterns first")
      ->check(CLI::IsMember({"gray-first", "phase-first"}))
      ->capture_default_str();
  command->add_option(
      "--record", o->record,
      "Record of this alignment (JSON): continued where it exists, so that the adjuster's gain is learned");
  command->add_option("--turned", o->turned_mrad, "What the adjuster was turned since the record's last capture, mrad");
  command->add_option("--tolerance", o->tolerance, "Tolerance of the coarsest bit's delta, as a fraction of the period")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--mrad-per-division", o->mrad_per_division, "Of the adjuster's scale, to be told divisions too")
      ->check(CLI::PositiveNumber);
  auto* on_virtual = command->add_flag("--virtual", o->on_virtual, "Run the whole loop on the virtual scanner");
  on_virtual->excludes(capture);
  command->add_option("--seed", o->seed, "Virtual scanner: which instrument, and its noise")->capture_default_str();
  command->add_option("--theta", o->theta_mrad, "Virtual scanner: angle before the first turn, mrad (default 0.80)")
      ->check(CLI::Range(-3.0, 3.0));
  command->add_option("-o,--output", o->output,
                      "Virtual scanner: folder for alignment.json, the profiles and the maps of delta");
  command->add_option("--history", o->history,
                      "History to append the result to, as found and as left (made if it is not there)");
  command->add_option("--identification", o->identification, "The scanner, as its history shall name it");
  command->add_flag("--json", o->json, "Print the result as JSON");
  command->footer(
      "Examples:\n  fringecal align captures/flat_1 --pattern-pitch-mm 12 --record alignment.json\n"
      "  fringecal align captures/flat_2 --pattern-pitch-mm 12 --record alignment.json --turned -0.72\n"
      "  fringecal align --virtual --theta 1.1 -o alignment");
  command->callback([o] {
    if (o->on_virtual) {
      align_virtual(*o);
    } else if (!o->captures.empty()) {
      align_capture(*o);
    } else {
      throw InputError("align needs a capture folder with --pattern-pitch-mm, or --virtual");
    }
  });
}

}  // namespace fringecal::cli

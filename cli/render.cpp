#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "hw/virtual/virtual_scanner.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string scene, output, preset = "chen2008", truth;
  std::uint64_t instrument_seed = 1, seed = 1;
  virt::PresetOverrides overrides;
  virt::InstrumentState state;
  bool json = false;
};

virt::Scene scene_of(const virt::VirtualScanner& scanner, const std::string& name) {
  if (name.ends_with(".toml") || std::filesystem::exists(name)) return virt::read_scene(name);
  if (!scanner.has_standard_scene(name)) {
    throw InputError(
        fmt::format("'{}' is no standard scene; give a scene file, \"alignment\", \"calibration 0\" to "
                    "\"calibration {}\", \"plane N\", \"spheres N\" or \"cylinder N\"",
                    name, scanner.calibration_scenes() - 1));
  }
  return scanner.standard_scene(name);
}

void render(const Options& o) {
  const virt::VirtualScanner scanner(o.preset, o.instrument_seed, o.overrides);
  const virt::Scene scene = scene_of(scanner, o.scene);
  Capture capture = scanner.capture(scene, o.state, o.seed);
  write_capture(o.output, capture);
  if (!o.truth.empty()) {
    write_atomically(o.truth, to_json(scanner.truth(o.state).set("scene", virt::to_value(scene))));
  }
  if (o.json) {
    fmt::print("{}", to_json(Value::object()
                                 .set("folder", o.output)
                                 .set("frames", capture.frames.size())
                                 .set("width_px", capture.info.width_px)
                                 .set("height_px", capture.info.height_px)
                                 .set("bits", capture.info.bits)));
    return;
  }
  fmt::print("{} frames of {} x {} pixels, {} bit: {}\n", capture.frames.size(), capture.info.width_px,
             capture.info.height_px, capture.info.bits, o.output);
}

}  // namespace

void add_render(CLI::App& app) {
  auto* command = app.add_subcommand("render", "Capture a scene with the virtual scanner");
  auto o = std::make_shared<Options>();
  command
      ->add_option("--scene", o->scene,
                   "Name of a standard scene (alignment, \"calibration 3\", \"plane 0\", "
                   "\"spheres 0\", \"cylinder 0\") or a scene file (TOML)")
      ->required();
  command->add_option("-o,--output", o->output, "Folder of the capture to write")->required();
  command->add_option("--preset", o->preset, "The instrument: chen2008 or a preset file (TOML)")->capture_default_str();
  command->add_option("--instrument-seed", o->instrument_seed, "Draws what is fixed for one instrument")
      ->capture_default_str();
  command->add_option("--seed", o->seed, "Draws noise, step errors and flicker of this stack")->capture_default_str();
  command->add_option("--theta", o->overrides.theta_mrad,
                      "Fringe angle against the slide, mrad, instead of the preset's");
  command->add_option("--bits", o->overrides.bits, "Bits per pixel, 8 or 12, instead of the preset's")
      ->check(CLI::IsMember({8, 12}));
  command->add_option("--minutes", o->state.minutes_since_start,
                      "Minutes since start, for the warm-up drift (default: settled)");
  command->add_option("--truth", o->truth, "Also write the truth (for tests; never an input of another command)");
  command->add_flag("--json", o->json, "Print the capture's size as JSON");
  command->footer(
      "Example:\n  fringecal render --scene \"spheres 0\" --theta 0.02 -o spheres_0 --truth spheres_0.truth.json");
  command->callback([o] { render(*o); });
}

}  // namespace fringecal::cli

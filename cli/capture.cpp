// fringecal capture: one stack of frames from the scanner that scanner.toml describes.
#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/scene_selection.h"
#include "core/error.h"
#include "core/value.h"
#include "hw/capture_sequence.h"
#include "hw/open_plc.h"
#include "hw/scanner_file.h"

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <chrono>
#include <cstdio>
#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string scanner, output, source, scene;
  std::optional<double> exposure_ms;
  double hdr_ratio = 4;
  std::uint64_t stack_seed = 1;
  int warm_up_min = hw::kWarmedUp;
  bool hdr = false, json = false;
};

hw::VirtualSelection selection_of(const Options& o) {
  hw::VirtualSelection selection = scene_selection(o.scene);
  selection.stack_seed = o.stack_seed;
  selection.warm_up_min = static_cast<std::uint16_t>(o.warm_up_min);
  return selection;
}

void run(const Options& o) {
  const Interrupt interrupt;
  const hw::ScannerFile file = hw::read_scanner_file(o.scanner);
  const auto plc = hw::open_plc(file.plc_address);
  if (!o.scene.empty()) plc->select(selection_of(o));
  hw::AravisCamera camera(file.camera);
  hw::SystemClock clock;
  hw::CaptureOptions options;
  options.folder = o.output;
  options.plan = file.plan;
  options.source = o.source.empty() ? fmt::format("captured with {}", o.scanner) : o.source;
  options.exposure_ms = o.exposure_ms ? o.exposure_ms : file.exposure_ms;
  if (o.hdr) options.hdr_ratio = o.hdr_ratio;
  options.lamp_level = file.lamp_level;
  if (isatty(STDERR_FILENO)) {
    options.progress = [](int done, int total) {
      fmt::print(stderr, "\r\033[K{} of {} frames{}", done, total, done == total ? "\n" : "");
      std::fflush(stderr);
    };
  }
  hw::CaptureSequence sequence(camera, *plc, clock, options);
  const auto begin = std::chrono::steady_clock::now();
  const hw::CaptureReport report = sequence.run(interrupt.token());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const hw::CameraStatistics s = camera.statistics();
  for (const std::string& event : report.events) fmt::print(stderr, "{}\n", event);
  if (o.json) {
    fmt::print("{}", to_json(Value::object()
                                 .set("capture", o.output)
                                 .set("frames_taken", report.frames_taken)
                                 .set("frames_resumed", report.frames_resumed)
                                 .set("retakes", report.retakes)
                                 .set("camera_reopened", report.camera_reopened)
                                 .set("plc_reopened", report.plc_reopened)
                                 .set("exposures_ms", Value::numbers(report.exposures_ms))
                                 .set("saturated_part", report.saturated_part)
                                 .set("packets_lost", static_cast<std::int64_t>(s.missing_packets))
                                 .set("packets_resent", static_cast<std::int64_t>(s.resent_packets))
                                 .set("seconds", seconds)));
    return;
  }
  std::string exposures;
  for (const double t : report.exposures_ms) exposures += fmt::format("{}{:.3g}", exposures.empty() ? "" : " and ", t);
  fmt::print("{}: {} frames in {:.2f} s at {} ms", o.output, report.frames_taken, seconds, exposures);
  if (report.frames_resumed > 0) fmt::print(", {} were there already", report.frames_resumed);
  fmt::print("; {} taken again, camera reopened {} times, PLC {} times; {:.2g} % of the pixels saturated\n",
             report.retakes, report.camera_reopened, report.plc_reopened, 100 * report.saturated_part);
}

}  // namespace

void add_capture(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("capture", "Takes one stack of frames with the scanner");
  command->add_option("--scanner", o->scanner, "scanner.toml: addresses of camera and PLC, and the grating's patterns")
      ->required();
  command->add_option("-o,--output", o->output, "Capture folder; what an interrupted call took is continued")
      ->required();
  command->add_option("--exposure", o->exposure_ms, "Exposure, ms (default: scanner.toml's, else from test frames)")
      ->check(CLI::PositiveNumber);
  command->add_flag("--hdr", o->hdr, "Take a second, longer exposure and merge the two by modulation");
  command->add_option("--hdr-ratio", o->hdr_ratio, "The longer exposure over the shorter one")
      ->check(CLI::Range(1.5, 64.0))
      ->capture_default_str();
  command->add_option("--source", o->source, "What is captured, in words; stands in capture.json");
  command->add_option("--scene", o->scene, "Virtual scanner only: its scene, such as \"plane 0\" or \"calibration 3\"");
  command->add_option("--stack-seed", o->stack_seed, "Virtual scanner only: seed of the noise")->capture_default_str();
  command->add_option("--warm-up", o->warm_up_min, "Virtual scanner only: minutes since it was switched on")
      ->check(CLI::Range(0, 65535));
  command->add_flag("--json", o->json, "Print the summary as JSON");
  command->footer("Example: fringecal capture --scanner scanner.toml -o board1 --hdr");
  command->callback([o] { run(*o); });
}

}  // namespace fringecal::cli

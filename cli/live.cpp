// fringecal live: the aid for focusing and setting the light, in the terminal.
#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/live_line.h"
#include "core/error.h"
#include "hw/light_on.h"
#include "hw/live_figures.h"
#include "hw/open_plc.h"
#include "hw/scanner_file.h"

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>

namespace fringecal::cli {
namespace {

using Clock = std::chrono::steady_clock;

/// Twenty looks a second are more than a hand on a focus ring follows; other programs get the rest of the processor.
constexpr std::chrono::milliseconds kPeriod{50}, kBreath{1};

double ms_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

struct Options {
  std::string scanner, camera, pixel_format = "Mono8";
  std::optional<double> exposure_ms;
  std::optional<int> pattern;
  int frames = 0;
  std::optional<int> picture_px;
  bool json = false;
};

std::string bars(const hw::LiveFigures& f) {
  constexpr const char* kBars[] = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  const double top = *std::max_element(f.histogram.begin(), f.histogram.end());
  std::string out;
  for (const double share : f.histogram) {
    const double height = top > 0 ? 8.0 * std::sqrt(share / top) : 0.0;  // roots: small classes stay visible
    out += kBars[std::clamp(static_cast<int>(height + 0.5), share > 0 ? 1 : 0, 8)];
  }
  return out;
}

void show(const hw::LiveFigures& f, double rate_hz, double best_sharpness, bool terminal, bool first) {
  const std::string modulation = f.modulation ? fmt::format("{:5.1f} %", 100 * *f.modulation) : "nothing is lit";
  if (!terminal) {
    fmt::print(
        "level {:.1f} %, mean {:.1f} %, saturated {:.3f} %, sharpness {:.5f}, modulation {}, {:.1f} per second\n",
        100 * f.level, 100 * f.mean, 100 * f.saturated, f.sharpness, modulation, rate_hz);
  } else {
    if (!first) fmt::print("\033[4A");
    fmt::print("\033[K  dark [{}] saturation\n", bars(f));
    fmt::print("\033[K  level {:5.1f} %   mean {:5.1f} %   saturated {:.3f} %\n", 100 * f.level, 100 * f.mean,
               100 * f.saturated);
    fmt::print("\033[K  sharpness {:.5f} ({:3.0f} % of the best so far)\n", f.sharpness,
               best_sharpness > 0 ? 100 * f.sharpness / best_sharpness : 0.0);
    fmt::print("\033[K  modulation {}   {:.1f} per second   Ctrl-C ends\n", modulation, rate_hz);
  }
  std::fflush(stdout);
}

void run(const Options& o) {
  const Interrupt interrupt;
  hw::AravisCameraOptions camera_options{.address = o.camera, .pixel_format = o.pixel_format};
  std::optional<double> exposure_ms = o.exposure_ms;
  std::unique_ptr<hw::RegisterPlc> plc;
  double lamp_level = 1.0;
  if (!o.scanner.empty()) {
    const hw::ScannerFile file = hw::read_scanner_file(o.scanner);
    if (o.camera.empty()) camera_options = file.camera;
    if (!exposure_ms) exposure_ms = file.exposure_ms;
    const int patterns = static_cast<int>(file.plan.patterns.size());
    if (o.pattern && *o.pattern >= patterns) {
      throw InputError(fmt::format("--pattern {}: {} has the patterns 0 to {}", *o.pattern, o.scanner, patterns - 1));
    }
    lamp_level = file.lamp_level;
    if (o.pattern) plc = hw::open_plc(file.plc_address);
  } else if (o.pattern) {
    throw InputError("live: --pattern moves the grating; name the scanner.toml with --scanner");
  }
  if (camera_options.address.empty()) throw InputError("live: name a scanner.toml with --scanner, or a --camera");
  hw::AravisCamera camera(camera_options);
  if (exposure_ms) camera.set_exposure_ms(*exposure_ms);
  std::optional<hw::LightOn> light;
  if (plc) light.emplace(*plc, static_cast<std::uint16_t>(*o.pattern), lamp_level);

  const bool terminal = isatty(STDOUT_FILENO) && !o.json;
  const int saturation = (1 << camera.identity().bits) - 1;
  const auto limit = std::chrono::milliseconds(static_cast<int>(1000 + camera.exposure_ms()));
  double best = 0;
  auto last = Clock::now();
  int lost = 0;
  for (int shown = 0; !interrupt.token().stop_requested() && (o.frames == 0 || shown < o.frames);) {
    const auto asked = Clock::now();
    if (light) light->feed();
    hw::CameraFrame frame;
    try {
      frame = camera.take_frame(limit);
    } catch (const hw::FrameLost&) {  // the next one will do; ten in a row will not
      if (++lost < 10) continue;
      throw;
    }
    lost = 0;
    const auto came = Clock::now();
    const hw::LiveFigures f = hw::live_figures(frame.image, saturation);
    best = std::max(best, f.sharpness);
    const auto now = Clock::now();
    const double rate_hz = 1.0 / std::chrono::duration<double>(now - last).count();
    last = now;
    if (o.json) {
      Value line = to_value(f);
      line.set("rate_hz", rate_hz).set("frame_ms", ms_between(asked, came)).set("figures_ms", ms_between(came, now));
      if (o.picture_px) add_picture(line, frame.image, saturation, *o.picture_px);
      fmt::print("{}", to_json(line));
      std::fflush(stdout);
    } else {
      show(f, rate_hz, best, terminal, shown == 0);
    }
    ++shown;
    interrupt.wait(
        std::max(kBreath, std::chrono::duration_cast<std::chrono::milliseconds>(asked + kPeriod - Clock::now())));
  }
}

}  // namespace

void add_live(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("live", "Focus and exposure aid: histogram, sharpness and modulation");
  command->add_option("--scanner", o->scanner, "scanner.toml with the addresses");
  command->add_option("--camera", o->camera, "Camera's IPv4 address (in place of scanner.toml's)");
  command->add_option("--pixel-format", o->pixel_format, "With --camera: Mono8, Mono10, Mono12, Mono14 or Mono16")
      ->capture_default_str();
  command->add_option("--exposure", o->exposure_ms, "Exposure, ms (default: scanner.toml's, else the camera's)")
      ->check(CLI::PositiveNumber);
  command->add_option("--pattern", o->pattern, "Lamp on and this pattern in the light path, counted from 0")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--frames", o->frames, "Stop after so many frames; 0: at Ctrl-C")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  auto* json = command->add_flag("--json", o->json, "Print the figures of every frame as JSON");
  command
      ->add_option(
          "--picture", o->picture_px,
          "With --json: a picture with no side longer than so many pixels, 8-bit grey as base64, 255: saturated")
      ->check(CLI::Range(16, 4096))
      ->needs(json);
  command->footer("Example: fringecal live --scanner scanner.toml --pattern 10");
  command->callback([o] { run(*o); });
}

}  // namespace fringecal::cli

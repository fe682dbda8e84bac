// fringecal virtual: the virtual scanner as a process that speaks what a real one speaks: GigE Vision and Modbus, and
// on request MEWTOCOL-COM, on loopback.
#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/scene_selection.h"
#include "core/error.h"
#include "core/file.h"
#include "hw/plc_map.h"
#include "hw/scanner_file.h"
#include "hw/virtual/direct_scanner.h"
#include "hw/virtual/fake_camera.h"
#include "hw/virtual/mewtocol_server.h"
#include "hw/virtual/modbus_server.h"
#include "hw/virtual/scanner_view.h"

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>

namespace fringecal::cli {
namespace {

constexpr const char* kFreeAddress = "free";

struct Options {
  std::string preset = "chen2008", address = "127.0.0.1", frame_log, scanner_file, truth_file, scene = "alignment";
  std::uint64_t seed = 1, stack_seed = 1;
  std::optional<double> theta_mrad;
  int bits = 8, plc_port = 0, motion_ms = 0, watchdog_ms = 10000;
  double packet_loss = 0;
  std::optional<int> parent;
  bool rtu = false, mewtocol = false;
};

std::string one_line(const Value& value) {
  std::string out;
  bool indent = false;
  for (const char c : to_json(value)) {
    if (c == '\n') indent = true;
    if (indent && (c == '\n' || c == ' ')) continue;
    if (indent && !out.empty() && out.back() == ',') out += ' ';
    indent = false;
    out += c;
  }
  return out;
}

void select(virt::PlcCore& core, const hw::VirtualSelection& selection) {
  std::array<std::uint16_t, 7> words = {selection.scene, selection.pose};
  for (std::size_t i = 0; i < 4; ++i) words[2 + i] = static_cast<std::uint16_t>(selection.stack_seed >> (16 * i));
  words[6] = selection.warm_up_min;
  require(core.write(hw::dt::kScene, words), "the virtual PLC has the block of the virtual scanner");
}

/// At the address that was asked for, or at the first of 127.0.1.1 ... 127.0.1.254 where nobody serves a camera.
std::unique_ptr<virt::FakeCamera> serve_camera(virt::FakeCameraOptions& options, const std::string& address,
                                               const virt::FakeCamera::Render& render) {
  constexpr int kLastHost = 254;
  for (int host = 1;; ++host) {
    options.address = address == kFreeAddress ? fmt::format("127.0.1.{}", host) : address;
    try {
      return std::make_unique<virt::FakeCamera>(options, render);
    } catch (const EnvironmentError&) {
      if (address != kFreeAddress || host == kLastHost) throw;
    }
  }
}

void serve(const Options& o) {
  Interrupt interrupt;
  if (!end_with_parent(o.parent)) return;
  const virt::VirtualScanner scanner(o.preset, o.seed, {.theta_mrad = o.theta_mrad, .bits = o.bits});
  virt::PlcCoreOptions plc = virt::plc_options_of(scanner);
  plc.per_pattern = std::chrono::milliseconds(o.motion_ms);
  plc.homing = std::chrono::milliseconds(o.motion_ms);
  // The way home is the longest one: the PLC supervises it with half as much again.
  plc.motion_limit = std::max(plc.motion_limit, 3 * plc.patterns * plc.per_pattern / 2);
  plc.watchdog = std::chrono::milliseconds(o.watchdog_ms);
  virt::PlcCore core(plc);
  hw::VirtualSelection selection = scene_selection(o.scene);
  selection.stack_seed = o.stack_seed;
  select(core, selection);
  virt::ScannerView view(scanner, core);
  virt::FakeCameraOptions device = virt::camera_options_of(scanner, o.seed);
  device.packet_loss = o.packet_loss;
  device.frame_log = o.frame_log;
  const auto camera = serve_camera(device, o.address, [&](double exposure_ms) { return view.picture(exposure_ms); });
  const auto tcp = virt::serve_modbus_tcp(core, device.address, o.plc_port);
  const auto rtu = o.rtu ? virt::serve_modbus_rtu(core) : nullptr;
  const auto mewtocol = o.mewtocol ? virt::serve_mewtocol(core) : nullptr;

  const std::string plc_address = fmt::format("modbus-tcp://{}:{}", device.address, tcp->port());
  const std::string pixel_format = device.bits > 8 ? "Mono12" : "Mono8";
  if (!o.scanner_file.empty()) {
    hw::ScannerFile file;
    file.camera.address = device.address;
    file.camera.pixel_format = pixel_format;
    file.plc_address = plc_address;
    file.plan = scanner.plan();
    write_atomically(o.scanner_file, to_toml(file));
  }
  Value ready = Value::object()
                    .set("camera", device.address)
                    .set("plc", plc_address)
                    .set("preset", o.preset)
                    .set("seed", std::to_string(o.seed))
                    .set("pixel_format", pixel_format)
                    .set("pid", static_cast<int>(getpid()));
  if (rtu) ready.set("plc_rtu", fmt::format("modbus-rtu:{}?baud=115200&slave=1", rtu->device()));
  if (mewtocol) ready.set("plc_mewtocol", fmt::format("mewtocol:{}?baud=9600&station=1", mewtocol->device()));
  fmt::print("{}\n", one_line(ready));
  std::fflush(stdout);

  while (!interrupt.wait(std::chrono::milliseconds(50)) && parent_lives()) {
  }
  if (!o.truth_file.empty()) write_atomically(o.truth_file, to_json(scanner.truth(view.state())));
}

}  // namespace

void add_virtual(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "virtual", "Serves the virtual scanner as a GigE Vision camera and a PLC, until Ctrl-C or its parent's end");
  command->add_option("--preset", o->preset, "Virtual instrument: chen2008, or a TOML file")->capture_default_str();
  command->add_option("--seed", o->seed, "Seed of the instrument: its errors")->capture_default_str();
  command->add_option("--theta", o->theta_mrad, "Fringe angle to start from, mrad (default: the preset's)")
      ->check(CLI::Range(-1.5, 1.5));
  command->add_option("--bits", o->bits, "Bits per pixel: 8 (Mono8) or 12 (Mono12)")->capture_default_str();
  command
      ->add_option("--address", o->address,
                   "Address of camera and PLC; others of 127.x.x.x for instances side by side; \"free\": one that no "
                   "other camera uses, which is printed")
      ->capture_default_str();
  command->add_option("--plc-port", o->plc_port, "Modbus TCP port, 0: a free one, which is printed")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command->add_flag("--rtu", o->rtu, "Serve the PLC as a Modbus RTU slave on a pseudo-terminal, too");
  command->add_flag("--mewtocol", o->mewtocol, "Serve the PLC as a MEWTOCOL-COM station on a pseudo-terminal, too");
  command
      ->add_option(
          "--motion", o->motion_ms,
          "Time of the stage from one pattern to the next, ms; the PLC ends a way of more than 5 s with a fault, so at "
          "most some 400 for 11 patterns")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  command->add_option("--watchdog", o->watchdog_ms, "The PLC's watchdog, ms")
      ->check(CLI::Range(100, 60000))
      ->capture_default_str();
  command->add_option("--scene", o->scene, "What stands before the scanner at first, such as \"plane 0\"")
      ->capture_default_str();
  command->add_option("--stack-seed", o->stack_seed, "Seed of the noise at first")->capture_default_str();
  command
      ->add_option("--packet-loss", o->packet_loss,
                   "Share of the camera's packets that is dropped, and never resent: at 0.002 a third of the frames is "
                   "incomplete")
      ->check(CLI::Range(0.0, 0.99))
      ->capture_default_str();
  command->add_option("--scanner-file", o->scanner_file, "Write a scanner.toml with the addresses and the plan here");
  command->add_option("--frame-log", o->frame_log, "Append id and SHA-256 of every frame sent to this file");
  command->add_option("--parent", o->parent, "Number of the process that it serves: ends with it, however that ends");
  command->add_option("--truth", o->truth_file, "Write the true instrument here at the end (for tests)");
  command->footer(
      "One line of JSON on standard output says that it is ready, and its addresses. Example:\n"
      "  fringecal virtual --seed 7 --scanner-file scanner.toml &\n"
      "  fringecal capture --scanner scanner.toml -o stack1");
  command->callback([o] { serve(*o); });
}

}  // namespace fringecal::cli

// fringecal devices: what answers at the configured addresses, and how well the way there is.
#include "cli/commands.h"
#include "core/error.h"
#include "core/statistics.h"
#include "core/value.h"
#include "hw/open_plc.h"
#include "hw/scanner_file.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <chrono>
#include <memory>
#include <vector>

namespace fringecal::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct Options {
  std::string scanner, camera, pixel_format = "Mono8", plc;
  int frames = 100;
  bool json = false;
};

double ms_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

Value look_at_camera(const hw::AravisCameraOptions& options, int frames, bool json) {
  hw::AravisCamera camera(options);
  const hw::CameraIdentity id = camera.identity();
  const hw::CameraLink link = camera.link();
  const auto limit = std::chrono::milliseconds(static_cast<int>(1000 + camera.exposure_ms()));
  std::vector<double> times_ms;
  for (int i = 0; i < frames; ++i) {
    const auto begin = Clock::now();
    try {
      camera.take_frame(limit);
      times_ms.push_back(ms_since(begin));
    } catch (const hw::FrameLost&) {  // that is what is counted here
    }
  }
  const hw::CameraStatistics s = camera.statistics();
  const double lost =
      static_cast<double>(s.missing_packets) / std::max<double>(1, static_cast<double>(s.packets + s.missing_packets));
  Value out = Value::object()
                  .set("address", options.address)
                  .set("vendor", id.vendor)
                  .set("model", id.model)
                  .set("serial", id.serial)
                  .set("firmware", id.firmware)
                  .set("width_px", id.width_px)
                  .set("height_px", id.height_px)
                  .set("bits", id.bits)
                  .set("round_trip_ms", link.round_trip_ms)
                  .set("packet_size_bytes", link.packet_size_bytes)
                  .set("frames_asked", frames)
                  .set("frames_whole", static_cast<std::int64_t>(s.frames))
                  .set("frames_incomplete", static_cast<std::int64_t>(s.incomplete))
                  .set("frames_missing", static_cast<std::int64_t>(s.timeouts))
                  .set("frames_late", static_cast<std::int64_t>(s.late_or_double))
                  .set("packets", static_cast<std::int64_t>(s.packets))
                  .set("packets_lost", static_cast<std::int64_t>(s.missing_packets))
                  .set("packets_resent", static_cast<std::int64_t>(s.resent_packets));
  if (!times_ms.empty()) out.set("frame_ms", median(times_ms));
  if (!json) {
    fmt::print("camera {}: {} {}, serial {}, firmware {}\n  {} x {} pixels, {} bits\n", options.address, id.vendor,
               id.model, id.serial, id.firmware, id.width_px, id.height_px, id.bits);
    fmt::print("  round trip {:.2f} ms, packets of {} bytes\n", link.round_trip_ms, link.packet_size_bytes);
    fmt::print("  {} of {} frames whole, {} incomplete, {} missing, {} late", s.frames, frames, s.incomplete,
               s.timeouts, s.late_or_double);
    if (!times_ms.empty()) fmt::print("; {:.1f} ms each", median(times_ms));
    fmt::print("\n  {} packets, {:.3f} % lost for good, {} resent\n", s.packets, 100.0 * lost, s.resent_packets);
  }
  return out;
}

Value look_at_plc(const std::string& address, bool json) {
  const auto plc = hw::open_plc(address);
  const std::string identity = plc->identity();
  std::vector<double> times_ms;
  hw::PlcStatus status;
  for (int i = 0; i < 20; ++i) {
    const auto begin = Clock::now();
    status = plc->status();
    times_ms.push_back(ms_since(begin));
  }
  constexpr const char* kStates[] = {"idle", "moving", "in position", "homing", "fault"};
  const auto state = static_cast<std::size_t>(status.state);
  const char* words = state < std::size(kStates) ? kStates[state] : "unknown";
  if (!json) {
    fmt::print("plc {}: {}\n", address, identity);
    fmt::print("  register map version {}, round trip {:.2f} ms, {} late answers\n", status.map_version,
               median(times_ms), plc->late_answers());
    fmt::print("  {}, fault code {}, stage at {:.3f} mm, lamp {}, door {}\n  grating {:.2f} degC, room {:.2f} degC\n",
               words, status.fault_code, 1e-3 * status.position_um, status.lamp_on ? "on" : "off",
               status.door_closed ? "closed" : "open", status.temperature_degC, status.temperature_room_degC);
  }
  return Value::object()
      .set("address", address)
      .set("identity", identity)
      .set("map_version", static_cast<int>(status.map_version))
      .set("round_trip_ms", median(times_ms))
      .set("late_answers", plc->late_answers())
      .set("state", words)
      .set("fault_code", static_cast<int>(status.fault_code))
      .set("position_um", static_cast<std::int64_t>(status.position_um))
      .set("lamp_on", status.lamp_on)
      .set("door_closed", status.door_closed)
      .set("temperature_degC", status.temperature_degC)
      .set("temperature_room_degC", status.temperature_room_degC);
}

void run(const Options& o) {
  hw::AravisCameraOptions camera{.address = o.camera, .pixel_format = o.pixel_format};
  std::string plc = o.plc;
  if (!o.scanner.empty()) {
    const hw::ScannerFile file = hw::read_scanner_file(o.scanner);
    if (o.camera.empty()) camera = file.camera;
    if (o.plc.empty()) plc = file.plc_address;
  }
  if (camera.address.empty() && plc.empty()) {
    throw InputError("devices: name a scanner.toml with --scanner, or addresses with --camera and --plc");
  }
  Value out = Value::object();
  std::string trouble;
  const auto look = [&](const char* what, const auto& work) {
    try {
      out.set(what, work());
    } catch (const hw::CameraLost& e) {
      trouble += (trouble.empty() ? "" : "; ") + std::string(e.what());
    } catch (const hw::PlcLost& e) {
      trouble += (trouble.empty() ? "" : "; ") + std::string(e.what());
    } catch (const hw::PlcFault& e) {
      trouble += (trouble.empty() ? "" : "; ") + std::string(e.what());
    }
  };
  if (!camera.address.empty()) look("camera", [&] { return look_at_camera(camera, o.frames, o.json); });
  if (!plc.empty()) look("plc", [&] { return look_at_plc(plc, o.json); });
  if (o.json) fmt::print("{}", to_json(out));
  if (!trouble.empty()) throw EnvironmentError(trouble);
}

}  // namespace

void add_devices(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("devices", "What answers at the scanner's addresses: versions, round trip, packet loss");
  command->add_option("--scanner", o->scanner, "scanner.toml with the addresses");
  command->add_option("--camera", o->camera, "Camera's IPv4 address (in place of scanner.toml's)");
  command->add_option("--pixel-format", o->pixel_format, "With --camera: Mono8, Mono10, Mono12, Mono14 or Mono16")
      ->capture_default_str();
  command->add_option("--plc", o->plc, "PLC's address (in place of scanner.toml's), e.g. modbus-tcp://192.168.0.20");
  command->add_option("--frames", o->frames, "Frames to take for the loss of packets")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command->add_flag("--json", o->json, "Print the findings as JSON");
  command->footer("Example: fringecal devices --camera 192.168.0.10 --plc modbus-tcp://192.168.0.20:502");
  command->callback([o] { run(*o); });
}

}  // namespace fringecal::cli

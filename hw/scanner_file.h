// scanner.toml: how this scanner is wired, for `fringecal capture`, `devices` and `live`. Strict: an unknown key is an
// error.
//
//   patterns = ["gray 0..6", "phase 0..3"]       # in the order on the grating (words as in an import plan)
//   [camera]
//   address = "192.168.0.10"
//   pixel_format = "Mono8"                       # optional: Mono8, Mono10, Mono12, Mono14, Mono16
//   packet_size_bytes = 8192                     # optional: else the largest that passes the network
//   exposure_ms = 20.0                           # optional: else found from test frames
//   [plc]
//   address = "modbus-tcp://192.168.0.20:502"    # also modbus-rtu:..., mewtocol:... (hw/device_address.h)
//   lamp_level = 1.0                             # optional, (0, 1]
//   [codes.x]                                    # the code along the projector's x, and/or [codes.y]
//   gray_bits = 7
//   phase_steps = 4
//   stripes_per_period = 2
//   period = 0.24
//   unit = "mm"
#pragma once

#include "core/pattern_plan.h"
#include "hw/aravis_camera.h"

#include <filesystem>
#include <optional>
#include <string>

namespace fringecal::hw {

struct ScannerFile {
  AravisCameraOptions camera;
  std::optional<double> exposure_ms;
  std::string plc_address;
  double lamp_level = 1.0;
  PatternPlan plan;
};

/// Throws InputError with the file, the key and what to write.
ScannerFile read_scanner_file(const std::filesystem::path& file);
/// The text of a file that reads back to the same.
std::string to_toml(const ScannerFile& scanner);

}  // namespace fringecal::hw

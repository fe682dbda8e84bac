// DirectScanner: the virtual scanner's camera and PLC without a wire between them and the client, for tests and for
// `commission --in-process`. Registers, stage, lamp, pictures and the names of the devices are those that
// `fringecal virtual` serves; what is left out is GigE Vision, Modbus and the second process.
#pragma once

#include "hw/camera.h"
#include "hw/register_plc.h"
#include "hw/virtual/fake_camera.h"
#include "hw/virtual/plc_core.h"
#include "hw/virtual/scanner_view.h"
#include "hw/virtual/virtual_scanner.h"

#include <cstdint>
#include <memory>

namespace fringecal::virt {

/// The PLC of this instrument: its patterns, their pitch, an instant stage.
PlcCoreOptions plc_options_of(const VirtualScanner& scanner);
/// The camera of this instrument: sensor, exposure of the data sheet, serial number from the instrument's seed.
FakeCameraOptions camera_options_of(const VirtualScanner& scanner, std::uint64_t instrument_seed);

class DirectScanner {
 public:
  /// `scanner` must outlive it.
  DirectScanner(const VirtualScanner& scanner, std::uint64_t instrument_seed);
  ~DirectScanner();

  hw::Camera& camera();
  hw::RegisterPlc& plc();

 private:
  class DirectCamera;
  class DirectPlc;

  PlcCore core_;
  ScannerView view_;
  std::unique_ptr<DirectCamera> camera_;
  std::unique_ptr<DirectPlc> plc_;
};

}  // namespace fringecal::virt

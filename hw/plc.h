// Plc: the controller that slides the grating and switches the lamp, as the capture sequence sees it. Behind it is one
// register map (hw/plc_map.md) over Modbus (hw/modbus_plc.h) or MEWTOCOL-COM (hw/mewtocol_plc.h).
//
// A command carries a sequence number which the PLC echoes when it is done: "in position" without the echo means the
// position of an earlier command.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>

namespace fringecal::hw {

enum class PlcState : std::uint16_t { idle = 0, moving = 1, in_position = 2, homing = 3, fault = 4 };

enum class PlcCommand : std::uint16_t { none = 0, home = 1, move_to_pattern = 2, park = 3, stop = 4, clear_fault = 5 };

struct PlcStatus {
  PlcState state = PlcState::idle;
  std::uint16_t fault_code = 0;     // words in hw/plc_map.md
  std::uint16_t sequence_done = 0;  // echo of the last finished command
  std::int32_t position_um = 0;
  bool lamp_on = false;
  bool door_closed = true;
  double temperature_degC = 0, temperature_room_degC = 0;
  std::uint16_t map_version = 0;
};

/// The link is lost or does not answer in time: it can be worth opening it again.
struct PlcLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// The PLC answers and refuses or reports a fault; motion and lamp must stop.
struct PlcFault : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Plc {
 public:
  virtual ~Plc() = default;
  virtual std::string identity() = 0;
  virtual PlcStatus status() = 0;
  /// Writes target, then command with its sequence number, in one transaction.
  virtual void command(PlcCommand command, std::uint16_t sequence, std::uint16_t target_pattern = 0) = 0;
  virtual void set_lamp(bool on, double level = 1.0) = 0;
  /// Feeds the watchdog; a PLC that is not fed stops motion and lamp by itself.
  virtual void feed_watchdog() = 0;
  virtual void reopen() = 0;
};

/// An adjuster with a motor (the virtual scanner has one); absent on a scanner with a screwdriver.
class MotorisedAdjuster {
 public:
  virtual ~MotorisedAdjuster() = default;
  virtual void turn_mrad(double turn) = 0;
};

}  // namespace fringecal::hw

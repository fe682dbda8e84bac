// The register map of hw/plc_map.md as constants. A test reads the tables of that document and compares every row.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>

namespace fringecal::hw {

/// Data registers (DTn); Modbus protocol address n.
namespace dt {
inline constexpr std::uint16_t kMapVersion = 0, kState = 1, kFaultCode = 2, kSequenceDone = 3, kPosition = 4,
                               kPattern = 6, kLampOn = 7, kDoorClosed = 8, kTemperature = 9, kTemperatureRoom = 10,
                               kPatterns = 11, kWatchdogLimit = 12, kIsVirtual = 13;
inline constexpr std::uint16_t kTargetPattern = 20, kCommand = 21, kSequence = 22, kLamp = 23, kLampLevel = 24,
                               kWatchdog = 25;
inline constexpr std::uint16_t kAdjusterTurn = 100, kAdjusterSequence = 102, kAdjusterDone = 103, kAdjusterTotal = 104,
                               kScene = 110, kPose = 111, kStackSeed = 112, kWarmUp = 116;
inline constexpr std::uint16_t kStatusWords = 14;  // DT0 .. DT13, one transaction
inline constexpr std::uint16_t kEnd = 120;         // first register that does not exist
}  // namespace dt

inline constexpr std::uint16_t kPlcMapVersion = 1;
inline constexpr std::uint16_t kNoPattern = 65535;
inline constexpr std::uint16_t kWarmedUp = 65535;

struct PlcRegister {
  std::uint16_t address;
  std::string_view name, type, unit, access;

  int words() const { return type == "int32" ? 2 : type == "uint64" ? 4 : 1; }
  bool writable() const { return access == "RW"; }
};

inline constexpr std::array kPlcRegisters = {
    PlcRegister{dt::kMapVersion, "map_version", "uint16", "1", "R"},
    PlcRegister{dt::kState, "state", "uint16", "1", "R"},
    PlcRegister{dt::kFaultCode, "fault_code", "uint16", "1", "R"},
    PlcRegister{dt::kSequenceDone, "sequence_done", "uint16", "1", "R"},
    PlcRegister{dt::kPosition, "position", "int32", "um", "R"},
    PlcRegister{dt::kPattern, "pattern", "uint16", "1", "R"},
    PlcRegister{dt::kLampOn, "lamp_on", "uint16", "1", "R"},
    PlcRegister{dt::kDoorClosed, "door_closed", "uint16", "1", "R"},
    PlcRegister{dt::kTemperature, "temperature", "int16", "0.01 degC", "R"},
    PlcRegister{dt::kTemperatureRoom, "temperature_room", "int16", "0.01 degC", "R"},
    PlcRegister{dt::kPatterns, "patterns", "uint16", "1", "R"},
    PlcRegister{dt::kWatchdogLimit, "watchdog_limit", "uint16", "ms", "R"},
    PlcRegister{dt::kIsVirtual, "is_virtual", "uint16", "1", "R"},
    PlcRegister{dt::kTargetPattern, "target_pattern", "uint16", "1", "RW"},
    PlcRegister{dt::kCommand, "command", "uint16", "1", "RW"},
    PlcRegister{dt::kSequence, "sequence", "uint16", "1", "RW"},
    PlcRegister{dt::kLamp, "lamp", "uint16", "1", "RW"},
    PlcRegister{dt::kLampLevel, "lamp_level", "uint16", "0.1 %", "RW"},
    PlcRegister{dt::kWatchdog, "watchdog", "uint16", "1", "RW"},
    PlcRegister{dt::kAdjusterTurn, "adjuster_turn", "int32", "nrad", "RW"},
    PlcRegister{dt::kAdjusterSequence, "adjuster_sequence", "uint16", "1", "RW"},
    PlcRegister{dt::kAdjusterDone, "adjuster_done", "uint16", "1", "R"},
    PlcRegister{dt::kAdjusterTotal, "adjuster_total", "int32", "nrad", "R"},
    PlcRegister{dt::kScene, "scene", "uint16", "1", "RW"},
    PlcRegister{dt::kPose, "pose", "uint16", "1", "RW"},
    PlcRegister{dt::kStackSeed, "stack_seed", "uint64", "1", "RW"},
    PlcRegister{dt::kWarmUp, "warm_up", "uint16", "min", "RW"},
};

enum class PlcFaultCode : std::uint16_t {
  none = 0,
  jam = 1,
  position_not_reached = 2,
  door_open = 3,
  watchdog = 4,
  not_homed = 5,
  no_such_pattern = 6,
  no_such_command = 7,
};

inline constexpr std::array<std::string_view, 8> kFaultWords = {
    "no fault",
    "the drive is on and the stage does not move (jam)",
    "the stage did not reach its position in time",
    "the door was opened",
    "the watchdog was not fed in time",
    "the stage has not been homed since power-on",
    "there is no such pattern on the grating",
    "there is no such command",
};

inline constexpr std::string_view fault_words(std::uint16_t code) {
  return code < kFaultWords.size() ? kFaultWords[code] : "a fault that the register map does not list";
}

/// Words of a 32-bit value, low word first.
inline constexpr std::uint16_t low_word(std::int32_t value) {
  return static_cast<std::uint16_t>(static_cast<std::uint32_t>(value));
}
inline constexpr std::uint16_t high_word(std::int32_t value) {
  return static_cast<std::uint16_t>(static_cast<std::uint32_t>(value) >> 16);
}
inline constexpr std::int32_t int32_from(std::uint16_t low, std::uint16_t high) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(high) << 16 | low);
}

/// Scenes of the virtual scanner by number (DT110).
inline constexpr std::array<std::string_view, 5> kSceneNames = {"alignment", "calibration", "plane", "spheres",
                                                                "cylinder"};

/// A turn of the adjuster as adjuster_turn (DT100) takes it: whole nanoradians.
inline double register_turn_mrad(double turn_mrad) { return 1e-6 * std::round(1e6 * turn_mrad); }

}  // namespace fringecal::hw

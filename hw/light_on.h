// LightOn: lamp lit and one pattern in the light path, for as long as the object lives (setting up, looking).
// Afterwards, whatever happened, the lamp is off and the stage parked; where the PLC cannot be reached any more its
// watchdog does it.
//
// Throws PlcLost and PlcFault; PlcFault also where the pattern is not in position within the limit.
#pragma once

#include "hw/plc.h"

#include <chrono>
#include <cstdint>

namespace fringecal::hw {

class LightOn {
 public:
  LightOn(Plc& plc, std::uint16_t pattern, double lamp_level,
          std::chrono::milliseconds limit = std::chrono::seconds(15));
  ~LightOn();
  LightOn(const LightOn&) = delete;
  LightOn& operator=(const LightOn&) = delete;
  /// To be called several times a second.
  void feed() { plc_.feed_watchdog(); }

 private:
  void execute(PlcCommand command, std::uint16_t target, std::chrono::milliseconds limit);
  void make_safe() noexcept;

  Plc& plc_;
  std::uint16_t sequence_ = 0;
};

}  // namespace fringecal::hw

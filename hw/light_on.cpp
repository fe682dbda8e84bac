#include "hw/light_on.h"

#include <fmt/format.h>

#include <thread>

namespace fringecal::hw {

LightOn::LightOn(Plc& plc, std::uint16_t pattern, double lamp_level, std::chrono::milliseconds limit) : plc_(plc) {
  sequence_ = plc_.status().sequence_done;
  try {
    plc_.feed_watchdog();
    execute(PlcCommand::home, 0, limit);
    plc_.set_lamp(true, lamp_level);
    execute(PlcCommand::move_to_pattern, pattern, limit);
  } catch (...) {
    make_safe();
    throw;
  }
}

LightOn::~LightOn() { make_safe(); }

void LightOn::execute(PlcCommand command, std::uint16_t target, std::chrono::milliseconds limit) {
  sequence_ = sequence_ == 65535 ? 1 : static_cast<std::uint16_t>(sequence_ + 1);  // 0 is no sequence
  plc_.command(command, sequence_, target);
  const auto deadline = std::chrono::steady_clock::now() + limit;
  for (;;) {
    const PlcStatus status = plc_.status();
    if (status.state == PlcState::fault) {
      throw PlcFault(fmt::format("{}: fault {}; see hw/plc_map.md, remove its cause and try again", plc_.identity(),
                                 status.fault_code));
    }
    if (status.sequence_done == sequence_) return;
    if (std::chrono::steady_clock::now() > deadline) {
      throw PlcFault(
          fmt::format("{}: the stage did not finish its motion within {} ms", plc_.identity(), limit.count()));
    }
    plc_.feed_watchdog();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

void LightOn::make_safe() noexcept {
  try {
    plc_.set_lamp(false);
    sequence_ = sequence_ == 65535 ? 1 : static_cast<std::uint16_t>(sequence_ + 1);
    plc_.command(PlcCommand::park, sequence_);
  } catch (const std::exception&) {
    // Out of reach, or in a fault, in which it must not move: then the PLC itself has stopped motion and lamp.
  }
}

}  // namespace fringecal::hw

#include "hw/register_plc.h"

#include "core/error.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>
#include <thread>

namespace fringecal::hw {
namespace {

std::string words_of(PlcCommand command, std::uint16_t target) {
  switch (command) {
    case PlcCommand::none:
      return "no command";
    case PlcCommand::home:
      return "homing";
    case PlcCommand::move_to_pattern:
      return fmt::format("moving to pattern {}", target);
    case PlcCommand::park:
      return "parking";
    case PlcCommand::stop:
      return "stopping";
    case PlcCommand::clear_fault:
      return "clearing the fault";
  }
  return fmt::format("command {}", static_cast<int>(command));
}

}  // namespace

template <class Work>
void RegisterPlc::transact(const std::string& operation, const Work& work) {
  for (int attempt = 1;; ++attempt) {
    try {
      work();
      return;
    } catch (const PlcLate& late) {
      ++late_answers_;
      if (attempt >= options_.attempts) {
        throw PlcLost(fmt::format("{}: {} failed: {} ({} attempts)", name_, operation, late.what(), attempt));
      }
    } catch (const PlcLost& lost) {
      throw PlcLost(fmt::format("{}: {} failed: {}", name_, operation, lost.what()));
    } catch (const PlcFault& fault) {
      throw PlcFault(fmt::format("{}: {} was refused: {}", name_, operation, fault.what()));
    }
  }
}

void RegisterPlc::read(std::uint16_t first, std::span<std::uint16_t> words, const std::string& operation) {
  transact(operation, [&] { read_words(first, words); });
}

void RegisterPlc::write(std::uint16_t first, std::span<const std::uint16_t> words, const std::string& operation) {
  transact(operation, [&] { write_words(first, words); });
}

PlcStatus RegisterPlc::status() {
  std::array<std::uint16_t, dt::kStatusWords> w{};
  read(dt::kMapVersion, w, "reading the status (DT0 to DT13)");
  if (w[dt::kMapVersion] != kPlcMapVersion) {
    throw PlcFault(fmt::format(
        "{}: DT0 says register map version {}, this program speaks version {} (hw/plc_map.md); load the matching PLC "
        "program",
        name_, w[dt::kMapVersion], kPlcMapVersion));
  }
  if (w[dt::kState] > static_cast<std::uint16_t>(PlcState::fault)) {
    throw PlcFault(
        fmt::format("{}: DT1 says state {}, the register map knows 0 to 4; check the PLC program", name_, w[1]));
  }
  return PlcStatus{.state = static_cast<PlcState>(w[dt::kState]),
                   .fault_code = w[dt::kFaultCode],
                   .sequence_done = w[dt::kSequenceDone],
                   .position_um = int32_from(w[dt::kPosition], w[dt::kPosition + 1]),
                   .lamp_on = w[dt::kLampOn] != 0,
                   .door_closed = w[dt::kDoorClosed] != 0,
                   .temperature_degC = 0.01 * static_cast<std::int16_t>(w[dt::kTemperature]),
                   .temperature_room_degC = 0.01 * static_cast<std::int16_t>(w[dt::kTemperatureRoom]),
                   .map_version = w[dt::kMapVersion]};
}

std::string RegisterPlc::identity() {
  std::array<std::uint16_t, dt::kStatusWords> w{};
  read(dt::kMapVersion, w, "reading the identity (DT0 to DT13)");
  // Where a virtual PLC listens says nothing about it: it takes another port in every run.
  return fmt::format("{} (register map {}, {} patterns)", w[dt::kIsVirtual] != 0 ? "virtual PLC" : name_,
                     w[dt::kMapVersion], w[dt::kPatterns]);
}

void RegisterPlc::command(PlcCommand command, std::uint16_t sequence, std::uint16_t target_pattern) {
  require(sequence != 0, "a PLC command has a sequence number other than 0");
  const std::array<std::uint16_t, 3> words = {target_pattern, static_cast<std::uint16_t>(command), sequence};
  write(dt::kTargetPattern, words, words_of(command, target_pattern));
}

void RegisterPlc::set_lamp(bool on, double level) {
  require(level >= 0 && level <= 1, "a lamp's level lies between 0 and 1");
  const std::array<std::uint16_t, 2> words = {static_cast<std::uint16_t>(on),
                                              static_cast<std::uint16_t>(std::lround(1000 * level))};
  write(dt::kLamp, words, on ? "switching the lamp on" : "switching the lamp off");
}

void RegisterPlc::feed_watchdog() {
  const std::string operation = "feeding the watchdog";
  std::array<std::uint16_t, 1> word{};
  if (!watchdog_) read(dt::kWatchdog, word, operation);  // only a change feeds it
  word[0] = static_cast<std::uint16_t>(watchdog_.value_or(word[0]) + 1);
  write(dt::kWatchdog, word, operation);
  watchdog_ = word[0];
}

bool RegisterPlc::is_virtual() {
  std::array<std::uint16_t, 1> word{};
  read(dt::kIsVirtual, word, "asking for the virtual scanner (DT13)");
  return word[0] != 0;
}

void RegisterPlc::require_virtual(const std::string& operation) {
  if (!is_virtual()) {
    throw PlcFault(
        fmt::format("{}: {} was refused: this is a real scanner (DT13 is 0), do it by hand", name_, operation));
  }
}

void RegisterPlc::turn_mrad(double turn) {
  const std::string operation = fmt::format("turning the adjuster by {:.4f} mrad", turn);
  require_virtual(operation);
  const double nrad = std::round(1e6 * turn);
  require(std::abs(nrad) <= std::numeric_limits<std::int32_t>::max(), "a turn of the adjuster is below 2000 mrad");
  const auto value = static_cast<std::int32_t>(nrad);
  std::array<std::uint16_t, 1> done{};
  read(dt::kAdjusterDone, done, operation);
  const std::uint16_t sequence = done[0] == 65535 ? 1 : done[0] + 1;
  const std::array<std::uint16_t, 3> words = {low_word(value), high_word(value), sequence};
  write(dt::kAdjusterTurn, words, operation);
  // An adjuster with a motor needs its time; the virtual one answers at once.
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  do {
    read(dt::kAdjusterDone, done, operation);
    if (done[0] == sequence) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  } while (std::chrono::steady_clock::now() < limit);
  throw PlcFault(fmt::format("{}: {} was not acknowledged within 5 s (DT103 stays {})", name_, operation, done[0]));
}

void RegisterPlc::select(const VirtualSelection& s) {
  const std::string operation = fmt::format("selecting scene {}, pose {}", s.scene, s.pose);
  require_virtual(operation);
  const std::array<std::uint16_t, 7> words = {s.scene,
                                              s.pose,
                                              static_cast<std::uint16_t>(s.stack_seed),
                                              static_cast<std::uint16_t>(s.stack_seed >> 16),
                                              static_cast<std::uint16_t>(s.stack_seed >> 32),
                                              static_cast<std::uint16_t>(s.stack_seed >> 48),
                                              s.warm_up_min};
  write(dt::kScene, words, operation);
}

}  // namespace fringecal::hw

// PlcCore: what the virtual scanner's PLC does, without the wire: registers (hw/plc_map.md), stage, lamp, door,
// watchdog, adjuster, scene selection, and the faults that can be injected. The servers (modbus_server.h,
// mewtocol_server.h) put it on a wire, the virtual camera asks snapshot(). Safe to call from several threads.
//
// The stage moves at constant speed. Home and park are at 0; pattern k stands at 20 mm + k pitch. All times come from
// the clock that is handed over; what happened since the last call is worked off in order of time at the next one.
#pragma once

#include "hw/clock.h"
#include "hw/plc.h"
#include "hw/register_plc.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::virt {

struct PlcCoreOptions {
  int patterns = 11;
  double pitch_mm = 12.0;
  std::chrono::milliseconds per_pattern{0};      // motion time for one pitch; 0 = instant
  std::chrono::milliseconds homing{0};           // duration of homing
  std::chrono::milliseconds watchdog{2000};      // long enough for a client that reads out a large camera
  std::chrono::milliseconds motion_limit{5000};  // of the PLC's own supervision (fault 2)
  std::chrono::milliseconds jam_detection{200};  // the drive is on without motion (fault 1)
  double room_degC = 20.0;
};

/// Faults of the stage, from the next motion on.
enum class StageFault {
  none,
  jam,            // stops half-way; the PLC notices after jam_detection
  never_reaches,  // keeps moving; the PLC notices after motion_limit
  no_echo,        // arrives, but the sequence is not echoed
};

/// What happens to the next answers on the wire.
struct AnswerFault {
  int answers = 0;                     // how many of them
  std::chrono::milliseconds delay{0};  // sent so much later
  bool silent = false;                 // executed, never answered
  int refusal = 0;  // not executed, refused: a Modbus exception code; as MEWTOCOL error it is 53, busy
};

/// What the virtual camera sees.
struct ScannerSnapshot {
  std::optional<int> pattern;  // in the light path, at rest; absent: between patterns, parked, or moving
  bool settled = true;         // the stage stands still
  bool lamp_on = false;
  double lamp_level = 1.0;
  std::vector<double> adjuster_turns_mrad;  // in the order in which they were asked
  hw::VirtualSelection selection;
  std::string scene_name;  // of the selection
};

/// "calibration 3", as VirtualScanner::standard_scene() knows it; empty: there is no such scene.
std::string scene_name(const hw::VirtualSelection& selection);

class PlcCore {
 public:
  explicit PlcCore(PlcCoreOptions options = {}, const hw::Clock& clock = system_clock());

  /// Registers; false where one of them does not exist, or is not to be written.
  bool read(std::uint16_t first, std::span<std::uint16_t> words);
  bool write(std::uint16_t first, std::span<const std::uint16_t> words);
  /// Contacts "X0000" and "Y0000"; nothing, or false, where there is none (or it is an input).
  std::optional<bool> read_contact(std::string_view contact);
  bool write_contact(std::string_view contact, bool on);

  ScannerSnapshot snapshot();

  /// A motion to a pattern ends only where this holds: so a computer that is slow at rendering the selected scene looks
  /// like a slow stage, not like a camera that does not answer. Called with the core locked; empty: always.
  void wait_for_scene(std::function<bool(const hw::VirtualSelection&)> ready);

  void set_stage_fault(StageFault fault);
  void set_door(bool closed);
  void plan_answers(AnswerFault fault);
  /// What to do with the answer that is due now; counts it off.
  AnswerFault next_answer();
  /// Telegrams answered or swallowed so far.
  int telegrams() const;

  static const hw::Clock& system_clock();

 private:
  using TimePoint = hw::Clock::TimePoint;
  struct Motion {
    hw::PlcCommand command = hw::PlcCommand::none;
    std::uint16_t sequence = 0;
    std::optional<int> pattern{};
    double from_um = 0, to_um = 0;
    TimePoint start{}, end{};
    StageFault fault = StageFault::none;
  };

  void advance(TimePoint now);
  void start(hw::PlcCommand command, std::uint16_t sequence, int target, TimePoint now);
  void start_motion(Motion motion, std::chrono::milliseconds duration, TimePoint now);
  void finish_motion();
  hw::VirtualSelection selection() const;
  void fail(hw::PlcFaultCode code, TimePoint now);
  void set_lamp(bool on, TimePoint now);
  void watch_from(TimePoint now);
  void act_on_writes(std::uint16_t first, std::size_t count, TimePoint now);
  double position_um(TimePoint now) const;
  std::uint16_t value_of(std::uint16_t address, TimePoint now) const;
  TimePoint fault_time(hw::PlcFaultCode code) const;

  PlcCoreOptions options_;
  const hw::Clock& clock_;
  mutable std::mutex mutex_;

  std::vector<std::uint16_t> written_;  // the RW registers as the client left them
  hw::PlcState state_ = hw::PlcState::idle;
  hw::PlcFaultCode fault_ = hw::PlcFaultCode::none;
  std::uint16_t sequence_accepted_ = 0, sequence_done_ = 0;
  std::optional<Motion> motion_;
  std::optional<int> pattern_;
  double position_um_ = 0;
  bool homed_ = false, lamp_on_ = false, door_closed_ = true;
  TimePoint watched_since_{};  // last feed, or the start of what is watched
  StageFault stage_fault_ = StageFault::none;
  AnswerFault answer_fault_;
  std::uint16_t adjuster_done_ = 0;
  std::int32_t adjuster_total_nrad_ = 0;
  std::vector<double> adjuster_turns_mrad_;
  int telegrams_ = 0;
  std::function<bool(const hw::VirtualSelection&)> scene_ready_;
};

}  // namespace fringecal::virt

#include "hw/virtual/plc_core.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace fringecal::virt {
namespace {

using hw::PlcCommand;
using hw::PlcFaultCode;
using hw::PlcState;
namespace dt = hw::dt;

constexpr double kFirstPattern_um = 20000;
constexpr double kWarmUp_degC = 1.5, kWarmUp_min = 25;  // the grating above the room, and its time constant
constexpr auto kNever = hw::Clock::TimePoint::max();

const hw::PlcRegister* register_at(std::uint16_t address) {
  const auto found = std::find_if(hw::kPlcRegisters.begin(), hw::kPlcRegisters.end(), [&](const hw::PlcRegister& r) {
    return address >= r.address && address < r.address + r.words();
  });
  return found == hw::kPlcRegisters.end() ? nullptr : &*found;
}

}  // namespace

const hw::Clock& PlcCore::system_clock() {
  static const hw::SystemClock clock;
  return clock;
}

PlcCore::PlcCore(PlcCoreOptions options, const hw::Clock& clock)
    : options_(options), clock_(clock), written_(dt::kEnd, 0) {
  require(options.patterns >= 1 && options.patterns < 1000, "a grating has 1 to 999 patterns");
  written_[dt::kLampLevel] = 1000;
  written_[dt::kWarmUp] = hw::kWarmedUp;
}

bool PlcCore::read(std::uint16_t first, std::span<std::uint16_t> words) {
  if (words.empty() || first + words.size() > dt::kEnd) return false;
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  advance(now);
  for (std::size_t k = 0; k < words.size(); ++k) words[k] = value_of(static_cast<std::uint16_t>(first + k), now);
  return true;
}

bool PlcCore::write(std::uint16_t first, std::span<const std::uint16_t> words) {
  if (words.empty() || first + words.size() > dt::kEnd) return false;
  for (std::size_t k = 0; k < words.size(); ++k) {
    const hw::PlcRegister* r = register_at(static_cast<std::uint16_t>(first + k));
    if (!r || !r->writable()) return false;
  }
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  advance(now);
  const bool fed = first <= dt::kWatchdog && first + words.size() > dt::kWatchdog &&
                   words[dt::kWatchdog - first] != written_[dt::kWatchdog];
  if (fed) watched_since_ = now;
  std::copy(words.begin(), words.end(), written_.begin() + first);
  act_on_writes(first, words.size(), now);
  advance(now);
  return true;
}

void PlcCore::act_on_writes(std::uint16_t first, std::size_t count, TimePoint now) {
  const auto touched = [&](std::uint16_t address) { return address >= first && address < first + count; };
  if (touched(dt::kLamp)) set_lamp(written_[dt::kLamp] != 0, now);
  if (touched(dt::kLampLevel)) written_[dt::kLampLevel] = std::min<std::uint16_t>(written_[dt::kLampLevel], 1000);
  if (touched(dt::kSequence) && written_[dt::kSequence] != sequence_accepted_) {
    sequence_accepted_ = written_[dt::kSequence];
    start(static_cast<PlcCommand>(written_[dt::kCommand]), sequence_accepted_, written_[dt::kTargetPattern], now);
  }
  if (touched(dt::kAdjusterSequence) && written_[dt::kAdjusterSequence] != adjuster_done_) {
    const std::int32_t turn = hw::int32_from(written_[dt::kAdjusterTurn], written_[dt::kAdjusterTurn + 1]);
    adjuster_turns_mrad_.push_back(1e-6 * turn);
    adjuster_total_nrad_ += turn;
    adjuster_done_ = written_[dt::kAdjusterSequence];
  }
}

std::uint16_t PlcCore::value_of(std::uint16_t address, TimePoint now) const {
  const auto position = static_cast<std::int32_t>(std::lround(position_um(now)));
  const auto hundredths = [](double degC) {
    return static_cast<std::uint16_t>(static_cast<std::int16_t>(std::lround(100 * degC)));
  };
  const std::uint16_t warm_up = written_[dt::kWarmUp];
  const double rise = warm_up == hw::kWarmedUp ? kWarmUp_degC : kWarmUp_degC * (1 - std::exp(-warm_up / kWarmUp_min));
  switch (address) {
    case dt::kMapVersion:
      return hw::kPlcMapVersion;
    case dt::kState:
      return static_cast<std::uint16_t>(state_);
    case dt::kFaultCode:
      return static_cast<std::uint16_t>(fault_);
    case dt::kSequenceDone:
      return sequence_done_;
    case dt::kPosition:
      return hw::low_word(position);
    case dt::kPosition + 1:
      return hw::high_word(position);
    case dt::kPattern:
      return pattern_ ? static_cast<std::uint16_t>(*pattern_) : hw::kNoPattern;
    case dt::kLampOn:
      return lamp_on_;
    case dt::kDoorClosed:
      return door_closed_;
    case dt::kTemperature:
      return hundredths(options_.room_degC + rise);
    case dt::kTemperatureRoom:
      return hundredths(options_.room_degC);
    case dt::kPatterns:
      return static_cast<std::uint16_t>(options_.patterns);
    case dt::kWatchdogLimit:
      return static_cast<std::uint16_t>(options_.watchdog.count());
    case dt::kIsVirtual:
      return 1;
    case dt::kAdjusterDone:
      return adjuster_done_;
    case dt::kAdjusterTotal:
      return hw::low_word(adjuster_total_nrad_);
    case dt::kAdjusterTotal + 1:
      return hw::high_word(adjuster_total_nrad_);
    default:
      return written_[address];
  }
}

void PlcCore::start(PlcCommand command, std::uint16_t sequence, int target, TimePoint now) {
  if (command == PlcCommand::clear_fault) {
    if (state_ == PlcState::fault && !door_closed_) return;  // the cause is still there
    if (state_ == PlcState::fault) state_ = PlcState::idle;
    fault_ = PlcFaultCode::none;
    sequence_done_ = sequence;
    return;
  }
  if (state_ == PlcState::fault) return;
  switch (command) {
    case PlcCommand::none:
      break;
    case PlcCommand::home:
      homed_ = false;
      start_motion({.command = command, .sequence = sequence, .to_um = 0}, options_.homing, now);
      return;
    case PlcCommand::move_to_pattern:
    case PlcCommand::park: {
      if (!homed_) return fail(PlcFaultCode::not_homed, now);
      const bool park = command == PlcCommand::park;
      if (!park && target >= options_.patterns) return fail(PlcFaultCode::no_such_pattern, now);
      const double pitch_um = 1000 * options_.pitch_mm;
      const double to_um = park ? 0 : kFirstPattern_um + target * pitch_um;
      const double pitches = std::abs(to_um - position_um(now)) / pitch_um;
      const auto duration =
          std::chrono::milliseconds(std::lround(pitches * static_cast<double>(options_.per_pattern.count())));
      start_motion({.command = command,
                    .sequence = sequence,
                    .pattern = park ? std::nullopt : std::optional(target),
                    .to_um = to_um},
                   duration, now);
      return;
    }
    case PlcCommand::stop:
      position_um_ = position_um(now);
      motion_.reset();
      state_ = PlcState::idle;
      sequence_done_ = sequence;
      return;
    default:
      break;
  }
  fail(PlcFaultCode::no_such_command, now);
}

void PlcCore::start_motion(Motion motion, std::chrono::milliseconds duration, TimePoint now) {
  motion.from_um = position_um(now);
  motion.start = now;
  motion.end = now + duration;
  motion.fault = stage_fault_;
  watch_from(now);
  position_um_ = motion.from_um;
  state_ = motion.command == PlcCommand::home ? PlcState::homing : PlcState::moving;
  pattern_.reset();
  motion_ = motion;
}

void PlcCore::watch_from(TimePoint now) {
  if (!lamp_on_ && !motion_) watched_since_ = std::max(watched_since_, now);
}

PlcCore::TimePoint PlcCore::fault_time(PlcFaultCode code) const {
  if (code == PlcFaultCode::watchdog) return lamp_on_ || motion_ ? watched_since_ + options_.watchdog : kNever;
  if (!motion_) return kNever;
  if (code == PlcFaultCode::position_not_reached) return motion_->start + options_.motion_limit;
  const auto half = motion_->start + (motion_->end - motion_->start) / 2;
  return motion_->fault == StageFault::jam ? half + options_.jam_detection : kNever;
}

void PlcCore::advance(TimePoint now) {
  for (;;) {
    const bool waits = motion_ && motion_->pattern && scene_ready_ && !scene_ready_(selection());
    const bool arrives =
        motion_ && !waits && (motion_->fault == StageFault::none || motion_->fault == StageFault::no_echo);
    const TimePoint arrival = arrives ? motion_->end : kNever;
    PlcFaultCode code = PlcFaultCode::jam;
    for (const auto other : {PlcFaultCode::position_not_reached, PlcFaultCode::watchdog}) {
      // A stage that only waits for its scene to be rendered is not late: no stage of brass and glass would be.
      if (other == PlcFaultCode::position_not_reached && waits) continue;
      if (fault_time(other) < fault_time(code)) code = other;
    }
    const TimePoint failure = fault_time(code);
    if (arrival <= failure && arrival <= now) {
      finish_motion();
    } else if (failure <= now) {
      fail(code, failure);
    } else {
      return;
    }
  }
}

void PlcCore::finish_motion() {
  const Motion motion = *motion_;
  motion_.reset();
  position_um_ = motion.to_um;
  pattern_ = motion.pattern;
  if (motion.command == PlcCommand::home) homed_ = true;
  state_ = motion.command == PlcCommand::move_to_pattern ? PlcState::in_position : PlcState::idle;
  if (motion.fault != StageFault::no_echo) sequence_done_ = motion.sequence;
}

void PlcCore::fail(PlcFaultCode code, TimePoint now) {
  position_um_ = position_um(now);
  if (code == PlcFaultCode::jam || code == PlcFaultCode::position_not_reached) homed_ = false;
  if (motion_) pattern_.reset();
  motion_.reset();
  state_ = PlcState::fault;
  fault_ = code;
  lamp_on_ = false;
  written_[dt::kLamp] = 0;
}

void PlcCore::set_lamp(bool on, TimePoint now) {
  if (on && state_ == PlcState::fault) {
    written_[dt::kLamp] = 0;
    return;
  }
  if (on && !lamp_on_) watch_from(now);
  lamp_on_ = on;
}

double PlcCore::position_um(TimePoint now) const {
  if (!motion_) return position_um_;
  const Motion& m = *motion_;
  const std::chrono::duration<double> duration = m.end - m.start, elapsed = now - m.start;
  double part = duration.count() > 0 ? std::min(1.0, elapsed.count() / duration.count()) : 1.0;
  if (m.fault == StageFault::jam) part = std::min(part, 0.5);
  if (m.fault == StageFault::never_reaches) part = std::min(part, 0.99);
  return m.from_um + part * (m.to_um - m.from_um);
}

std::optional<bool> PlcCore::read_contact(std::string_view contact) {
  const std::lock_guard lock(mutex_);
  advance(clock_.now());
  if (contact == "X0000") return door_closed_;
  if (contact == "Y0000") return lamp_on_;
  return std::nullopt;
}

bool PlcCore::write_contact(std::string_view contact, bool on) {
  if (contact != "Y0000") return false;
  const std::array<std::uint16_t, 1> word = {static_cast<std::uint16_t>(on)};
  return write(dt::kLamp, word);
}

std::string scene_name(const hw::VirtualSelection& selection) {
  if (selection.scene >= hw::kSceneNames.size()) return "";
  const std::string_view name = hw::kSceneNames[selection.scene];
  return selection.scene == 0 ? std::string(name) : fmt::format("{} {}", name, selection.pose);
}

hw::VirtualSelection PlcCore::selection() const {
  hw::VirtualSelection out{.scene = written_[dt::kScene],
                           .pose = written_[dt::kPose],
                           .stack_seed = 0,
                           .warm_up_min = written_[dt::kWarmUp]};
  for (int k = 3; k >= 0; --k) {
    out.stack_seed = out.stack_seed << 16 | written_[static_cast<std::size_t>(dt::kStackSeed + k)];
  }
  return out;
}

void PlcCore::wait_for_scene(std::function<bool(const hw::VirtualSelection&)> ready) {
  const std::lock_guard lock(mutex_);
  scene_ready_ = std::move(ready);
}

ScannerSnapshot PlcCore::snapshot() {
  const std::lock_guard lock(mutex_);
  advance(clock_.now());
  ScannerSnapshot out{.pattern = pattern_,
                      .settled = !motion_,
                      .lamp_on = lamp_on_,
                      .lamp_level = written_[dt::kLampLevel] / 1000.0,
                      .adjuster_turns_mrad = adjuster_turns_mrad_,
                      .selection = selection(),
                      .scene_name = ""};
  out.scene_name = scene_name(out.selection);
  return out;
}

void PlcCore::set_stage_fault(StageFault fault) {
  const std::lock_guard lock(mutex_);
  stage_fault_ = fault;
}

void PlcCore::set_door(bool closed) {
  const std::lock_guard lock(mutex_);
  const TimePoint now = clock_.now();
  advance(now);
  door_closed_ = closed;
  if (!closed && state_ != PlcState::fault) fail(PlcFaultCode::door_open, now);
}

void PlcCore::plan_answers(AnswerFault fault) {
  const std::lock_guard lock(mutex_);
  answer_fault_ = fault;
}

AnswerFault PlcCore::next_answer() {
  const std::lock_guard lock(mutex_);
  ++telegrams_;
  if (answer_fault_.answers <= 0) return {};
  --answer_fault_.answers;
  return answer_fault_;
}

int PlcCore::telegrams() const {
  const std::lock_guard lock(mutex_);
  return telegrams_;
}

}  // namespace fringecal::virt

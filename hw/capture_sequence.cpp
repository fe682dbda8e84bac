#include "hw/capture_sequence.h"

#include "core/error.h"
#include "hw/plc_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::hw {
namespace {

std::string identity_text(const CameraIdentity& c) {
  std::string text;
  for (const std::string* part : {&c.vendor, &c.model, &c.serial}) {
    if (!part->empty()) text += (text.empty() ? "" : " ") + *part;
  }
  return text.empty() ? "camera" : text;
}

}  // namespace

/// Lamp off and stage parked when the scope ends, however it ends.
class CaptureSequence::SafeEnd {
 public:
  SafeEnd(CaptureSequence& sequence, std::string& trouble) : sequence_(sequence), trouble_(trouble) {}
  SafeEnd(const SafeEnd&) = delete;
  SafeEnd& operator=(const SafeEnd&) = delete;
  ~SafeEnd() { trouble_ = sequence_.make_safe(); }

 private:
  CaptureSequence& sequence_;
  std::string& trouble_;
};

CaptureSequence::CaptureSequence(Camera& camera, Plc& plc, Clock& clock, CaptureOptions options)
    : camera_(camera), plc_(plc), clock_(clock), options_(std::move(options)) {
  require(defect_of(options_.plan).empty(), "a capture has a pattern plan without defects");
  require(!options_.hdr_ratio || *options_.hdr_ratio > 1, "the second exposure is the longer one");
  require(options_.frame_attempts >= 1 && options_.reopen_attempts >= 0, "attempts are counted from 1");
}

const CaptureReport& CaptureSequence::run(const std::stop_token& stop) {
  stop_ = stop;
  std::string trouble;
  try {
    const SafeEnd end(*this, trouble);
    capture_frames();
  } catch (const CaptureStopped& e) {
    throw CaptureStopped(e.what() + where_it_stands(trouble));
  } catch (const EnvironmentError& e) {
    throw EnvironmentError(e.what() + where_it_stands(trouble));
  }
  partial_->finish();
  if (!trouble.empty()) {
    throw EnvironmentError(fmt::format("{}: the capture is complete, but {}", options_.folder.string(), trouble));
  }
  return report_;
}

void CaptureSequence::capture_frames() {
  with_recovery("asking for its identity", [&] { camera_identity_ = camera_.identity(); });
  with_recovery("asking for its state", [&] {
    plc_identity_ = plc_.identity();
    status_ = plc_.status();
  });
  std::vector<double> exposures_ms;
  if (options_.exposure_ms) {
    exposures_ms.push_back(*options_.exposure_ms);
    if (options_.hdr_ratio) exposures_ms.push_back(*options_.exposure_ms * *options_.hdr_ratio);
  }
  partial_.emplace(
      options_.folder,
      PartialCapture::Job{.info = info(), .exposures = options_.hdr_ratio ? 2u : 1u, .exposures_ms = exposures_ms});
  report_.frames_resumed = partial_->frames_there();
  if (partial_->frames_there() == partial_->frames_wanted()) {
    report_.exposures_ms = partial_->exposures_ms();
    return;
  }
  if (partial_->exposures_ms().empty()) find_exposures();
  report_.exposures_ms = partial_->exposures_ms();
  for (std::size_t k = 0; k < options_.plan.patterns.size(); ++k) {
    capture_pattern(k);
    if (options_.progress) options_.progress(static_cast<int>(k) + 1, static_cast<int>(options_.plan.patterns.size()));
  }
  partial_->settle();
}

void CaptureSequence::capture_pattern(std::size_t k) {
  const int saturation = (1 << camera_identity_.bits) - 1;
  for (std::size_t e = 0; e < partial_->exposures_ms().size(); ++e) {
    if (partial_->has(k, e)) continue;
    GrayImage image;
    with_recovery("taking " + name_of(k), [&] { image = take_frame(k, partial_->exposures_ms()[e]); });
    if (e == 0) report_.saturated_part = std::max(report_.saturated_part, saturated_part(image, saturation));
    partial_->save(k, e, std::move(image));
    ++report_.frames_taken;
  }
}

/// Runs one step until it succeeds, opening lost devices again in between.
template <class Work>
void CaptureSequence::with_recovery(const std::string& operation, const Work& work) {
  int frames_lost = 0, camera_lost = 0, plc_lost = 0;
  bool stalled = false, reopening = false;
  const auto event = [&](const char* device, const char* what) {
    report_.events.push_back(fmt::format("{}: {}: {}", device, operation, what));
  };
  for (;;) {
    check_stop();
    try {
      if (reopening) pause(options_.reopen_pause);
      reopening = false;
      if (!camera_ready_) prepare_camera();
      if (plc_needs_opening_) reopen_plc();
      if (stalled) forgive_watchdog();
      stalled = false;
      if (partial_ && !plc_ready_) prepare_plc();
      work();
      return;
    } catch (const FrameLost& e) {
      event("camera", e.what());
      if (++frames_lost >= options_.frame_attempts) {
        throw EnvironmentError(fmt::format("camera {}: {} failed {} times: {}; check cable, light and network load",
                                           identity_text(camera_identity_), operation, frames_lost, e.what()));
      }
      ++report_.retakes;
      stalled = true;
    } catch (const CameraLost& e) {
      event("camera", e.what());
      camera_ready_ = false;
      if (++camera_lost > options_.reopen_attempts) {
        throw EnvironmentError(fmt::format("camera {}: {} failed, and opening it again failed {} times: {}",
                                           identity_text(camera_identity_), operation, options_.reopen_attempts,
                                           e.what()));
      }
      stalled = reopening = true;
    } catch (const PlcLost& e) {
      event("PLC", e.what());
      plc_ready_ = false;
      plc_needs_opening_ = true;
      if (++plc_lost > options_.reopen_attempts) {
        throw EnvironmentError(
            fmt::format("{} (while {}; opened again {} times)", e.what(), operation, options_.reopen_attempts));
      }
      reopening = true;
    } catch (const PlcFault& e) {
      throw EnvironmentError(fmt::format("{} (while {})", e.what(), operation));
    }
  }
}

void CaptureSequence::prepare_camera() {
  camera_.reopen();
  ++report_.camera_reopened;
  camera_exposure_ms_.reset();
  last_frame_id_.reset();
  camera_ready_ = true;
}

/// Waiting for a camera starves the PLC's watchdog: that fault is of our making, and prepare_plc() may clear it.
void CaptureSequence::forgive_watchdog() {
  if (!plc_ready_) return;
  status_ = plc_.status();
  if (status_.state == PlcState::fault && status_.fault_code == static_cast<std::uint16_t>(PlcFaultCode::watchdog)) {
    plc_ready_ = false;
  }
}

void CaptureSequence::reopen_plc() {
  plc_.reopen();
  ++report_.plc_reopened;
  plc_needs_opening_ = false;
}

void CaptureSequence::prepare_plc() {
  plc_identity_ = plc_.identity();
  at_.reset();
  homed_ = false;
  status_ = plc_.status();
  plc_touched_ = true;
  sequence_ = status_.sequence_done;
  if (!status_.door_closed) {
    throw PlcFault(fmt::format("{}: the door is open; close it and repeat the command", plc_identity_));
  }
  feed();
  if (status_.state == PlcState::fault) {
    // Left by an earlier run, or the watchdog while the link was down: cleared once, the PLC knows whether it may be.
    send(PlcCommand::clear_fault);
    wait_for_echo("clearing the fault", PlcState::idle);
  }
  send(PlcCommand::home);
  wait_for_echo("homing", PlcState::idle);
  homed_ = true;
  plc_.set_lamp(true, options_.lamp_level);
  status_ = checked_status("switching the lamp on");
  if (!status_.lamp_on) throw PlcFault(fmt::format("{}: the lamp does not light", plc_identity_));
  plc_ready_ = true;
}

void CaptureSequence::find_exposures() {
  // The lightest there is: a white pattern, else the coarsest Gray bit (wide white areas) and a phase pattern (all of
  // the field). What lies between them is covered by the target's distance from saturation.
  std::vector<std::size_t> tests;
  for (const PatternKind kind : {PatternKind::white, PatternKind::gray, PatternKind::phase}) {
    const auto& patterns = options_.plan.patterns;
    const auto found = std::find_if(patterns.begin(), patterns.end(), [&](const Pattern& p) { return p.kind == kind; });
    if (found != patterns.end()) tests.push_back(static_cast<std::size_t>(found - patterns.begin()));
    if (kind == PatternKind::white && !tests.empty()) break;
  }
  const int saturation = (1 << camera_identity_.bits) - 1;
  double exposure_ms = 0;
  with_recovery("asking for the exposure", [&] { exposure_ms = camera_.exposure_ms(); });
  for (int step = 0; step < options_.search.most_steps; ++step) {
    int level = 0;
    for (const std::size_t k : tests) {
      with_recovery("taking a test frame of " + name_of(k),
                    [&] { level = std::max(level, bright_level(take_frame(k, exposure_ms))); });
    }
    const auto next = next_exposure_ms(exposure_ms, level, saturation, options_.search);
    if (!next || *next == exposure_ms) break;
    exposure_ms = *next;
  }
  std::vector<double> exposures_ms = {exposure_ms};
  if (options_.hdr_ratio) exposures_ms.push_back(exposure_ms * *options_.hdr_ratio);
  partial_->set_exposures_ms(exposures_ms);
}

GrayImage CaptureSequence::take_frame(std::size_t k, double exposure_ms) {
  move_to(k);
  if (camera_exposure_ms_ != exposure_ms) {
    camera_.set_exposure_ms(exposure_ms);
    camera_exposure_ms_ = exposure_ms;
  }
  const auto exposure = std::chrono::milliseconds(static_cast<long>(std::ceil(exposure_ms)));
  CameraFrame frame = camera_.take_frame(options_.frame_limit + exposure);
  if (last_frame_id_ == frame.frame_id) {
    throw FrameLost(fmt::format("frame {} came twice", frame.frame_id));
  }
  last_frame_id_ = frame.frame_id;
  const std::string defect =
      defect_of_frame(frame.image, camera_identity_.width_px, camera_identity_.height_px, camera_identity_.bits);
  if (!defect.empty()) throw FrameLost("the frame " + defect);
  status_ = checked_status("checking after " + name_of(k));
  if (status_.state != PlcState::in_position || status_.sequence_done != sequence_ || !status_.lamp_on) {
    plc_ready_ = false;
    throw FrameLost(fmt::format("after the frame the {}; it may show something else than {}",
                                status_.lamp_on ? "stage was no longer in position" : "lamp was off", name_of(k)));
  }
  return std::move(frame.image);
}

void CaptureSequence::move_to(std::size_t k) {
  feed();
  if (at_ == k) return;
  at_.reset();
  send(PlcCommand::move_to_pattern, static_cast<std::uint16_t>(k));
  wait_for_echo("moving to " + name_of(k), PlcState::in_position);
  at_ = k;
}

void CaptureSequence::send(PlcCommand command, std::uint16_t target) {
  sequence_ = sequence_ == 65535 ? 1 : static_cast<std::uint16_t>(sequence_ + 1);
  plc_.command(command, sequence_, target);
}

PlcStatus CaptureSequence::wait_for_echo(const std::string& operation, PlcState wanted) {
  const auto limit = clock_.now() + options_.motion_limit;
  const std::uint16_t before = status_.sequence_done;
  for (;;) {
    status_ = plc_.status();
    const bool echoed = status_.sequence_done == sequence_;
    if (status_.fault_code == static_cast<std::uint16_t>(PlcFaultCode::not_homed) && homed_) {
      throw PlcLost(
          fmt::format("{}: {} failed: it has been restarted (it is no longer homed)", plc_identity_, operation));
    }
    if (status_.state == PlcState::fault) {
      throw PlcFault(fmt::format("{}: {} failed: fault {} ({})", plc_identity_, operation, status_.fault_code,
                                 fault_words(status_.fault_code)));
    }
    if (echoed && status_.state == wanted) return status_;
    if (!echoed && status_.sequence_done != before) {
      throw PlcLost(fmt::format("{}: {} failed: it has been restarted (the echoed sequence went from {} to {})",
                                plc_identity_, operation, before, status_.sequence_done));
    }
    if (clock_.now() >= limit) {
      throw PlcFault(
          fmt::format("{}: {} failed: not finished within {} ms (state {}, sequence {} instead of {}, "
                      "position {:.3f} mm)",
                      plc_identity_, operation, options_.motion_limit.count(), static_cast<int>(status_.state),
                      status_.sequence_done, sequence_, 1e-3 * status_.position_um));
    }
    feed();
    check_stop();
    clock_.sleep_for(options_.poll);
  }
}

PlcStatus CaptureSequence::checked_status(const std::string& operation) {
  const PlcStatus status = plc_.status();
  if (status.state == PlcState::fault) {
    throw PlcFault(fmt::format("{}: {} found fault {} ({})", plc_identity_, operation, status.fault_code,
                               fault_words(status.fault_code)));
  }
  return status;
}

void CaptureSequence::feed() {
  if (plc_ready_ && clock_.now() - fed_ < options_.feed) return;
  plc_.feed_watchdog();
  fed_ = clock_.now();
}

void CaptureSequence::pause(std::chrono::milliseconds duration) {
  const auto end = clock_.now() + duration;
  while (clock_.now() < end) {
    check_stop();
    if (plc_ready_) feed();
    clock_.sleep_for(std::min<std::chrono::microseconds>(duration, std::chrono::milliseconds(20)));
  }
}

void CaptureSequence::check_stop() const {
  if (stop_.stop_requested()) throw CaptureStopped("the capture was stopped");
}

std::string CaptureSequence::name_of(std::size_t k) const {
  return fmt::format("pattern {} ('{}')", k, describe(options_.plan.patterns[k]));
}

CaptureInfo CaptureSequence::info() const {
  CaptureInfo info;
  info.plan = options_.plan;
  info.width_px = camera_identity_.width_px;
  info.height_px = camera_identity_.height_px;
  info.bits = camera_identity_.bits;
  info.temperatures_degC = {{"grating", status_.temperature_degC}, {"room", status_.temperature_room_degC}};
  info.devices = {{"camera", identity_text(camera_identity_)}, {"plc", plc_identity_}};
  info.source = options_.source;
  return info;
}

std::string CaptureSequence::make_safe() noexcept {
  if (!plc_touched_) return "";
  stop_ = {};  // a stop request must not cut the way to safety short
  try {
    for (int attempt = 0;; ++attempt) {
      try {
        if (plc_needs_opening_) plc_.reopen();
        plc_needs_opening_ = false;
        lamp_off_and_park();
        return "";
      } catch (const PlcLost&) {
        if (attempt > 0) throw;
        plc_needs_opening_ = true;
      }
    }
  } catch (const PlcFault& e) {
    return fmt::format("the stage is not parked: {}", e.what());
  } catch (const std::exception& e) {
    return fmt::format("lamp and stage could not be reached ({}); the PLC's watchdog stops both", e.what());
  }
}

void CaptureSequence::lamp_off_and_park() {
  plc_.set_lamp(false);
  status_ = checked_status("parking");
  if (!homed_) return;
  plc_ready_ = false;  // feed at every poll: nobody else does
  send(PlcCommand::park);
  wait_for_echo("parking", PlcState::idle);
}

std::string CaptureSequence::where_it_stands(const std::string& trouble) {
  std::string text;
  try {
    if (partial_) partial_->settle();
  } catch (const EnvironmentError& e) {
    text += fmt::format("; {}", e.what());
  }
  if (!trouble.empty()) text += "; " + trouble;
  if (partial_ && partial_->frames_there() > 0) {
    text += fmt::format("; {} of {} frames are kept in {}, the same command continues there", partial_->frames_there(),
                        partial_->frames_wanted(), partial_->folder().string());
  }
  return text;
}

}  // namespace fringecal::hw

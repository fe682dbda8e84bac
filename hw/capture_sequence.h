// CaptureSequence: one stack of frames from a camera and a PLC, on disk as a Capture.
//
//   home, lamp on; for each pattern: move -> wait for the echoed sequence number *and* "in position" -> trigger ->
//   frame
//   -> the PLC asked again (still in position, lamp lit, no fault: else the frame does not count) -> saved at once;
//   lamp off and stage parked on every way out, also on exceptions and a stop request.
//
// Recovery, all of it bounded, counted and reported:
//   FrameLost, a frame with the id of the one before, a frame under a dark lamp   the frame is taken again
//   CameraLost, PlcLost                                                           the device is opened again; a PLC is
//                                                                                 homed and lit again
//   PlcFault, state "fault"                                                       the run stops at once
// What does not recover ends in EnvironmentError with device, operation and cause. Frames taken so far are kept in
// NAME.partial (hw/partial_capture.h); the next run with the same options takes only what is missing.
//
// In a fault the stage stays where it is (it must not move) and the lamp is switched off. Where the PLC cannot be
// reached, its own watchdog stops motion and lamp; the message says so.
#pragma once

#include "core/pattern_plan.h"
#include "hw/camera.h"
#include "hw/clock.h"
#include "hw/exposure.h"
#include "hw/partial_capture.h"
#include "hw/plc.h"

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace fringecal::hw {

struct CaptureOptions {
  std::filesystem::path folder;
  PatternPlan plan;
  std::string source;                 // of the capture: what was captured, in words
  std::optional<double> exposure_ms;  // absent: found from test frames
  std::optional<double> hdr_ratio;    // a second exposure, longer by this factor, merged by modulation; absent: one
  ExposureSearch search;
  double lamp_level = 1.0;
  int frame_attempts = 4;                        // per frame: three losses in a row at 2 % loss are one in 10^5
  int reopen_attempts = 5;                       // per incident
  std::chrono::milliseconds reopen_pause{1000};  // a PLC boots in a few seconds
  std::chrono::milliseconds frame_limit{
      1000};  // besides the exposure; a frame of 1.4 MB takes 12 ms on gigabit Ethernet
  std::chrono::milliseconds motion_limit{15000};
  std::chrono::milliseconds poll{2};
  std::chrono::milliseconds feed{300};                // a watchdog's limit is seconds
  std::function<void(int done, int total)> progress;  // patterns
};

struct CaptureReport {
  int frames_taken = 0, frames_resumed = 0;
  int retakes = 0;  // frames taken again
  int camera_reopened = 0, plc_reopened = 0;
  std::vector<double> exposures_ms;
  double saturated_part = 0;        // of the worst frame of the shortest exposure
  std::vector<std::string> events;  // one sentence per retake and reopening
};

/// The run was asked to stop; lamp and stage are safe, the frames are kept.
struct CaptureStopped : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class CaptureSequence {
 public:
  CaptureSequence(Camera& camera, Plc& plc, Clock& clock, CaptureOptions options);

  /// Throws CaptureStopped, EnvironmentError (device, disk) or InputError (the folder holds something else).
  const CaptureReport& run(const std::stop_token& stop = {});
  /// Also after a run that threw.
  const CaptureReport& report() const { return report_; }

 private:
  class SafeEnd;
  template <class Work>
  void with_recovery(const std::string& operation, const Work& work);
  void capture_frames();
  void prepare_camera();
  void reopen_plc();
  void prepare_plc();
  void forgive_watchdog();
  void find_exposures();
  void capture_pattern(std::size_t k);
  GrayImage take_frame(std::size_t k, double exposure_ms);
  void move_to(std::size_t k);
  PlcStatus wait_for_echo(const std::string& operation, PlcState wanted);
  PlcStatus checked_status(const std::string& operation);
  void send(PlcCommand command, std::uint16_t target = 0);
  void feed();
  void pause(std::chrono::milliseconds duration);
  void check_stop() const;
  std::string name_of(std::size_t k) const;
  CaptureInfo info() const;
  /// Lamp off, stage parked; a sentence about what could not be done, else empty.
  std::string make_safe() noexcept;
  void lamp_off_and_park();
  std::string where_it_stands(const std::string& trouble);

  Camera& camera_;
  Plc& plc_;
  Clock& clock_;
  CaptureOptions options_;
  CaptureReport report_;
  std::stop_token stop_;
  std::optional<PartialCapture> partial_;

  CameraIdentity camera_identity_;
  std::string plc_identity_;
  PlcStatus status_;               // the last one read
  std::uint16_t sequence_ = 0;     // of the last command
  std::optional<std::size_t> at_;  // the pattern in position
  std::optional<double> camera_exposure_ms_;
  std::optional<std::uint64_t> last_frame_id_;
  bool camera_ready_ = true, plc_ready_ = false, plc_touched_ = false, plc_needs_opening_ = false, homed_ = false;
  Clock::TimePoint fed_{};
};

}  // namespace fringecal::hw

// AravisCamera: a GigE Vision camera through Aravis 0.8, software-triggered, one frame per trigger.
//
// A frame is the answer to a trigger when its id is the id expected for that trigger. A camera counts its frames, one
// per trigger:
//   expected(k + 1) = next(expected(k)),   next(65535) = 1, else next(i) = i + 1      (0 is no id) [GigEVision]
// A frame of another id is late or a double and is thrown away and counted; its status, SUCCESS, says nothing about
// which trigger it belongs to. A frame of the right id with packets missing after all resends is a FrameLost. Where no
// frame of the expected id arrives in time, either the frame or the trigger was lost. The next call resolves that by
// the ids it sees; if it cannot, the count is taken anew: after a silence of twice the limit one trigger must be
// answered by exactly one frame. The assumption left is stated so: a camera sends a frame within three limits or never.
//
// Control channel: every register access has a time-out of 0.5 s and five repeats; then CameraLost. Opening asks first
// and says within 0.6 s that nothing answers. A camera is opened by its IPv4 address only: names and device lists would
// broadcast into the network. Frames come over a plain UDP socket (no root rights needed) with a buffer of 4 MB, which
// the kernel grants if net.core.rmem_max allows it. The buffer is set at the first frame of a stream, which may
// therefore be lost: opening takes one frame and drops it.
//
// Throws InputError for an address or setting that cannot be used, CameraLost where the device does not answer.
#pragma once

#include "hw/camera.h"

#include <memory>
#include <optional>

namespace fringecal::hw {

struct AravisCameraOptions {
  std::string address;                          // IPv4, "192.168.0.10"
  std::string pixel_format = "Mono8";           // Mono8, Mono10, Mono12, Mono14 or Mono16, unpacked
  std::optional<int> packet_size_bytes = {};    // absent: 8192 on loopback, else the largest that passes the network
  std::chrono::milliseconds frame_limit{2000};  // for the frame that opening takes
  // How long to wait for a device that another program controls: a program that was killed loses it after the
  // heartbeat time-out, 3 s by default.
  std::chrono::milliseconds takeover_limit{6000};
};

/// Since the object was made, over all openings.
struct CameraStatistics {
  std::uint64_t frames = 0;          // handed over
  std::uint64_t incomplete = 0;      // packets missing after all resends
  std::uint64_t timeouts = 0;        // no frame of the expected id in time
  std::uint64_t late_or_double = 0;  // complete frames of another trigger, thrown away
  std::uint64_t recounts = 0;        // how often the frame count was taken anew, openings not included
  std::uint64_t reopened = 0;
  std::uint64_t packets = 0;          // received
  std::uint64_t missing_packets = 0;  // not there when their frame was given up
  std::uint64_t resend_requests = 0, resent_packets = 0;
};

struct CameraLink {
  int packet_size_bytes = 0;
  int socket_buffer_bytes = 0;  // asked for
  double round_trip_ms = 0;     // median of 20 register reads
};

class AravisCamera final : public Camera {
 public:
  explicit AravisCamera(AravisCameraOptions options);
  ~AravisCamera() override;

  CameraIdentity identity() override;
  void set_exposure_ms(double exposure_ms) override;
  double exposure_ms() override;
  CameraFrame take_frame(std::chrono::milliseconds limit) override;
  void reopen() override;

  CameraStatistics statistics() const;
  CameraLink link();

 private:
  struct Connection;
  void close();

  AravisCameraOptions options_;
  std::optional<double> exposure_ms_;  // what was asked for, set again by reopen()
  CameraStatistics before_;            // of the connections already closed
  std::unique_ptr<Connection> connection_;
};

/// Empty, or why this is not the address of one camera, as a sentence that begins with the address.
std::string defect_of_camera_address(const std::string& address);

}  // namespace fringecal::hw

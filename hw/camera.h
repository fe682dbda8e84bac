// Camera: what the capture sequence needs of one, and nothing else. The real one is a GenICam camera (hw/aravis_camera.h).
//
// A frame belongs to exactly one trigger. An implementation must never hand a frame of an earlier trigger to a later one;
// it proves it by the frame's id, and what it cannot prove it throws away.
#pragma once

#include "core/image.h"

#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace fringecal::hw {

struct CameraIdentity {
  std::string vendor, model, serial, firmware;
  int width_px = 0, height_px = 0;
  int bits = 8;  // significant bits per pixel
};

struct CameraFrame {
  GrayImage image;
  std::uint64_t frame_id = 0;  // of the device
};

/// The device does not answer, or its link is lost: it can be worth opening it again.
struct CameraLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};
/// One frame was lost or damaged; the camera itself answers. The same picture can be taken again.
struct FrameLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Camera {
 public:
  virtual ~Camera() = default;
  virtual CameraIdentity identity() = 0;
  virtual void set_exposure_ms(double exposure_ms) = 0;
  virtual double exposure_ms() = 0;
  /// Software trigger, then the frame of *that* trigger, complete. Throws FrameLost or CameraLost.
  virtual CameraFrame take_frame(std::chrono::milliseconds limit) = 0;
  /// Closes and opens the link again; returns when the camera is ready to be triggered. Throws CameraLost.
  virtual void reopen() = 0;
};

}  // namespace fringecal::hw

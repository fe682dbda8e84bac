// FakeCamera: a GigE Vision camera on a loopback address whose pictures are rendered on demand. The device is Aravis's
// ArvGvFakeCamera: registers, GenICam description, control channel and packets are not ours, only the picture is.
//
// Pixel formats: Mono8, Mono12, Mono16. The renderer gives `bits` significant bits v; another depth n is
//   n > bits:  v 2^(n - bits) + v / 2^(2 bits - n)     (the bits repeated: white stays white)                       (1)
//   n < bits:  v / 2^(bits - n)                                                                                     (2)
// both rounded down. A client's region of interest is cut out of the picture; outside of it there is black.
//
// One device per address: GigE Vision has one fixed port. All of 127.0.0.0/8 is loopback, so several cameras live side
// by side on 127.0.0.1, 127.0.0.2, ... The device does not answer broadcasts.
#pragma once

#include "core/image.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace fringecal::virt {

struct FakeCameraOptions {
  std::string address = "127.0.0.1";
  std::string serial = "V1";  // up to 15 characters
  int width_px = 0, height_px = 0;
  int bits = 8;                          // of the rendered picture, 8 or 12; also the pixel format it wakes up with
  double exposure_ms = 10;               // it wakes up with
  double packet_loss = 0;                // share of the packets that are dropped, [0, 1)
  std::filesystem::path frame_log = {};  // "id sha256" of each frame sent, as it is on the wire, is appended here;
                                         // empty: none
};

class FakeCamera {
 public:
  static constexpr const char* kVendor = "Aravis";  // whose device it is
  static constexpr const char* kModel = "fringecal virtual scanner";

  /// The picture for this exposure; called from the camera's own thread. An exception from it ends the program: a
  /// camera has no way to report it, and any other picture would be a lie.
  using Render = std::function<GrayImage(double exposure_ms)>;

  /// Returns when the device answers at its address. Throws EnvironmentError (address in use, or not of this machine).
  FakeCamera(FakeCameraOptions options, Render render);
  ~FakeCamera();

  /// Pictures rendered so far.
  std::uint64_t frames() const;

 private:
  struct Device;
  std::unique_ptr<Device> device_;
};

}  // namespace fringecal::virt

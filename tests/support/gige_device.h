// A small GigE Vision device for faults that Aravis's own cannot produce: packets dropped by plan, resends honoured or
// not, frames late, doubled or never made. Registers and description are those of ArvFakeCamera; control channel and
// packets are written here from the standard (GigE Vision 2.0, 16-bit block ids).
#pragma once

#include "core/image.h"

#include <chrono>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace fringecal::test {

/// What goes wrong with the frame of one trigger. Packet 0 is the leader, the last one the trailer.
struct FrameFault {
  std::set<int> drop = {};             // packets that are not sent
  int ignored_resends = 0;             // so many requests for each of them are not honoured
  std::chrono::milliseconds delay{0};  // the whole frame comes later; triggers that follow are served in between
  bool sent_twice = false;
  bool trigger_ignored = false;  // no frame at all, and none counted
  bool answers_nothing = false;  // the device is deaf from this trigger on
  // Sent in place of the frame's packets where there are any; the id of the frame is added to the block id in each.
  std::vector<std::string> instead = {};
};

class GigeDevice {
 public:
  using Plan = std::function<FrameFault(int trigger)>;

  GigeDevice(std::string address, int width_px, int height_px, Plan plan);
  ~GigeDevice();

  /// The picture of a trigger; triggers are counted from 0.
  static Image8 picture(int trigger, int width_px, int height_px);
  /// The packets of its frame, block id 0. packet_bytes: with the headers of IP and UDP, as clients set it.
  static std::vector<std::string> packets(int trigger, int width_px, int height_px, int packet_bytes);
  int triggers() const;
  /// Packets in a frame, leader and trailer included, at the packet size that the client has set.
  int packets_per_frame() const;
  int packets_resent() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace fringecal::test

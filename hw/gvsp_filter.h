// What may reach the stream of a GigE Vision camera: a filter in the kernel on the socket of Aravis's receiver. Aravis
// 0.8.26 trusts length, kind and number of a packet, sent by anybody in the network (both found by ./dev fuzz): a datagram
// shorter than its header makes it copy a negative number of bytes, and a trailer that comes first ask for as much memory as
// its number says, up to 64 GB. Let through are packets with
//   a whole header                   8 bytes, 20 with extended ids                                                 (1)
//   leader:  of an image             not of several parts, whose announced sizes are believed as well              (2)
//   data:    a number in the frame   1 <= n <= m = ceil(payload / room),  room = packet size - 28 - header         (3)
//   trailer: behind some data        1 <= n <= m + 1                                                               (4)
// Everything else counts as not received. [GigEVision, GVSP packet header and leader]
#pragma once

#include <cstdint>

namespace fringecal::hw {

/// Of the UDP socket of this process that is bound to `port`. packet_bytes: with the headers of IP and UDP. False where
/// there is no such socket, or the system takes no filter.
bool filter_stream(int port, std::uint32_t payload_bytes, std::uint32_t packet_bytes);

}  // namespace fringecal::hw

// What may reach the stream of a GigE Vision camera: a filter in the kernel on the socket of Aravis's receiver. Aravis
// 0.8.26 trusts the length and number of a packet: a datagram shorter than its header, sent by anybody in the network, makes
// it copy a negative number of bytes (found by ./dev fuzz). Let through are packets with
//   a whole header                  8 bytes, 20 with extended ids                                                  (1)
//   a kind that an image has        leader, trailer, data
//   data: a number n in the frame   1 <= n <= ceil(payload / room),  room = packet size - 28 - header              (2)
// Everything else counts as not received. [GigEVision, GVSP packet header]
#pragma once

#include <cstdint>

namespace fringecal::hw {

/// Of the UDP socket of this process that is bound to `port`. packet_bytes: with the headers of IP and UDP. False where
/// there is no such socket, or the system takes no filter.
bool filter_stream(int port, std::uint32_t payload_bytes, std::uint32_t packet_bytes);

}  // namespace fringecal::hw

// What a hostile device can send, into the clients that talk to it. Each reader serves the device on loopback or on a
// pseudo-terminal when it is first used.
//
//   modbus_replies    answers of a PLC, one after the other: a byte with the length, then the bytes. Of each the first two
//                     become the number of the question, without which none would be looked at
//   mewtocol_replies  the same on a serial line, every byte as it stands
//   gvsp_packets      of one frame: two bytes with the length (low byte first), then the packet; the block id that stands
//                     there is added to the one that is due
#pragma once

#include "tests/fuzz/readers.h"

namespace fringecal::test {

std::vector<Reader> device_readers();

}  // namespace fringecal::test

// The virtual PLC as a Modbus TCP server and as a Modbus RTU slave on a pseudo-terminal. Written from the protocol's
// specification [Modbus], not with the client's library, so that the two do not share a mistake.
//
//   TCP: transaction (2 bytes), protocol 0 (2), length (2), unit (1), PDU
//   RTU: slave (1), PDU, CRC-16 low byte first (polynomial 0xA001 reflected, start 0xFFFF)                     (1)
// Function codes 3 (read holding registers), 6 and 16 (write); anything else: exception 1. Registers that do not exist
// or are not to be written: exception 2. Wrong counts: exception 3.
#pragma once

#include "hw/virtual/byte_server.h"
#include "hw/virtual/plc_core.h"

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace fringecal::virt {

/// (1)
std::uint16_t modbus_crc(std::string_view bytes);

/// The core must outlive the server. Any unit number is answered.
std::unique_ptr<ByteServer> serve_modbus_tcp(PlcCore& core, const std::string& host = "127.0.0.1", int port = 0);
std::unique_ptr<ByteServer> serve_modbus_rtu(PlcCore& core, int slave = 1, const std::string& link = "");

}  // namespace fringecal::virt

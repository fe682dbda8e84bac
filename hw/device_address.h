// Device addresses as they stand in scanner.toml and on the command line:
//
//   modbus-tcp://127.0.0.1:5020[?slave=1]                       (port 502 where none is given)
//   modbus-rtu:/dev/ttyUSB0?baud=115200&slave=1[&parity=none&stop=1]
//   mewtocol:/dev/ttyUSB0?baud=9600&station=1[&parity=odd&stop=1]
//
// Serial defaults are those of the protocols: RTU 19200 baud, even parity; MEWTOCOL-COM 9600 baud, odd parity (FP0 as
// delivered); both 8 data bits, 1 stop bit. Hosts are given as IPv4 numbers: a name would have to be looked up, and
// what answers under a name is not always the machine that was meant.
// All functions throw InputError with the address and what to write instead.
#pragma once

#include <cstdint>
#include <string>

namespace fringecal::hw {

enum class PlcProtocol { modbus_tcp, modbus_rtu, mewtocol };
enum class Parity { none, even, odd };

struct SerialLine {
  std::string device;
  int baud = 19200;
  Parity parity = Parity::even;
  int stop_bits = 1;
};

struct PlcAddress {
  PlcProtocol protocol = PlcProtocol::modbus_tcp;
  std::string host;  // modbus_tcp
  int port = 502;    // modbus_tcp
  SerialLine line;   // the others
  int station = 1;   // slave or station number
  std::string text;  // as the user wrote it
};

PlcAddress parse_plc_address(const std::string& text);

/// The four numbers of one machine's IPv4 address; broadcast, multicast and "any" are refused. what: "camera", ...
std::string parse_ip_address(const std::string& text, const std::string& what);

}  // namespace fringecal::hw

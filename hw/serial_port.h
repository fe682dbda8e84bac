// A serial line in raw mode: bytes out, bytes in until a terminator or a deadline. Throws std::system_error with the
// operation as text.
#pragma once

#include "hw/device_address.h"

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

namespace fringecal::hw {

class SerialPort {
 public:
  explicit SerialPort(const SerialLine& line);
  ~SerialPort();
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  void write(std::string_view bytes);
  /// Everything up to and with the terminator; nothing where it does not come in time or within most_bytes.
  std::optional<std::string> read_until(char terminator, std::size_t most_bytes, std::chrono::milliseconds limit);
  /// Throws away what came in, and what comes in until the line was silent for `silence` (bounded by 4 x silence).
  void drain(std::chrono::milliseconds silence);
  /// Throws away what came in.
  void flush();

 private:
  int fd_ = -1;
};

}  // namespace fringecal::hw

// ModbusPlc: the register map over Modbus TCP or Modbus RTU (libmodbus), function codes 3 and 16.
//
// The library's own link recovery is never used (it blocks while the server is down); a lost link is closed here and
// opened again by reopen(). After a time-out the line is listened to for another answer limit and emptied, so that a
// late answer is not taken for the answer to the next request (RTU telegrams carry no number to tell them apart).
#pragma once

#include "hw/device_address.h"
#include "hw/register_plc.h"

#include <memory>

namespace fringecal::hw {

class ModbusPlc : public RegisterPlc {
 public:
  /// Opens the link. Throws PlcLost.
  explicit ModbusPlc(PlcAddress address, PlcLinkOptions options = {});
  ~ModbusPlc() override;
  void reopen() override;

 protected:
  void read_words(std::uint16_t first, std::span<std::uint16_t> words) override;
  void write_words(std::uint16_t first, std::span<const std::uint16_t> words) override;

 private:
  struct Link;
  [[noreturn]] void fail();
  void drain();

  PlcAddress address_;
  std::unique_ptr<Link> link_;
};

}  // namespace fringecal::hw

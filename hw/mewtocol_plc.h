// MewtocolPlc: the register map over MEWTOCOL-COM on a serial line (the paper's own PLC, a NAIS FP0).
//
// Longer blocks than a frame carries are split into several telegrams (hw/mewtocol.h (2)); the blocks of the register
// map fit into one, so a command and its sequence are never torn apart. After a time-out or a damaged answer the line
// is emptied before anything else is sent, since an answer carries nothing that tells which question it belongs to.
#pragma once

#include "hw/device_address.h"
#include "hw/register_plc.h"

#include <memory>
#include <string_view>

namespace fringecal::hw {

class SerialPort;

class MewtocolPlc : public RegisterPlc {
 public:
  /// Opens the line. Throws PlcLost.
  explicit MewtocolPlc(PlcAddress address, PlcLinkOptions options = {});
  ~MewtocolPlc() override;
  void reopen() override;

  /// One contact, as in "X0000" (hw/plc_map.md, "Contacts").
  bool read_contact(std::string_view contact);
  void write_contact(std::string_view contact, bool on);

 protected:
  void read_words(std::uint16_t first, std::span<std::uint16_t> words) override;
  void write_words(std::uint16_t first, std::span<const std::uint16_t> words) override;

 private:
  /// Sends a command; returns what the answer carries behind the two letters of the command.
  std::string ask(const std::string& command);

  PlcAddress address_;
  std::unique_ptr<SerialPort> port_;
};

}  // namespace fringecal::hw

#include "hw/virtual/mewtocol_server.h"

#include "hw/mewtocol.h"

#include <algorithm>
#include <cctype>
#include <optional>
#include <vector>

namespace fringecal::virt {
namespace {

using hw::mewtocol::Frame;
using hw::mewtocol::FrameKind;
using hw::mewtocol::MewtocolError;

constexpr const char* kBccError = "!40";
constexpr const char* kFormatError = "!41";
constexpr const char* kNotSupported = "!42";
constexpr const char* kBusy = "!53";
constexpr const char* kParameterError = "!60";
constexpr const char* kDataError = "!61";

std::string answer_registers(PlcCore& core, const std::string& command) {
  const bool reading = command.starts_with("RD");
  if (command.size() < 3 || command[2] != 'D') return kParameterError;
  if (command.size() < 13 ||
      !std::all_of(command.begin() + 3, command.begin() + 13, [](unsigned char c) { return std::isdigit(c) != 0; })) {
    return kDataError;
  }
  const int first = std::stoi(command.substr(3, 5)), last = std::stoi(command.substr(8, 5));
  const int count = last - first + 1;
  const auto most = static_cast<int>(reading ? hw::mewtocol::kMostWordsRead : hw::mewtocol::kMostWordsWritten);
  if (count < 1 || count > most || last > 65535) return kDataError;
  if (reading) {
    std::vector<std::uint16_t> words(static_cast<std::size_t>(count));
    if (command.size() != 13) return kFormatError;
    if (!core.read(static_cast<std::uint16_t>(first), words)) return kDataError;
    return "$RD" + hw::mewtocol::words_to_hex(words);
  }
  const auto words = hw::mewtocol::words_from_hex(std::string_view(command).substr(13));
  if (static_cast<int>(words.size()) != count) return kFormatError;
  if (!core.write(static_cast<std::uint16_t>(first), words)) return kDataError;
  return "$WD";
}

std::string answer_contact(PlcCore& core, const std::string& command) {
  const bool reading = command.starts_with("RCS");
  if (command.size() != (reading ? 8u : 9u)) return kFormatError;
  const std::string contact = command.substr(3, 5);
  if (reading) {
    const auto state = core.read_contact(contact);
    return state ? std::string("$RC") + (*state ? '1' : '0') : kParameterError;
  }
  if (command[8] != '0' && command[8] != '1') return kDataError;
  return core.write_contact(contact, command[8] == '1') ? "$WC" : kParameterError;
}

std::optional<ByteServer::Answer> answer_frame(PlcCore& core, int station, std::string& received) {
  const auto end = received.find('\r');
  if (end == std::string::npos) {
    if (received.size() > hw::mewtocol::kMostCharacters) received.clear();
    return std::nullopt;
  }
  const std::string bytes = received.substr(0, end + 1);
  received.erase(0, end + 1);
  Frame command;
  std::string answer;
  try {
    command = hw::mewtocol::decode(bytes);
    if (command.station != station || command.kind != FrameKind::command) return ByteServer::Answer{};
  } catch (const MewtocolError&) {
    // What is wrong decides the code: a well-formed head with another sum is damage on the line.
    answer = bytes.size() >= 7 && bytes[0] == '%' && bytes[3] == '#' ? kBccError : kFormatError;
  }
  const AnswerFault fault = core.next_answer();
  if (answer.empty()) answer = fault.refusal != 0 ? kBusy : answer_mewtocol(core, command.text);
  ByteServer::Answer out{.bytes = "", .delay = fault.delay};
  if (!fault.silent) {
    const auto kind = static_cast<FrameKind>(answer[0]);
    out.bytes = hw::mewtocol::encode({.station = station, .kind = kind, .text = answer.substr(1)});
  }
  return out;
}

}  // namespace

std::string answer_mewtocol(PlcCore& core, const std::string& command) {
  try {
    if (command.starts_with("RD") || command.starts_with("WD")) return answer_registers(core, command);
    if (command.starts_with("RCS") || command.starts_with("WCS")) return answer_contact(core, command);
  } catch (const MewtocolError&) {
    return kDataError;  // digits that are not hexadecimal
  }
  return kNotSupported;
}

std::unique_ptr<ByteServer> serve_mewtocol(PlcCore& core, int station, const std::string& link) {
  return ByteServer::on_pty(link,
                            [&core, station](std::string& received) { return answer_frame(core, station, received); });
}

}  // namespace fringecal::virt

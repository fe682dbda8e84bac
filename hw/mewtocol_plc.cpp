#include "hw/mewtocol_plc.h"

#include "hw/mewtocol.h"
#include "hw/serial_port.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

namespace fringecal::hw {

MewtocolPlc::MewtocolPlc(PlcAddress address, PlcLinkOptions options)
    : RegisterPlc("PLC at " + address.text, options), address_(std::move(address)) {
  reopen();
}

MewtocolPlc::~MewtocolPlc() = default;

void MewtocolPlc::reopen() {
  port_.reset();
  try {
    port_ = std::make_unique<SerialPort>(address_.line);
    port_->flush();
  } catch (const std::system_error& error) {
    port_.reset();
    throw PlcLost(fmt::format("{}: {}", name(), error.what()));
  }
}

std::string MewtocolPlc::ask(const std::string& command) {
  using namespace mewtocol;
  if (!port_) throw PlcLost("the line is closed");
  try {
    port_->write(encode({.station = address_.station, .kind = FrameKind::command, .text = command}));
    const auto bytes = port_->read_until('\r', kMostCharacters, options().answer_limit);
    if (!bytes) {
      port_->drain(options().answer_limit);
      throw PlcLate(fmt::format("no answer within {} ms", options().answer_limit.count()));
    }
    const Frame answer = decode(*bytes);
    if (answer.station != address_.station) {
      throw MewtocolError(fmt::format("an answer of station {} to a question to {}", answer.station, address_.station));
    }
    if (answer.kind == FrameKind::refusal) throw PlcFault("MEWTOCOL error " + refusal_words(answer.text));
    // The answer repeats the first two letters of the command (RD, WD, RC, WC).
    if (answer.kind != FrameKind::answer || !answer.text.starts_with(command.substr(0, 2))) {
      throw MewtocolError(fmt::format("'{}' as the answer to '{}'", answer.text, command));
    }
    return answer.text.substr(2);
  } catch (const MewtocolError& error) {
    port_->drain(options().answer_limit);
    throw PlcLate(fmt::format("the answer was {}", error.what()));
  } catch (const std::system_error& error) {
    port_.reset();
    throw PlcLost(error.what());
  }
}

void MewtocolPlc::read_words(std::uint16_t first, std::span<std::uint16_t> words) {
  for (std::size_t done = 0; done < words.size();) {
    const std::size_t count = std::min(words.size() - done, mewtocol::kMostWordsRead);
    const std::string hex = ask(mewtocol::read_registers(static_cast<int>(first + done), static_cast<int>(count)));
    std::vector<std::uint16_t> part;
    try {
      part = mewtocol::words_from_hex(hex);
    } catch (const mewtocol::MewtocolError& error) {
      throw PlcLate(fmt::format("the answer had {}", error.what()));
    }
    if (part.size() != count) throw PlcLate(fmt::format("{} words came where {} were asked for", part.size(), count));
    std::copy(part.begin(), part.end(), words.begin() + static_cast<std::ptrdiff_t>(done));
    done += count;
  }
}

void MewtocolPlc::write_words(std::uint16_t first, std::span<const std::uint16_t> words) {
  for (std::size_t done = 0; done < words.size();) {
    const std::size_t count = std::min(words.size() - done, mewtocol::kMostWordsWritten);
    ask(mewtocol::write_registers(static_cast<int>(first + done), words.subspan(done, count)));
    done += count;
  }
}

bool MewtocolPlc::read_contact(std::string_view contact) {
  const std::string state = ask(mewtocol::read_contact(contact));
  if (state != "0" && state != "1") throw PlcLost(fmt::format("{}: contact {} is '{}'", name(), contact, state));
  return state == "1";
}

void MewtocolPlc::write_contact(std::string_view contact, bool on) { ask(mewtocol::write_contact(contact, on)); }

}  // namespace fringecal::hw

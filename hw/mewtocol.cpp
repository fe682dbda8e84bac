#include "hw/mewtocol.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>

namespace fringecal::hw::mewtocol {
namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, 30> kRefusals = {{
    {"20", "undefined error"},
    {"21", "NACK: the remote unit did not understand"},
    {"22", "WACK: the receive buffer of the remote unit is full"},
    {"23", "the station number is used twice"},
    {"24", "transmission format error"},
    {"25", "hardware of the link unit"},
    {"26", "the station number is set outside its range"},
    {"27", "the frame has more than 118 characters"},
    {"28", "no response from the remote unit"},
    {"29", "the transmit buffer is full"},
    {"30", "time-out at the remote unit"},
    {"40", "BCC error: the frame was damaged on the line"},
    {"41", "format error: the frame is not built as the protocol asks"},
    {"42", "this command is not supported"},
    {"43", "procedure error: an answer in several frames is pending"},
    {"45", "operation error: registers outside the range"},
    {"50", "link setting error"},
    {"51", "time-out while sending to another unit"},
    {"52", "sending is disabled"},
    {"53", "busy with another command"},
    {"60", "parameter error: unknown data or contact code"},
    {"61", "data error: wrong register numbers or digits"},
    {"62", "too many registrations, or none"},
    {"63", "the PLC's mode (RUN or PROG) does not allow this"},
    {"64", "external memory failure"},
    {"65", "protected: the program or memory is write-protected"},
    {"66", "address error: too many words or wrong digits of an address"},
    {"67", "there is no program or no data"},
    {"68", "cannot be changed in RUN"},
    {"71", "another user has exclusive access"},
}};

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  throw MewtocolError(fmt::format("'{}' is not an upper-case hexadecimal digit", c));
}

void check_contact(std::string_view contact) {
  require(contact.size() == 5 && (contact[0] == 'X' || contact[0] == 'Y' || contact[0] == 'R'),
          "a contact is X, Y or R with three decimal digits and one hexadecimal digit");
}

}  // namespace

std::string bcc(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum ^= static_cast<unsigned char>(c);  // (1)
  return fmt::format("{:02X}", sum);
}

std::string encode(const Frame& frame) {
  require(frame.station >= 1 && frame.station <= 99, "a MEWTOCOL station has a number from 1 to 99");
  const std::string text = fmt::format("%{:02}{}{}", frame.station, static_cast<char>(frame.kind), frame.text);
  std::string bytes = text + bcc(text) + "\r";
  require(bytes.size() <= kMostCharacters, "a MEWTOCOL frame has at most 118 characters");
  return bytes;
}

Frame decode(std::string_view bytes) {
  if (bytes.ends_with('\r')) bytes.remove_suffix(1);
  if (bytes.size() + 1 > kMostCharacters) {
    throw MewtocolError(fmt::format("a frame of {} characters, more than 118", bytes.size() + 1));
  }
  if (bytes.size() < 6) throw MewtocolError(fmt::format("a frame of {} characters, too short for any", bytes.size()));
  if (bytes[0] != '%') throw MewtocolError(fmt::format("a frame that begins with '{}' instead of '%'", bytes[0]));
  const std::string_view sent = bytes.substr(bytes.size() - 2);
  bytes.remove_suffix(2);
  if (const std::string expected = bcc(bytes); sent != "**" && sent != expected) {
    throw MewtocolError(fmt::format("a frame with BCC {} where {} is right", sent, expected));
  }
  Frame frame;
  const auto [end, error] = std::from_chars(bytes.data() + 1, bytes.data() + 3, frame.station);
  if (error != std::errc() || end != bytes.data() + 3) {
    throw MewtocolError(fmt::format("a frame for the station '{}'", bytes.substr(1, 2)));
  }
  frame.kind = static_cast<FrameKind>(bytes[3]);
  if (frame.kind != FrameKind::command && frame.kind != FrameKind::answer && frame.kind != FrameKind::refusal) {
    throw MewtocolError(fmt::format("a frame with '{}' where #, $ or ! must stand", bytes[3]));
  }
  frame.text = bytes.substr(4);
  return frame;
}

std::string words_to_hex(std::span<const std::uint16_t> words) {
  std::string out;
  for (const unsigned w : words) out += fmt::format("{:02X}{:02X}", w & 0xFFu, w >> 8);
  return out;
}

std::vector<std::uint16_t> words_from_hex(std::string_view hex) {
  if (hex.size() % 4 != 0) throw MewtocolError(fmt::format("{} hexadecimal digits, not four per word", hex.size()));
  std::vector<std::uint16_t> words;
  for (std::size_t k = 0; k < hex.size(); k += 4) {
    const int low = 16 * hex_digit(hex[k]) + hex_digit(hex[k + 1]);
    const int high = 16 * hex_digit(hex[k + 2]) + hex_digit(hex[k + 3]);
    words.push_back(static_cast<std::uint16_t>(high << 8 | low));
  }
  return words;
}

std::string read_registers(int first, int count) {
  require(first >= 0 && count >= 1 && count <= static_cast<int>(kMostWordsRead) && first + count <= 100000,
          "RD reads 1 to 27 words");
  return fmt::format("RDD{:05}{:05}", first, first + count - 1);
}

std::string write_registers(int first, std::span<const std::uint16_t> words) {
  const int count = static_cast<int>(words.size());
  require(first >= 0 && count >= 1 && count <= static_cast<int>(kMostWordsWritten) && first + count <= 100000,
          "WD writes 1 to 24 words");
  return fmt::format("WDD{:05}{:05}{}", first, first + count - 1, words_to_hex(words));
}

std::string read_contact(std::string_view contact) {
  check_contact(contact);
  return fmt::format("RCS{}", contact);
}

std::string write_contact(std::string_view contact, bool on) {
  check_contact(contact);
  return fmt::format("WCS{}{}", contact, on ? '1' : '0');
}

std::string refusal_words(std::string_view code) {
  const auto known = std::find_if(kRefusals.begin(), kRefusals.end(), [&](const auto& r) { return r.first == code; });
  return fmt::format("{} ({})", code, known == kRefusals.end() ? "a code the protocol does not list" : known->second);
}

}  // namespace fringecal::hw::mewtocol

// MEWTOCOL-COM, the ASCII protocol of Panasonic/NAIS PLCs (FP0: RS-232), as pure text in and text out.
//
//   command   % station # text BCC CR      station: two decimal digits
//   answer    % station $ text BCC CR
//   refusal   % station ! code BCC CR      code: two hexadecimal digits
//   BCC = XOR of all characters from % to the last of the text, two upper-case hexadecimal digits              (1)
//
// Commands used: RD (read data registers) and WD (write them), `D` + first and last register with five decimal digits
// each, a word as four hexadecimal digits *low byte first* (0x0064 is "6400"); RCS and WCS (read, write one contact),
// letter + three decimal digits + one hexadecimal digit (X000A). A frame has at most 118 characters with its CR, hence
//   RD: 6 + 4 n + 3 <= 118  ->  n <= 27 words,    WD: 6 + 11 + 4 n + 3 <= 118  ->  n <= 24 words                (2)
// Source: [MEWTOCOL], frame format and error codes.
// Texts that break the frame's rules throw MewtocolError with the reason.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::hw::mewtocol {

inline constexpr std::size_t kMostCharacters = 118;
inline constexpr std::size_t kMostWordsRead = 27, kMostWordsWritten = 24;  // (2)

struct MewtocolError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// (1)
std::string bcc(std::string_view text);

enum class FrameKind : char { command = '#', answer = '$', refusal = '!' };

struct Frame {
  int station = 1;
  FrameKind kind = FrameKind::command;
  std::string text;  // "RDD0110501107", "RD6300...", or the code of a refusal
};

/// With BCC and CR.
std::string encode(const Frame& frame);
/// One complete frame, with or without its CR. "**" in place of the BCC is accepted, as the PLCs do.
Frame decode(std::string_view bytes);

std::string words_to_hex(std::span<const std::uint16_t> words);
std::vector<std::uint16_t> words_from_hex(std::string_view hex);

/// Texts of the commands.
std::string read_registers(int first, int count);
std::string write_registers(int first, std::span<const std::uint16_t> words);
std::string read_contact(std::string_view contact);
std::string write_contact(std::string_view contact, bool on);

/// What a refusal means: "40 (BCC error: the frame was damaged on the line)".
std::string refusal_words(std::string_view code);

}  // namespace fringecal::hw::mewtocol

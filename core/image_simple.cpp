// BMP (8-bit palette, 24 and 32 bit, uncompressed) and PGM (P2, P5): formats small enough to be read by hand.
#include "core/image_codecs.h"

#include <fmt/format.h>

#include <array>
#include <cctype>
#include <cstring>

namespace fringecal::codecs {
namespace {

std::uint32_t little(std::string_view bytes, std::size_t at, int count) {
  std::uint32_t out = 0;
  for (int k = 0; k < count; ++k) {
    out |= static_cast<std::uint32_t>(static_cast<std::uint8_t>(bytes[at + static_cast<std::size_t>(k)])) << (8 * k);
  }
  return out;
}

[[noreturn]] void fail_truncated(const char* kind, std::uint64_t needed, std::size_t found) {
  throw ImageDefect{fmt::format("the {} is truncated: {} bytes are needed and {} are there; copy or capture it again",
                                kind, needed, found)};
}

/// The header of a PGM: numbers between white space and '#' comments.
class PgmText {
 public:
  explicit PgmText(std::string_view bytes) : bytes_(bytes) {}

  std::uint32_t number(const char* what) {
    skip_space();
    if (at_ >= bytes_.size()) {
      throw ImageDefect{fmt::format("the PGM ends before {}; copy or capture it again", what)};
    }
    if (!std::isdigit(static_cast<unsigned char>(bytes_[at_]))) {
      throw ImageDefect{
          fmt::format("the PGM has something that is no number where {} should stand (byte {}); copy or "
                      "capture it again",
                      what, at_)};
    }
    std::uint32_t value = 0;
    for (; at_ < bytes_.size() && std::isdigit(static_cast<unsigned char>(bytes_[at_])); ++at_) {
      if (value < 400'000'000) value = 10 * value + static_cast<std::uint32_t>(bytes_[at_] - '0');
    }
    return value;
  }
  std::size_t at() const { return at_; }

 private:
  void skip_space() {
    while (at_ < bytes_.size()) {
      if (bytes_[at_] == '#') {
        while (at_ < bytes_.size() && bytes_[at_] != '\n') ++at_;
      } else if (std::isspace(static_cast<unsigned char>(bytes_[at_]))) {
        ++at_;
      } else {
        return;
      }
    }
  }

  std::string_view bytes_;
  std::size_t at_ = 2;
};

template <class T>
std::vector<T> pgm_values(std::string_view bytes, PgmText& text, std::size_t count, std::uint32_t max_value) {
  std::vector<T> out(count);
  if (bytes[1] == '2') {
    for (T& value : out) {
      const std::uint32_t v = text.number("a pixel");
      if (v > max_value)
        throw ImageDefect{
            fmt::format("the PGM has a value of {} above its maximum of {}; write it again", v, max_value)};
      value = static_cast<T>(v);
    }
    return out;
  }
  const std::size_t start = text.at() + 1;  // exactly one white-space byte after the maximum
  const std::uint64_t needed = start + static_cast<std::uint64_t>(count) * sizeof(T);
  if (bytes.size() < needed) fail_truncated("PGM", needed, bytes.size());
  const auto* in = reinterpret_cast<const std::uint8_t*>(bytes.data()) + start;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t v = in[i];
    if constexpr (sizeof(T) == 2) v = static_cast<std::uint32_t>(in[2 * i]) << 8 | in[2 * i + 1];  // big-endian
    if (v > max_value)
      throw ImageDefect{fmt::format("the PGM has a value of {} above its maximum of {}; write it again", v, max_value)};
    out[i] = static_cast<T>(v);
  }
  return out;
}

}  // namespace

bool is_bmp(std::string_view bytes) { return bytes.starts_with("BM"); }

Samples decode_bmp(std::string_view bytes) {
  constexpr std::size_t kHeader = 54;  // file header 14, BITMAPINFOHEADER 40
  if (bytes.size() < kHeader) fail_truncated("BMP", kHeader, bytes.size());
  const std::uint32_t pixels_at = little(bytes, 10, 4), info_size = little(bytes, 14, 4);
  if (info_size < 40) throw ImageDefect{"the BMP has an OS/2 header; save it as a Windows BMP or as PNG"};
  const auto width = static_cast<std::int32_t>(little(bytes, 18, 4));
  const auto stored_height = static_cast<std::int32_t>(little(bytes, 22, 4));
  const bool top_down = stored_height < 0;
  const std::int64_t height = top_down ? -static_cast<std::int64_t>(stored_height) : stored_height;
  const std::uint32_t bits = little(bytes, 28, 2), compression = little(bytes, 30, 4);
  if (compression != 0) throw ImageDefect{"the BMP is compressed; save it uncompressed or as PNG"};
  if (bits != 8 && bits != 24 && bits != 32) {
    throw ImageDefect{fmt::format(
        "the BMP has {} bits per pixel; 8, 24 and 32 can be read, save it as one of these or as PNG", bits)};
  }
  const std::uint32_t pixel_bytes = bits / 8;
  check_plausible(width, height, pixel_bytes, bytes.size(), 1);
  const std::uint64_t stride = (static_cast<std::uint64_t>(width) * pixel_bytes + 3) / 4 * 4;  // rows end on 4 bytes
  const std::uint64_t needed = pixels_at + stride * static_cast<std::uint64_t>(height);
  if (bytes.size() < needed) fail_truncated("BMP", needed, bytes.size());

  std::array<std::array<std::uint8_t, 3>, 256> palette{};  // red, green, blue
  if (bits == 8) {
    const std::uint32_t stated = little(bytes, 46, 4),
                        colours = stated == 0 ? 256 : std::min<std::uint32_t>(stated, 256);
    const std::uint64_t palette_at = 14ull + info_size;
    if (bytes.size() < palette_at + 4ull * colours) fail_truncated("BMP", palette_at + 4ull * colours, bytes.size());
    for (std::uint32_t c = 0; c < colours; ++c) {
      for (std::size_t k = 0; k < 3; ++k) palette[c][k] = static_cast<std::uint8_t>(bytes[palette_at + 4 * c + 2 - k]);
    }
  }
  Samples out{.width = width, .height = static_cast<int>(height), .channels = 3, .values = {}};
  std::vector<std::uint8_t> values(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 3);
  for (std::int64_t y = 0; y < height; ++y) {
    const std::uint64_t stored_row = static_cast<std::uint64_t>(top_down ? y : height - 1 - y);
    const auto* in = reinterpret_cast<const std::uint8_t*>(bytes.data()) + pixels_at + stored_row * stride;
    std::uint8_t* row = values.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width) * 3;
    for (std::int32_t x = 0; x < width; ++x, in += pixel_bytes, row += 3) {
      for (std::size_t k = 0; k < 3; ++k) row[k] = bits == 8 ? palette[*in][k] : in[2 - k];
    }
  }
  out.values = std::move(values);
  return out;
}

bool is_pgm(std::string_view bytes) {
  return (bytes.starts_with("P2") || bytes.starts_with("P5")) && bytes.size() > 2 &&
         (std::isspace(static_cast<unsigned char>(bytes[2])) || bytes[2] == '#');
}

Samples decode_pgm(std::string_view bytes) {
  PgmText text(bytes);
  const std::uint32_t width = text.number("the width"), height = text.number("the height");
  const std::uint32_t max_value = text.number("the maximum value");
  if (max_value == 0 || max_value > 65535) {
    throw ImageDefect{
        fmt::format("the PGM states a maximum value of {}; 1 to 65535 is possible, write it again", max_value)};
  }
  const bool wide = max_value > 255;
  check_plausible(width, height, bytes[1] == '5' && wide ? 2 : 1, bytes.size(), 1);
  Samples out{.width = static_cast<int>(width), .height = static_cast<int>(height), .channels = 1, .values = {}};
  const std::size_t count = static_cast<std::size_t>(width) * height;
  if (wide) {
    out.values = pgm_values<std::uint16_t>(bytes, text, count, max_value);
  } else {
    out.values = pgm_values<std::uint8_t>(bytes, text, count, max_value);
  }
  return out;
}

}  // namespace fringecal::codecs

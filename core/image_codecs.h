// The file formats behind core/image_file.h, one .cpp each. Private to core: everybody else reads and writes images
// through image_file.h.
//
// A decoder takes the bytes of a whole file and gives the samples as they stand, interleaved, or throws ImageDefect:
// what is wrong, as the rest of a sentence that begins with the file's name. Headers are not believed: no decoder
// allocates more than kMaxPixels samples per channel, nor more than the file's size can expand to (kMaxExpansion).
#pragma once

#include "core/image.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace fringecal::codecs {

struct ImageDefect {
  std::string sentence;
};

struct Samples {
  int width = 0, height = 0;
  int channels = 1;  // 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha
  std::variant<std::vector<std::uint8_t>, std::vector<std::uint16_t>> values;
};

/// 2^28: above the largest industrial area sensors (about 150 megapixels, 2^27.2).
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 28;
/// Deflate expands at most 1032 : 1 (a 258-byte match in 2 bits); LZW with 12-bit codes stays below 2800 : 1.
constexpr std::int64_t kMaxExpansion = 2800;

/// Throws ImageDefect unless a file of `file_size` bytes can hold such an image.
void check_plausible(std::int64_t width, std::int64_t height, std::int64_t bytes_per_pixel, std::size_t file_size,
                     std::int64_t max_expansion);

bool is_png(std::string_view bytes);
bool is_tiff(std::string_view bytes);
bool is_bmp(std::string_view bytes);
bool is_pgm(std::string_view bytes);

Samples decode_png(std::string_view bytes);
Samples decode_tiff(std::string_view bytes);
Samples decode_bmp(std::string_view bytes);
Samples decode_pgm(std::string_view bytes);

}  // namespace fringecal::codecs

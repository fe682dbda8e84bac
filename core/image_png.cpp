#include "core/image_codecs.h"
#include "core/image_file.h"

#include <fmt/format.h>
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <csetjmp>
#include <cstdlib>
#include <cstring>

namespace fringecal {
namespace {

/// What libpng's callbacks see. libpng reports errors by longjmp, which must not cross a living C++ object: all of them
/// are owned by the functions that call `guarded`.
struct Reading {
  std::string_view bytes;
  std::size_t at = 0;
  bool ran_out = false;
  std::uint32_t rows_done = 0;
  std::array<char, 120> error{};
};

void keep_message(std::array<char, 120>& to, const char* message) { std::strncpy(to.data(), message, to.size() - 1); }

void read_some(png_structp png, png_bytep out, std::size_t count) {
  auto& reading = *static_cast<Reading*>(png_get_io_ptr(png));
  if (count > reading.bytes.size() - reading.at) {
    reading.ran_out = true;
    png_error(png, "end of file");
  }
  std::memcpy(out, reading.bytes.data() + reading.at, count);
  reading.at += count;
}

[[noreturn]] void on_read_error(png_structp png, const char* message) {
  keep_message(static_cast<Reading*>(png_get_error_ptr(png))->error, message);
  png_longjmp(png, 1);
}
void on_row(png_structp png, png_uint_32, int) { ++static_cast<Reading*>(png_get_io_ptr(png))->rows_done; }
void on_warning(png_structp, const char*) {}  // about ancillary chunks, which carry no pixel

/// Runs one step with libpng's error jump caught; false after an error. `step` must own nothing that has a destructor.
template <class Step>
bool guarded(png_structp png, const Step& step) {
  if (setjmp(png_jmpbuf(png))) return false;
  step();
  return true;
}

[[noreturn]] void fail_reading(const Reading& reading, std::uint32_t height) {
  if (reading.ran_out) {
    throw codecs::ImageDefect{
        height == 0 ? fmt::format("the PNG ends inside its header, after {} bytes; copy or capture it again",
                                  reading.bytes.size())
                    : fmt::format("the PNG is truncated: it ends after {} bytes, in row {} of {}; copy or capture it "
                                  "again",
                                  reading.bytes.size(), std::min(reading.rows_done, height), height)};
  }
  throw codecs::ImageDefect{fmt::format("the PNG is damaged ({}); copy or capture it again", reading.error.data())};
}

struct PngRead {
  png_structp png = nullptr;
  png_infop info = nullptr;
  explicit PngRead(Reading& reading) {
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reading, on_read_error, on_warning);
    if (png) info = png_create_info_struct(png);
    if (!info) throw std::bad_alloc();
  }
  ~PngRead() { png_destroy_read_struct(&png, &info, nullptr); }
  PngRead(const PngRead&) = delete;
  PngRead& operator=(const PngRead&) = delete;
};

template <class T>
std::vector<T> read_rows(PngRead& file, Reading& reading, std::size_t row_samples, std::uint32_t height) {
  std::vector<T> values(row_samples * height);
  std::vector<png_bytep> rows(height);
  for (std::uint32_t y = 0; y < height; ++y) rows[y] = reinterpret_cast<png_bytep>(values.data() + y * row_samples);
  const bool done = guarded(file.png, [&] {
    png_read_image(file.png, rows.data());
    png_read_end(file.png, nullptr);
  });
  if (!done) fail_reading(reading, height);
  return values;
}

}  // namespace

namespace codecs {

bool is_png(std::string_view bytes) { return bytes.starts_with(std::string_view("\x89PNG\r\n\x1a\n", 8)); }

Samples decode_png(std::string_view bytes) {
  Reading reading{.bytes = bytes};
  PngRead file(reading);
  png_uint_32 width = 0, height = 0;
  int depth = 0, colour = 0;
  const bool header = guarded(file.png, [&] {
    png_set_read_fn(file.png, &reading, read_some);
    png_set_read_status_fn(file.png, on_row);
    png_set_user_limits(file.png, 0x7fffffff, 0x7fffffff);  // check_plausible decides
    png_read_info(file.png, file.info);
    png_get_IHDR(file.png, file.info, &width, &height, &depth, &colour, nullptr, nullptr, nullptr);
  });
  if (!header) fail_reading(reading, 0);
  check_plausible(width, height, 1, bytes.size(), 1032 * 8);  // 1032 : 1 of deflate, 8 pixels per byte at 1 bit
  int channels = 0;
  const bool set_up = guarded(file.png, [&] {
    if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(file.png);
    if (colour == PNG_COLOR_TYPE_GRAY && depth < 8) png_set_expand_gray_1_2_4_to_8(file.png);
    if (png_get_valid(file.png, file.info, PNG_INFO_tRNS)) png_set_tRNS_to_alpha(file.png);
    if (depth == 16) png_set_swap(file.png);  // a PNG is big-endian
    png_set_interlace_handling(file.png);
    png_read_update_info(file.png, file.info);
    channels = png_get_channels(file.png, file.info);
  });
  if (!set_up) fail_reading(reading, 0);
  Samples out{.width = static_cast<int>(width), .height = static_cast<int>(height), .channels = channels, .values = {}};
  const std::size_t row_samples = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels);
  if (depth == 16) {
    out.values = read_rows<std::uint16_t>(file, reading, row_samples, height);
  } else {
    out.values = read_rows<std::uint8_t>(file, reading, row_samples, height);
  }
  return out;
}

}  // namespace codecs

namespace {

struct Writing {
  std::string bytes;
  std::array<char, 120> error{};
};

void write_some(png_structp png, png_bytep data, std::size_t count) {
  static_cast<Writing*>(png_get_io_ptr(png))->bytes.append(reinterpret_cast<const char*>(data), count);
}
void flush_nothing(png_structp) {}
[[noreturn]] void on_write_error(png_structp png, const char* message) {
  keep_message(static_cast<Writing*>(png_get_error_ptr(png))->error, message);
  png_longjmp(png, 1);
}

struct PngLayout {
  int width = 0, height = 0;
  int depth = 8;
  int colour = PNG_COLOR_TYPE_GRAY;
  int filter = PNG_FILTER_SUB;
  int strategy = Z_DEFAULT_STRATEGY;
  int level = 6;
};

std::string write_png(const PngLayout& layout, const std::uint8_t* pixels, std::size_t row_bytes) {
  require(layout.width > 0 && layout.height > 0, "an image that is written has pixels");
  Writing writing;
  writing.bytes.reserve(row_bytes * static_cast<std::size_t>(layout.height) / 2 + 4096);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &writing, on_write_error, on_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  if (!info) throw std::bad_alloc();
  const bool done = guarded(png, [&] {
    png_set_write_fn(png, &writing, write_some, flush_nothing);
    png_set_IHDR(png, info, static_cast<png_uint_32>(layout.width), static_cast<png_uint_32>(layout.height),
                 layout.depth, layout.colour, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png, layout.level);
    png_set_compression_strategy(png, layout.strategy);
    png_set_compression_buffer_size(png, 1 << 18);
    png_set_filter(png, PNG_FILTER_TYPE_BASE, layout.filter);
    png_write_info(png, info);
    if (layout.depth == 16) png_set_swap(png);
    for (int y = 0; y < layout.height; ++y) png_write_row(png, pixels + static_cast<std::size_t>(y) * row_bytes);
    png_write_end(png, info);
  });
  png_destroy_write_struct(&png, &info);
  require(done, "libpng writes an image of valid size into memory");
  return std::move(writing.bytes);
}

}  // namespace

/// The filter for a grey frame: differences along the direction in which it changes less. Fringes along the columns
/// halve the file with differences between rows (482 kB against 1014 kB for a 1392 x 1040 frame with one grey level of
/// noise).
template <class T>
int calmer_filter(const Image<T>& image) {
  std::int64_t along_rows = 0, along_columns = 0;
  for (int y = 8; y < image.height(); y += 16) {
    for (int x = 1; x < image.width(); ++x) {
      along_rows += std::abs(image(x, y) - image(x - 1, y));
      along_columns += std::abs(image(x, y) - image(x, y - 1));
    }
  }
  return along_columns < along_rows ? PNG_FILTER_UP : PNG_FILTER_SUB;
}

std::string encode_png(const GrayImage& image) {
  return std::visit(
      [](const auto& i) {
        using T = typename std::decay_t<decltype(i.values())>::value_type;
        // Huffman codes alone: the noise of a camera leaves no repeats to find. Of the settings tried (three filters,
        // four strategies) this is the fastest, 11 to 15 ms a frame; matches gain 15 % of size at best and cost twice
        // the time.
        const PngLayout layout{.width = i.width(),
                               .height = i.height(),
                               .depth = 8 * static_cast<int>(sizeof(T)),
                               .filter = calmer_filter(i),
                               .strategy = Z_HUFFMAN_ONLY,
                               .level = 1};
        return write_png(layout, reinterpret_cast<const std::uint8_t*>(i.data()),
                         static_cast<std::size_t>(i.width()) * sizeof(T));
      },
      image);
}

std::string encode_png(const Image<Rgb>& image) {
  const PngLayout layout{.width = image.width(),
                         .height = image.height(),
                         .colour = PNG_COLOR_TYPE_RGB,
                         .strategy = Z_FILTERED,
                         .level = 4};
  return write_png(layout, reinterpret_cast<const std::uint8_t*>(image.data()),
                   static_cast<std::size_t>(image.width()) * 3);
}

}  // namespace fringecal

#include "core/file.h"
#include "core/image_codecs.h"
#include "core/image_file.h"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>

namespace fringecal {
namespace {

/// A file in memory, for reading or writing, as libtiff wants to see one.
struct Memory {
  std::string_view in;         // when reading
  std::string* out = nullptr;  // when writing
  std::uint64_t at = 0;
  std::string error;  // libtiff's first complaint

  std::uint64_t size() const { return out ? out->size() : in.size(); }
};

tmsize_t read_some(thandle_t handle, void* to, tmsize_t count) {
  auto& m = *static_cast<Memory*>(handle);
  const std::string_view all = m.out ? std::string_view(*m.out) : m.in;
  if (m.at >= all.size()) return 0;
  const auto n = std::min<std::uint64_t>(static_cast<std::uint64_t>(count), all.size() - m.at);
  std::memcpy(to, all.data() + m.at, n);
  m.at += n;
  return static_cast<tmsize_t>(n);
}
tmsize_t write_some(thandle_t handle, void* from, tmsize_t count) {
  auto& m = *static_cast<Memory*>(handle);
  if (!m.out) return 0;
  if (m.out->size() < m.at + static_cast<std::uint64_t>(count)) m.out->resize(m.at + static_cast<std::uint64_t>(count));
  std::memcpy(m.out->data() + m.at, from, static_cast<std::size_t>(count));
  m.at += static_cast<std::uint64_t>(count);
  return count;
}
toff_t seek(thandle_t handle, toff_t offset, int whence) {
  auto& m = *static_cast<Memory*>(handle);
  m.at = (whence == SEEK_SET ? 0 : whence == SEEK_CUR ? m.at : m.size()) + offset;
  return m.at;
}
int close_nothing(thandle_t) { return 0; }
toff_t size_of(thandle_t handle) { return static_cast<Memory*>(handle)->size(); }

int on_error(TIFF*, void* user, const char*, const char* format, va_list arguments) {
  auto& m = *static_cast<Memory*>(user);
  std::array<char, 200> text{};
  std::vsnprintf(text.data(), text.size(), format, arguments);
  if (m.error.empty()) m.error = text.data();
  return 1;
}
int on_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffHandle = std::unique_ptr<TIFF, CloseTiff>;

TiffHandle open(Memory& memory, const char* mode) {
  const std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)> options(TIFFOpenOptionsAlloc(),
                                                                             TIFFOpenOptionsFree);
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), on_error, &memory);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), on_warning, &memory);
  // "m": no memory mapping, there is nothing to map.
  return TiffHandle(TIFFClientOpenExt("memory", (std::string(mode) + "m").c_str(), &memory, read_some, write_some, seek,
                                      close_nothing, size_of, nullptr, nullptr, options.get()));
}

struct TiffLayout {
  std::uint32_t width = 0, height = 0;
  std::uint16_t bits = 1, channels = 1, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_MINISBLACK;
  std::uint16_t planes = PLANARCONFIG_CONTIG;
};

[[noreturn]] void fail_damaged(const Memory& memory) {
  throw codecs::ImageDefect{fmt::format("the TIFF is truncated or damaged ({}); copy or capture it again",
                                        memory.error.empty() ? "unreadable directory" : memory.error)};
}

TiffLayout layout_of(TIFF* tiff, const Memory& memory) {
  TiffLayout l;
  if (!TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &l.width) || !TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &l.height)) {
    fail_damaged(memory);
  }
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &l.bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &l.channels);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &l.format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &l.planes);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &l.photometric);
  if (TIFFIsTiled(tiff)) throw codecs::ImageDefect{"the TIFF is stored in tiles; save it in strips, or as PNG"};
  codecs::check_plausible(l.width, l.height, 1, memory.in.size(), codecs::kMaxExpansion);
  return l;
}

template <class T>
std::vector<T> read_rows(TIFF* tiff, const Memory& memory, const TiffLayout& l) {
  const std::size_t row = static_cast<std::size_t>(l.width) * l.channels;
  if (TIFFScanlineSize64(tiff) != row * sizeof(T)) fail_damaged(memory);
  std::vector<T> values(row * l.height);
  for (std::uint32_t y = 0; y < l.height; ++y) {
    if (TIFFReadScanline(tiff, values.data() + y * row, y, 0) != 1) {
      throw codecs::ImageDefect{
          fmt::format("the TIFF is truncated or damaged at row {} of {} ({}); copy or capture it again", y, l.height,
                      memory.error)};
    }
  }
  return values;
}

}  // namespace

namespace codecs {

bool is_tiff(std::string_view bytes) {
  using namespace std::string_view_literals;
  return bytes.starts_with("II*\0"sv) || bytes.starts_with("MM\0*"sv) || bytes.starts_with("II+\0"sv) ||
         bytes.starts_with("MM\0+"sv);
}

Samples decode_tiff(std::string_view bytes) {
  Memory memory{.in = bytes, .error = {}};
  const TiffHandle tiff = open(memory, "r");
  if (!tiff) fail_damaged(memory);
  const TiffLayout l = layout_of(tiff.get(), memory);
  if (l.format != SAMPLEFORMAT_UINT || (l.bits != 8 && l.bits != 16)) {
    throw ImageDefect{
        fmt::format("the TIFF has {}-bit {} samples; 8 and 16 bit unsigned can be read, save it as one of "
                    "these",
                    l.bits, l.format == SAMPLEFORMAT_IEEEFP ? "floating-point" : "integer")};
  }
  const bool gray = l.photometric == PHOTOMETRIC_MINISBLACK && l.channels <= 2;
  const bool rgb = l.photometric == PHOTOMETRIC_RGB && (l.channels == 3 || l.channels == 4);
  if ((!gray && !rgb) || (l.planes != PLANARCONFIG_CONTIG && l.channels > 1)) {
    throw ImageDefect{
        fmt::format("the TIFF has an unusual layout (photometric {}, {} channels); save it as a plain grey "
                    "TIFF or as PNG",
                    l.photometric, l.channels)};
  }
  Samples out{
      .width = static_cast<int>(l.width), .height = static_cast<int>(l.height), .channels = l.channels, .values = {}};
  if (l.bits == 16) {
    out.values = read_rows<std::uint16_t>(tiff.get(), memory, l);
  } else {
    out.values = read_rows<std::uint8_t>(tiff.get(), memory, l);
  }
  return out;
}

}  // namespace codecs

std::string encode_tiff(const Image<float>& image) {
  require(!image.empty(), "an image that is written has pixels");
  std::string bytes;
  Memory memory{.in = {}, .out = &bytes, .error = {}};
  {
    const TiffHandle tiff = open(memory, "w");
    require(tiff != nullptr, "libtiff opens a file in memory");
    TIFF* t = tiff.get();
    TIFFSetField(t, TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(image.width()));
    TIFFSetField(t, TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(image.height()));
    TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, 32);
    TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(t, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
    TIFFSetField(t, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(t, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
    TIFFSetField(t, TIFFTAG_PREDICTOR, PREDICTOR_FLOATINGPOINT);
    TIFFSetField(t, TIFFTAG_ZIPQUALITY, 1);
    TIFFSetField(t, TIFFTAG_ROWSPERSTRIP,
                 static_cast<std::uint32_t>(std::max(1, (1 << 18) / image.width())));  // about 1 MB
    std::vector<float> row(static_cast<std::size_t>(image.width()));                   // the predictor works in place
    for (int y = 0; y < image.height(); ++y) {
      std::copy(image.row(y).begin(), image.row(y).end(), row.begin());
      require(TIFFWriteScanline(t, row.data(), static_cast<std::uint32_t>(y), 0) == 1,
              "libtiff writes a row into memory");
    }
  }
  require(memory.error.empty(), "libtiff writes an image into memory");
  return bytes;
}

Image<float> read_float_tiff(const std::filesystem::path& file) {
  const std::string bytes = read_bytes(file);
  try {
    if (!codecs::is_tiff(bytes)) throw codecs::ImageDefect{"this is not a TIFF; give a 32-bit float TIFF"};
    Memory memory{.in = bytes, .error = {}};
    const TiffHandle tiff = open(memory, "r");
    if (!tiff) fail_damaged(memory);
    const TiffLayout l = layout_of(tiff.get(), memory);
    if (l.format != SAMPLEFORMAT_IEEEFP || l.bits != 32 || l.channels != 1) {
      throw codecs::ImageDefect{fmt::format(
          "the TIFF has {} channels of {} bits; one channel of 32-bit float is needed", l.channels, l.bits)};
    }
    Image<float> out;
    out = Image<float>(static_cast<int>(l.width), static_cast<int>(l.height));
    out.values() = read_rows<float>(tiff.get(), memory, l);
    return out;
  } catch (const codecs::ImageDefect& defect) {
    throw InputError(fmt::format("{}: {}", file.string(), defect.sentence));
  }
}

}  // namespace fringecal

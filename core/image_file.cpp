#include "core/image_file.h"

#include "core/file.h"
#include "core/image_codecs.h"

#include <fmt/format.h>

#include <limits>

namespace fringecal {
namespace codecs {

void check_plausible(std::int64_t width, std::int64_t height, std::int64_t bytes_per_pixel, std::size_t file_size,
                     std::int64_t max_expansion) {
  if (width <= 0 || height <= 0 || width > kMaxPixels || height > kMaxPixels || width > kMaxPixels / height) {
    throw ImageDefect{
        fmt::format("its header says {} x {} pixels, which no camera delivers; the file is damaged, copy "
                    "it again",
                    width, height)};
  }
  if (width * height * bytes_per_pixel / max_expansion > static_cast<std::int64_t>(file_size)) {
    throw ImageDefect{
        fmt::format("its header says {} x {} pixels, more than its {} bytes can hold; the file is "
                    "truncated or damaged, copy it again",
                    width, height, file_size)};
  }
}

}  // namespace codecs

namespace {

/// The grey image in the samples; colour whose channels are equal everywhere is grey, and an alpha that is opaque
/// everywhere says nothing.
template <class T>
Image<T> gray_from(const codecs::Samples& samples, const std::vector<T>& values) {
  Image<T> out(samples.width, samples.height);
  const int channels = samples.channels;
  if (channels == 1) {
    out.values() = values;
    return out;
  }
  constexpr T kOpaque = std::numeric_limits<T>::max();
  const bool colour = channels >= 3, alpha = channels % 2 == 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const T* p = values.data() + i * static_cast<std::size_t>(channels);
    const auto place = [&] {
      return fmt::format("({}, {})", i % static_cast<std::size_t>(samples.width),
                         i / static_cast<std::size_t>(samples.width));
    };
    if (colour && (p[0] != p[1] || p[0] != p[2])) {
      throw codecs::ImageDefect{fmt::format(
          "it is a colour image (red, green, blue = {}, {}, {} at pixel {}); save the frames as grey images without "
          "colour conversion",
          p[0], p[1], p[2], place())};
    }
    if (alpha && p[channels - 1] != kOpaque) {
      throw codecs::ImageDefect{
          fmt::format("pixel {} is transparent; save the frames without an alpha channel", place())};
    }
    out.values()[i] = p[0];
  }
  return out;
}

codecs::Samples decode(std::string_view bytes) {
  if (bytes.empty()) throw codecs::ImageDefect{"the file is empty (0 bytes); copy or capture it again"};
  if (codecs::is_png(bytes)) return codecs::decode_png(bytes);
  if (codecs::is_tiff(bytes)) return codecs::decode_tiff(bytes);
  if (codecs::is_bmp(bytes)) return codecs::decode_bmp(bytes);
  if (codecs::is_pgm(bytes)) return codecs::decode_pgm(bytes);
  throw codecs::ImageDefect{"this is not a PNG, TIFF, BMP or PGM image; give the frames in one of these formats"};
}

}  // namespace

GrayImage decode_gray_image(std::string_view bytes, const std::string& name) {
  try {
    codecs::Samples samples = decode(bytes);
    return std::visit([&](auto& values) -> GrayImage { return gray_from(samples, values); }, samples.values);
  } catch (const codecs::ImageDefect& defect) {
    throw InputError(fmt::format("{}: {}", name, defect.sentence));
  }
}

GrayImage read_gray_image(const std::filesystem::path& file) {
  return decode_gray_image(read_bytes(file), file.string());
}

}  // namespace fringecal

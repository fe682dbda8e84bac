// Image files: PNG, TIFF, BMP and PGM in, PNG and 32-bit float TIFF out. Lossless grey images of 8 and 16 bit; colour
// is refused with a sentence, not converted silently (a colour image whose channels are equal is accepted as grey).
//
// libpng and libtiff directly: OpenCV's imgcodecs pulls in GDAL and 140 shared libraries, 90 ms at every start of the
// program.
#pragma once

#include "core/image.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace fringecal {

/// Throws InputError: missing, not an image of these kinds, truncated, colour.
GrayImage read_gray_image(const std::filesystem::path& file);
/// The same from the bytes of a file; the name is for messages.
GrayImage decode_gray_image(std::string_view bytes, const std::string& name);

/// Bytes of a PNG file. Fast setting: a capture writes eleven of these.
std::string encode_png(const GrayImage& image);
/// A picture for people.
using Rgb = std::array<std::uint8_t, 3>;
std::string encode_png(const Image<Rgb>& image);
/// 32-bit float TIFF, one sample per pixel, deflate; NaN marks "no value".
std::string encode_tiff(const Image<float>& image);
Image<float> read_float_tiff(const std::filesystem::path& file);

}  // namespace fringecal

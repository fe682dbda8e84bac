#include "core/image_file.h"

#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace fringecal {
namespace {

using test::message_of;
using test::TemporaryFolder;
using testing::AllOf;
using testing::HasSubstr;

template <class T>
Image<T> noisy(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  Image<T> out(width, height);
  for (T& v : out.values()) v = static_cast<T>(random());
  return out;
}

std::string little(std::uint32_t value, int bytes) {
  std::string out;
  for (int k = 0; k < bytes; ++k) out += static_cast<char>(value >> (8 * k));
  return out;
}

/// A BMP as the Windows documentation describes it, bottom row first. pixels: rows from the top, already padded.
std::string bmp(std::int32_t width, std::int32_t height, int bits, const std::string& palette,
                const std::vector<std::string>& rows) {
  const std::uint32_t start = 54 + static_cast<std::uint32_t>(palette.size());
  std::string body;
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) body += *row;
  return "BM" + little(start + static_cast<std::uint32_t>(body.size()), 4) + little(0, 4) + little(start, 4) +
         little(40, 4) + little(static_cast<std::uint32_t>(width), 4) + little(static_cast<std::uint32_t>(height), 4) +
         little(1, 2) + little(static_cast<std::uint32_t>(bits), 2) + std::string(16, '\0') +
         little(static_cast<std::uint32_t>(palette.size() / 4), 4) + little(0, 4) + palette + body;
}

std::string gray_palette() {
  std::string out;
  for (std::uint32_t c = 0; c < 256; ++c) out += little(c | c << 8 | c << 16, 4);
  return out;
}

/// The least TIFF: little-endian, one uncompressed strip. tags: (tag, type, count, value).
std::string tiff(std::uint32_t width, std::uint32_t height, std::uint32_t bits, std::uint32_t channels,
                 const std::string& pixels) {
  const std::uint32_t photometric = channels == 1 ? 1 : 2;
  const std::vector<std::array<std::uint32_t, 4>> tags = {
      {256, 4, 1, width},    {257, 4, 1, height},      {258, 3, 1, bits},
      {259, 3, 1, 1},        {262, 3, 1, photometric}, {273, 4, 1, 8},
      {277, 3, 1, channels}, {278, 4, 1, height},      {279, 4, 1, static_cast<std::uint32_t>(pixels.size())}};
  std::string out = std::string("II*\0", 4) + little(8 + static_cast<std::uint32_t>(pixels.size()), 4) + pixels;
  out += little(static_cast<std::uint32_t>(tags.size()), 2);
  for (const auto& [tag, type, count, value] : tags) {
    out += little(tag, 2) + little(type, 2) + little(count, 4) + little(value, 4);
  }
  return out + little(0, 4);
}

std::string complaint_about(const std::string& bytes) {
  return message_of<InputError>([&] { decode_gray_image(bytes, "frame_3.img"); });
}

TEST(ImageFile, PngKeepsEveryPixelOf8And16Bit) {
  for (const auto& [width, height] : {std::pair{1, 1}, {1, 7}, {33, 1}, {64, 48}}) {
    const auto image8 = noisy<std::uint8_t>(width, height, 1);
    const auto image16 = noisy<std::uint16_t>(width, height, 2);
    const auto back8 = std::get<Image8>(decode_gray_image(encode_png(image8), "a"));
    const auto back16 = std::get<Image16>(decode_gray_image(encode_png(image16), "b"));
    EXPECT_EQ(back8.width(), width);
    EXPECT_EQ(back8.values(), image8.values());
    EXPECT_EQ(back16.height(), height);
    EXPECT_EQ(back16.values(), image16.values());
  }
}

TEST(ImageFile, PngOfAFrameIsTheSameBytesEveryTime) {
  const GrayImage image = noisy<std::uint8_t>(100, 80, 3);
  EXPECT_EQ(encode_png(image), encode_png(image));
}

TEST(ImageFile, FloatTiffKeepsEveryBitAndNan) {
  const TemporaryFolder folder;
  Image<float> image(37, 19);
  std::mt19937 random(4);
  for (float& v : image.values()) v = std::normal_distribution<float>(0, 100)(random);
  image(5, 6) = std::numeric_limits<float>::quiet_NaN();
  image(7, 8) = -0.0f;
  write_atomically(folder / "a.tiff", encode_tiff(image));
  const auto back = read_float_tiff(folder / "a.tiff");
  ASSERT_EQ(back.width(), 37);
  ASSERT_EQ(back.height(), 19);
  for (std::size_t i = 0; i < image.size(); ++i) {
    EXPECT_EQ(std::bit_cast<std::uint32_t>(back.values()[i]), std::bit_cast<std::uint32_t>(image.values()[i]));
  }
}

TEST(ImageFile, PgmIsReadPlainAndBinaryWithComments) {
  const auto plain =
      std::get<Image8>(decode_gray_image("P2 # made by hand\n3 2\n# two rows\n255\n0 1 2\n10 20 255\n", "a"));
  EXPECT_EQ(plain.values(), (std::vector<std::uint8_t>{0, 1, 2, 10, 20, 255}));
  const auto binary = std::get<Image8>(decode_gray_image(std::string("P5\n2 2\n255\n\n\x01\x02\xff", 15), "b"));
  EXPECT_EQ(binary.values(), (std::vector<std::uint8_t>{'\n', 1, 2, 255}));
  // 16 bit: the most significant byte first.
  const auto wide = std::get<Image16>(decode_gray_image(std::string("P5 2 1 4095\n\x01\x02\x0f\xff", 16), "c"));
  EXPECT_EQ(wide.values(), (std::vector<std::uint16_t>{0x102, 0xfff}));
}

TEST(ImageFile, BmpIsReadInItsOwnRowOrderAndPadding) {
  // Width 3: rows of 3 bytes are padded to 4, rows of 9 to 12. A negative height stores the top row first.
  const std::string top = {10, 20, 30, 0}, bottom = {40, 50, 60, 0};
  const std::vector<std::uint8_t> want{10, 20, 30, 40, 50, 60};
  EXPECT_EQ(std::get<Image8>(decode_gray_image(bmp(3, 2, 8, gray_palette(), {top, bottom}), "a")).values(), want);
  EXPECT_EQ(std::get<Image8>(decode_gray_image(bmp(3, -2, 8, gray_palette(), {bottom, top}), "b")).values(), want);
  const auto triple = [](const std::string& row) {
    std::string out;
    for (std::size_t x = 0; x < 3; ++x) out += std::string(3, row[x]);
    return out + std::string(3, '\0');
  };
  EXPECT_EQ(std::get<Image8>(decode_gray_image(bmp(3, 2, 24, "", {triple(top), triple(bottom)}), "c")).values(), want);
}

TEST(ImageFile, TiffIsReadWith8And16Bit) {
  EXPECT_EQ(std::get<Image8>(decode_gray_image(tiff(2, 2, 8, 1, "\x01\x02\x03\x04"), "a")).values(),
            (std::vector<std::uint8_t>{1, 2, 3, 4}));
  EXPECT_EQ(std::get<Image16>(decode_gray_image(tiff(2, 1, 16, 1, "\x01\x02\x03\x04"), "b")).values(),
            (std::vector<std::uint16_t>{0x201, 0x403}));
}

TEST(ImageFile, ColourWithEqualChannelsIsGray) {
  Image<Rgb> image(4, 3);
  for (std::size_t i = 0; i < image.size(); ++i) image.values()[i].fill(static_cast<std::uint8_t>(20 * i));
  const auto gray = std::get<Image8>(decode_gray_image(encode_png(image), "a"));
  EXPECT_EQ(gray(3, 2), 220);
}

TEST(ImageFile, ColourIsRefusedWithThePixelThatShowsIt) {
  Image<Rgb> image(4, 3, Rgb{9, 9, 9});
  image(2, 1) = {10, 20, 30};
  EXPECT_THAT(
      complaint_about(encode_png(image)),
      AllOf(HasSubstr("frame_3.img"), HasSubstr("10, 20, 30 at pixel (2, 1)"), HasSubstr("save the frames as grey")));
}

TEST(ImageFile, EveryTruncationIsRefusedByName) {
  const auto image = noisy<std::uint8_t>(40, 30, 5);
  std::string pgm = "P5\n40 30\n255\n";
  pgm.append(reinterpret_cast<const char*>(image.data()), image.size());
  const std::string tif = tiff(40, 30, 8, 1, std::string(reinterpret_cast<const char*>(image.data()), image.size()));
  const std::string bitmap = bmp(40, 30, 8, gray_palette(), std::vector<std::string>(30, std::string(40, 'x')));
  for (const std::string& whole : {encode_png(image), pgm, tif, bitmap}) {
    ASSERT_EQ(complaint_about(whole), "");
    for (const double part : {0.01, 0.05, 0.3, 0.7, 0.99}) {
      const auto size = static_cast<std::size_t>(part * static_cast<double>(whole.size()));
      EXPECT_THAT(complaint_about(whole.substr(0, size)), HasSubstr("frame_3.img: ")) << part;
    }
    // The last four bytes of this TIFF say that no second image follows: no pixel is lost with them.
    const std::size_t idle = whole == tif ? 4 : 0;
    EXPECT_THAT(complaint_about(whole.substr(0, whole.size() - idle - 1)), HasSubstr("frame_3.img: "));
  }
  EXPECT_THAT(complaint_about(encode_png(image).substr(0, 700)),
              HasSubstr("the PNG is truncated: it ends after 700 bytes"));
}

TEST(ImageFile, ADamagedByteInAPngIsFound) {
  std::string bytes = encode_png(noisy<std::uint8_t>(40, 30, 6));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  EXPECT_THAT(complaint_about(bytes), AllOf(HasSubstr("the PNG is damaged"), HasSubstr("copy or capture it again")));
}

TEST(ImageFile, EmptyAndForeignFilesAreRefused) {
  EXPECT_THAT(complaint_about(""), HasSubstr("the file is empty (0 bytes)"));
  EXPECT_THAT(complaint_about("<!DOCTYPE html>"), HasSubstr("this is not a PNG, TIFF, BMP or PGM image"));
  EXPECT_THAT(message_of<InputError>([] { read_gray_image("/nowhere/frame.png"); }), HasSubstr("/nowhere/frame.png"));
}

TEST(ImageFile, AbsurdSizesAreRefusedBeforeMemoryIsAskedFor) {
  EXPECT_THAT(complaint_about("P5 2000000000 2000000000 255\nabc"), HasSubstr("no camera delivers"));
  EXPECT_THAT(complaint_about("P2 16000 16000 255\n1 2 3"), HasSubstr("more than its 24 bytes can hold"));
  EXPECT_THAT(complaint_about("P5 0 5 255\n"), HasSubstr("0 x 5"));
  EXPECT_THAT(complaint_about(bmp(-5, 4, 8, gray_palette(), {"abcd"})), HasSubstr("-5 x 4"));
  EXPECT_THAT(complaint_about(bmp(16000, 16000, 24, "", {"abcd"})), HasSubstr("can hold"));
  EXPECT_THAT(complaint_about(tiff(4000000000u, 4000000000u, 8, 1, "abcd")), HasSubstr("frame_3.img: "));
  // A PNG whose header claims 16384 x 16384: width and height stand at bytes 16 and 20, the header's CRC at 29.
  std::string png = encode_png(Image8(8, 8, 7));
  png.replace(16, 8, std::string("\0\0\x40\0\0\0\x40\0", 8));
  EXPECT_THAT(complaint_about(png), HasSubstr("frame_3.img: "));
}

TEST(ImageFile, RandomDamageNeverDoesMoreThanThrow) {
  const auto image = noisy<std::uint8_t>(24, 16, 7);
  std::vector<std::string> wholes = {encode_png(image), tiff(4, 4, 8, 1, "0123456789abcdef"),
                                     bmp(4, 2, 8, gray_palette(), {"abcd", "efgh"}), "P2 3 1 255\n1 2 3\n"};
  std::mt19937 random(8);
  int refused = 0;
  for (int round = 0; round < 4000; ++round) {
    std::string bytes = wholes[static_cast<std::size_t>(round) % wholes.size()];
    for (int k = 0; k < 3; ++k) bytes[random() % bytes.size()] = static_cast<char>(random());
    try {
      const GrayImage read = decode_gray_image(bytes, "x");
      EXPECT_GT(width_of(read), 0);
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);  // every damaged PNG, a quarter of all, fails one of its checksums
}

}  // namespace
}  // namespace fringecal

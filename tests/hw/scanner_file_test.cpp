// scanner.toml, and the figures of the focusing aid.
#include "hw/scanner_file.h"
#include "core/error.h"
#include "core/file.h"
#include "hw/live_figures.h"
#include "tests/support/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace {

using namespace fringecal;
using testing::HasSubstr;

hw::ScannerFile example() {
  hw::ScannerFile out;
  out.camera.address = "192.168.0.10";
  out.camera.pixel_format = "Mono12";
  out.camera.packet_size_bytes = 1500;
  out.exposure_ms = 12.5;
  out.plc_address = "mewtocol:/dev/ttyUSB0?baud=9600&station=1";
  out.lamp_level = 0.5;
  out.plan.x = FringeCode{.gray_bits = 2, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
  for (int b = 0; b < 2; ++b) out.plan.patterns.push_back({PatternKind::gray, CodeAxis::x, b, false});
  for (int k = 0; k < 4; ++k) out.plan.patterns.push_back({PatternKind::phase, CodeAxis::x, k, false});
  return out;
}

TEST(ScannerFile, ReadsBackWhatIsWritten) {
  const test::TemporaryFolder scratch;
  const hw::ScannerFile written = example();
  write_atomically(scratch / "scanner.toml", to_toml(written));
  const hw::ScannerFile read = hw::read_scanner_file(scratch / "scanner.toml");
  EXPECT_EQ(to_toml(read), to_toml(written));
  EXPECT_EQ(read.plan.patterns, written.plan.patterns);
  EXPECT_EQ(read.camera.packet_size_bytes, 1500);
  EXPECT_EQ(read.exposure_ms, 12.5);
}

TEST(ScannerFile, RefusesWhatCannotBeMeant) {
  const test::TemporaryFolder scratch;
  const auto refused = [&](const std::string& from, const std::string& to) -> std::string {
    std::string text = to_toml(example());
    text.replace(text.find(from), from.size(), to);
    write_atomically(scratch / "scanner.toml", text);
    try {
      hw::read_scanner_file(scratch / "scanner.toml");
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refused("192.168.0.10", "my-camera"), HasSubstr("broadcast"));
  EXPECT_THAT(refused("mewtocol:", "profibus:"), HasSubstr("profibus"));
  EXPECT_THAT(refused("lamp_level = 0.5", "lamp_level = 50"), HasSubstr("lamp_level is 50"));
  EXPECT_THAT(refused("pixel_format", "pixelformat"), HasSubstr("pixelformat"));
  EXPECT_THAT(refused("\"gray 1\", ", ""), HasSubstr("scanner.toml"));
  EXPECT_THAT(refused("packet_size_bytes = 1500", "packet_size_bytes = 15"), HasSubstr("packet_size_bytes is 15"));
}

Image8 stripes(double modulation, double blur_px) {
  Image8 out(256, 128);
  // A sinusoid of 16 px: blurred by a Gaussian, its amplitude falls by exp(-(2 pi blur / 16)^2 / 2).
  const double w = 2 * M_PI / 16, kept = std::exp(-0.5 * w * w * blur_px * blur_px);
  for (int y = 0; y < 128; ++y) {
    for (int x = 0; x < 256; ++x) {
      out(x, y) = static_cast<std::uint8_t>(std::lround(100 + 100 * modulation * kept * std::sin(w * x)));
    }
  }
  return out;
}

TEST(LiveFigures, SharpnessFallsWithBlurAsTheFormulaSays) {
  // S is proportional to the square of the amplitude; rounding to whole grey levels changes it by less than 2 %.
  const double sharp = hw::live_figures(stripes(0.8, 0), 255).sharpness;
  const double soft = hw::live_figures(stripes(0.8, 2), 255).sharpness;
  const double kept = std::exp(-std::pow(2 * M_PI * 2 / 16, 2));
  EXPECT_NEAR(soft / sharp, kept, 0.02);
}

TEST(LiveFigures, ModulationIsThatOfTheStripes) {
  // The 5 % and 95 % values of a sinusoid lie at cos(0.05 pi) = 0.988 of its amplitude; 16 samples a period and whole
  // grey levels leave 0.02.
  EXPECT_NEAR(*hw::live_figures(stripes(0.8, 0), 255).modulation, 0.8 * std::cos(0.05 * M_PI), 0.02);
  EXPECT_FALSE(hw::live_figures(GrayImage(Image8(64, 64, 3)), 255).modulation);
}

TEST(LiveFigures, HistogramLevelAndSaturation) {
  Image16 image(100, 100, 1000);
  for (int i = 0; i < 200; ++i) image.values()[static_cast<std::size_t>(i)] = 4095;
  const hw::LiveFigures f = hw::live_figures(image, 4095);
  EXPECT_DOUBLE_EQ(f.saturated, 0.02);
  EXPECT_DOUBLE_EQ(f.level, 1.0);
  EXPECT_DOUBLE_EQ(f.histogram[31], 0.02);
  EXPECT_DOUBLE_EQ(f.histogram[1000 * 32 / 4096], 0.98);
}

}  // namespace

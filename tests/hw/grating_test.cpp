#include "hw/virtual/grating.h"

#include "tests/hw/virtual_support.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace fringecal::virt {
namespace {

// The binary pattern on glass, blurred by adding up the edges that it has over [-10, +10] stripes around u: no table,
// no series, nothing shared with the renderer.
double blurred(const std::vector<bool>& bright, double cell_mm, double first_mm, double u_mm, double sigma_mm) {
  double sum = 0;
  for (std::size_t i = 0; i < bright.size(); ++i) {
    const double left = first_mm + cell_mm * static_cast<double>(i);
    if (bright[i]) {
      sum += 0.5 * (std::erf((u_mm - left) / (sigma_mm * std::sqrt(2.0))) -
                    std::erf((u_mm - left - cell_mm) / (sigma_mm * std::sqrt(2.0))));
    }
  }
  return sum;
}

double rendered(const Grating& grating, const Pattern& pattern, double period_mm, double u_mm, double sigma_mm) {
  const double phase = 2 * std::numbers::pi * u_mm / period_mm - std::numbers::pi;
  const std::array<float, 1> u{static_cast<float>(u_mm)}, c{static_cast<float>(std::cos(phase))},
      s{static_cast<float>(std::sin(phase))}, e{static_cast<float>(grating.first_harmonic(sigma_mm))},
      i{static_cast<float>(1 / sigma_mm)}, light{1.0F};
  std::array<float, 1> out{};
  grating.project(pattern, 0.0, {u, c, s, e, i, light}, {.factor = 1.0}, out);
  return out[0];
}

class GratingOf : public testing::TestWithParam<std::pair<int, int>> {};

// Tolerance: 1e-4 of the contrast is what grating.h promises for series, table, left-out edges and float arithmetic.
TEST_P(GratingOf, ShowsTheBlurredBinaryCodeToOneTenThousandth) {
  const auto [bits, stripes_per_period] = GetParam();
  const ChangedPreset file(
      {{"gray_bits", std::to_string(bits)}, {"stripes_per_period", std::to_string(stripes_per_period)}});
  const Preset preset = read_preset(file.file());
  const Grating grating(preset);
  const double p = preset.grating.code.period, stripe = p / stripes_per_period, width = stripe * (1 << bits),
               dark = 0.01;
  for (const double rho2 : {0.0, 1.0}) {
    const double sigma = grating.sigma_mm(rho2);
    for (int k = 0; k < bits; ++k) {
      std::vector<bool> bright;
      for (int i = 0; i < 1 << bits; ++i) bright.push_back((((i ^ (i >> 1)) >> (bits - 1 - k)) & 1) != 0);
      for (double u = p; u < width - p; u += width / 517) {
        const double exact = dark + (1 - dark) * blurred(bright, stripe, 0, u, sigma);
        ASSERT_NEAR(rendered(grating, {PatternKind::gray, CodeAxis::x, k, false}, p, u, sigma), exact, 1e-4)
            << k << " " << u;
      }
    }
    for (int k = 0; k < 4; ++k) {
      std::vector<bool> fine;  // eighths of a period from -4 p on: every step's edges lie between two of them
      for (int i = 0; i < 128; ++i) {
        fine.push_back(std::cos(2 * std::numbers::pi * (i + 0.5) / 8 - std::numbers::pi - k * std::numbers::pi / 2) >
                       0);
      }
      for (double u = 0; u < 2 * p; u += p / 53) {
        const double exact = dark + (1 - dark) * blurred(fine, p / 8, -4 * p, u, sigma);
        ASSERT_NEAR(rendered(grating, {PatternKind::phase, CodeAxis::x, k, false}, p, u, sigma), exact, 1e-4)
            << k << " " << u;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Codes, GratingOf,
                         testing::Values(std::pair(7, 2), std::pair(6, 1), std::pair(5, 2), std::pair(8, 1)));

// The phase step of the default grating is the (n+1)-th Gray bit: eq. 2 against i ^ (i >> 1) with one bit more.
TEST(Grating, PhaseStepZeroIsTheNextGrayBit) {
  const Preset preset = read_preset("chen2008");
  const Grating grating(preset);
  const double p = preset.grating.code.period, quarter = p / 4;
  for (int i = 0; i < 256; ++i) {
    const double value =
        rendered(grating, {PatternKind::phase, CodeAxis::x, 0, false}, p, (i + 0.5) * quarter, grating.sigma_mm(0));
    EXPECT_EQ(value > 0.5, ((i ^ (i >> 1)) & 1) != 0) << i;
  }
}

TEST(Grating, BlurLeavesTheThirdHarmonicOfThePreset) {
  const Grating grating(read_preset("chen2008"));
  // exp(-4 x^2) / 3 with x = 2 pi sigma / p, from the specification.
  for (const auto& [rho2, ratio] : {std::pair(0.0, 0.012), std::pair(1.0, 0.020)}) {
    const double x = 2 * std::numbers::pi * grating.sigma_mm(rho2) / 0.24;
    EXPECT_NEAR(std::exp(-4 * x * x) / 3, ratio, 1e-12);
  }
}

}  // namespace
}  // namespace fringecal::virt

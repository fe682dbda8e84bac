// Exposure search and the merging of two exposures.
#include "hw/exposure.h"

#include "tests/hw/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace fringecal::hw {
namespace {

PatternPlan phase_plan(int steps) {
  PatternPlan plan;
  plan.x = FringeCode{.gray_bits = 0, .phase_steps = steps};
  for (int k = 0; k < steps; ++k) plan.patterns.push_back({.kind = PatternKind::phase, .index = k});
  return plan;
}

TEST(Exposure, TheLevelIgnoresAHotPixelButNotABoard) {
  Image8 image(200, 100, 40);
  image(3, 3) = 255;
  image(4, 3) = 254;
  EXPECT_EQ(bright_level(image), 40);  // 2 of 20000 pixels are 1e-4
  image(5, 3) = 250;
  EXPECT_EQ(bright_level(image), 250);
  EXPECT_DOUBLE_EQ(saturated_part(image, 255), 1.0 / 20000);
}

TEST(Exposure, TheSearchEndsBelowSaturationFromFarTooDarkAndFarTooBright) {
  for (const double start_ms : {0.05, 1.0, 400.0}) {
    double exposure_ms = start_ms;
    int steps = 0;
    const auto level = [&] { return static_cast<int>(std::min(255.0, 12.0 * exposure_ms)); };
    while (const auto next = next_exposure_ms(exposure_ms, level(), 255, {})) {
      exposure_ms = *next;
      ASSERT_LE(++steps, ExposureSearch{}.most_steps) << start_ms;
    }
    // 0.78 to 0.92 of 255 is 198.9 to 234.6; one grey level is lost by cutting off the fraction.
    EXPECT_GE(level(), 198) << start_ms;
    EXPECT_LE(level(), 234) << start_ms;
  }
}

TEST(Exposure, TheSearchStaysWithinTheCamerasRange) {
  EXPECT_EQ(next_exposure_ms(800, 10, 255, {.most_ms = 1000}), 1000);
  EXPECT_EQ(next_exposure_ms(0.02, 255, 255, {.least_ms = 0.01}), 0.01);
}

TEST(Exposure, MergingTakesTheLargerModulationThatIsNotSaturatedForAllFramesOfAPixel) {
  const PatternPlan plan = phase_plan(4);
  // Pixel 0 is dark (the long exposure is better), pixel 1 bright (the long one saturates in one frame only), pixel 2
  // saturates in both.
  const double offset[3] = {10, 120, 250}, amplitude[3] = {5, 60, 40};
  std::vector<std::vector<GrayImage>> stacks;
  for (const double exposure : {1.0, 2.0}) {
    auto& stack = stacks.emplace_back();
    for (int k = 0; k < 4; ++k) {
      Image8 image(3, 1);
      for (int x = 0; x < 3; ++x) {
        const double i = exposure * (offset[x] + amplitude[x] * std::cos(0.3 - std::numbers::pi * k / 2));
        image(x, 0) = static_cast<std::uint8_t>(std::min(255.0, i));
      }
      stack.push_back(image);
    }
  }
  const auto merged = merge_exposures(plan, stacks, 255);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto& m = std::get<Image8>(merged[k]);
    EXPECT_EQ(m(0, 0), std::get<Image8>(stacks[1][k])(0, 0));
    EXPECT_EQ(m(1, 0), std::get<Image8>(stacks[0][k])(1, 0));
    EXPECT_EQ(m(2, 0), std::get<Image8>(stacks[0][k])(2, 0));
  }
}

}  // namespace
}  // namespace fringecal::hw

#include "reports/picture.h"
#include "reports/colour.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace fringecal::reports {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

TEST(ColourMap, LiesInsideSrgbEverywhere) {
  for (const ColourMap map : {ColourMap::sequential, ColourMap::diverging}) {
    for (int k = 0; k <= 256; ++k) {
      const auto [lightness, a, b] = oklab_at(map, k / 256.0);
      // Half a step of 8 bits: less than the rounding that follows.
      for (const double channel : srgb_from_oklab(lightness, a, b)) {
        EXPECT_GE(channel, -0.5 / 255.0) << static_cast<int>(map) << " at " << k / 256.0;
        EXPECT_LE(channel, 1.0 + 0.5 / 255.0) << static_cast<int>(map) << " at " << k / 256.0;
      }
    }
  }
}

TEST(ColourMap, LightnessIsLinearInTheValue) {
  for (int k = 1; k < 256; ++k) {
    const double before = oklab_at(ColourMap::sequential, (k - 1) / 256.0)[0],
                 here = oklab_at(ColourMap::sequential, k / 256.0)[0],
                 after = oklab_at(ColourMap::sequential, (k + 1) / 256.0)[0];
    EXPECT_NEAR(after - here, here - before, 1e-12);  // three roundings of numbers below 1
    EXPECT_GT(here, before);
  }
}

TEST(ColourMap, TheDivergingMapIsAsDarkOnBothSides) {
  for (int k = 0; k <= 128; ++k) {
    EXPECT_NEAR(oklab_at(ColourMap::diverging, k / 256.0)[0], oklab_at(ColourMap::diverging, 1.0 - k / 256.0)[0],
                1e-12);
  }
  const Rgb below = colour_at(ColourMap::diverging, 0.0), above = colour_at(ColourMap::diverging, 1.0);
  EXPECT_GT(below[2], below[0]);
  EXPECT_GT(above[0], above[2]);
}

TEST(ColourMap, WhiteIsWhiteInOklab) {
  // The published matrices have ten digits and sums of three terms: 1e-8.
  for (const double channel : srgb_from_oklab(1.0, 0.0, 0.0)) EXPECT_NEAR(channel, 1.0, 1e-7);
}

TEST(BlockMean, AveragesValidPixelsOfBlocksThatAreHalfValid) {
  Image<float> values(5, 2, 1.0f);
  values(0, 0) = 3.0f;
  values(2, 0) = values(3, 0) = values(2, 1) = kNaN;
  values(4, 0) = kNaN;
  values(4, 1) = 7.0f;
  const Image<float> mean = block_mean(values, 2);
  ASSERT_EQ(mean.width(), 3);
  ASSERT_EQ(mean.height(), 1);
  EXPECT_FLOAT_EQ(mean(0, 0), 1.5f);
  EXPECT_TRUE(std::isnan(mean(1, 0)));
  EXPECT_FLOAT_EQ(mean(2, 0), 7.0f);
}

TEST(RobustRange, IgnoresAFewWildPixelsAndIsSymmetricForDeviations) {
  Image<float> values(100, 100);
  for (std::size_t k = 0; k < values.size(); ++k) values.values()[k] = static_cast<float>(k % 1000) / 1000.0f;
  values(7, 7) = 1e6f;
  values(8, 7) = kNaN;
  const auto deviations = robust_range(values, ColourMap::diverging);
  ASSERT_TRUE(deviations);
  EXPECT_DOUBLE_EQ(deviations->low, -deviations->high);
  // The 99 % quantile of a uniform ramp of 1000 steps is 0.99 to one step.
  EXPECT_NEAR(deviations->high, 0.99, 1.5e-3);
  const auto plain = robust_range(values, ColourMap::sequential);
  ASSERT_TRUE(plain);
  EXPECT_NEAR(plain->low, 0.005, 1.5e-3);
  EXPECT_NEAR(plain->high, 0.995, 1.5e-3);
}

TEST(RobustRange, HasTwoEndsForAConstantImageAndNoneForAnEmptyOne) {
  const auto constant = robust_range(Image<float>(4, 4, 2.0f), ColourMap::sequential);
  ASSERT_TRUE(constant);
  EXPECT_LT(constant->low, 2.0);
  EXPECT_GT(constant->high, 2.0);
  EXPECT_FALSE(robust_range(Image<float>(4, 4, kNaN), ColourMap::sequential));
}

TEST(HeatMap, SaysSoWhereThereIsNothingToShow) {
  EXPECT_NE(heat_map(Image<float>(4, 4, kNaN), {}).html().find("No values"), std::string::npos);
  EXPECT_NE(heat_map(Image<float>(), {}).html().find("No values"), std::string::npos);
}

TEST(HeatMap, PrintsTheColourBarInTheScaledUnit) {
  Image<float> values(40, 30);
  for (std::size_t k = 0; k < values.size(); ++k)
    values.values()[k] = 0.05f * (static_cast<float>(k % 40) / 19.5f - 1.0f);
  const std::string svg =
      heat_map(values, {.map = ColourMap::diverging, .label = "deviation, µm", .scale = 1000.0}).html();
  EXPECT_NE(svg.find(">+40<"), std::string::npos);
  EXPECT_NE(svg.find(">−40<"), std::string::npos);
  EXPECT_NE(svg.find("deviation, µm"), std::string::npos);
}

TEST(HeatMap, DrawsAConstantImageAndASinglePixel) {
  EXPECT_NE(heat_map(Image<float>(8, 8, 0.0f), {}).html().find("data:image/png"), std::string::npos);
  EXPECT_NE(heat_map(Image<float>(1, 1, 3.0f), {}).html().find("data:image/png"), std::string::npos);
}

}  // namespace
}  // namespace fringecal::reports

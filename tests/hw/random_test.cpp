#include "hw/virtual/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace fringecal::virt {
namespace {

// Published quantiles of the normal distribution, to their 12 digits.
TEST(NormalQuantile, AgreesWithPublishedValues) {
  EXPECT_NEAR(normal_quantile(0.5), 0.0, 1e-15);
  EXPECT_NEAR(normal_quantile(0.975), 1.959963984540, 1e-12);
  EXPECT_NEAR(normal_quantile(0.00135), -2.999976992703, 1e-11);
  EXPECT_NEAR(normal_quantile(1e-9), -5.997807015008, 1e-11);
}

// 400 x 1000 draws: standard error of the mean 0.0016, of the variance 0.0022, of the fourth moment sqrt(96 / n) =
// 0.015; five of each. Neighbours in a row and in a column: standard error of a correlation 0.0016.
TEST(PixelNoise, IsNormalWhiteAndOfUnitVariance) {
  constexpr int kRows = 400, kColumns = 1000, kCount = kRows * kColumns;
  std::vector<std::vector<float>> rows(kRows, std::vector<float>(kColumns));
  for (int y = 0; y < kRows; ++y) fill_normal(key_of(5, "frame"), y, rows[static_cast<std::size_t>(y)]);
  double mean = 0, square = 0, fourth = 0, across = 0, down = 0;
  for (std::size_t y = 0; y < kRows; ++y) {
    for (std::size_t x = 0; x < kColumns; ++x) {
      const double n = rows[y][x];
      mean += n / kCount;
      square += n * n / kCount;
      fourth += n * n * n * n / kCount;
      if (x > 0) across += n * static_cast<double>(rows[y][x - 1]) / kCount;
      if (y > 0) down += n * static_cast<double>(rows[y - 1][x]) / kCount;
    }
  }
  EXPECT_NEAR(mean, 0, 0.008);
  EXPECT_NEAR(square, 1, 0.011);
  EXPECT_NEAR(fourth, 3, 0.08);
  EXPECT_NEAR(across, 0, 0.008);
  EXPECT_NEAR(down, 0, 0.008);
}

TEST(PixelNoise, IsAFunctionOfKeyAndPlaceAlone) {
  std::vector<float> a(101), b(101), c(101), d(101);
  fill_normal(1, 7, a);
  fill_normal(1, 8, b);
  fill_normal(2, 7, c);
  fill_normal(1, 7, d);
  EXPECT_EQ(a, d);
  EXPECT_NE(a, b);
  EXPECT_NE(a, c);
}

}  // namespace
}  // namespace fringecal::virt

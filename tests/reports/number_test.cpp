#include "reports/number.h"

#include <gtest/gtest.h>

#include <limits>

namespace fringecal::reports {
namespace {

void expect_rounded(double value, double u, const std::string& value_text, const std::string& u_text) {
  const Rounded r = rounded(value, u);
  EXPECT_EQ(r.value, value_text) << value << " with u " << u;
  EXPECT_EQ(r.u, u_text) << value << " with u " << u;
}

TEST(Number, RoundsAValueToTheSecondDigitOfItsUncertainty) {
  expect_rounded(1234.5678, 0.0123, "1234.568", "0.012");
  expect_rounded(-5.25, 1.55, "−5.2", "1.6");
  expect_rounded(3721.43, 62.0, "3721", "62");
  expect_rounded(3721.43, 620.0, "3720", "620");
  expect_rounded(0.0, 0.5, "0.00", "0.50");
}

TEST(Number, RoundsAnUncertaintyUpToTheNextPowerOfTen) { expect_rounded(1.23456, 0.0996, "1.23", "0.10"); }

TEST(Number, SharesAPowerOfTenBeyondSixDecimals) {
  expect_rounded(2.5e-6, 1e-7, "2.50 × 10⁻⁶", "0.10 × 10⁻⁶");
  expect_rounded(1.734e-4, 9.1e-7, "1.7340 × 10⁻⁴", "0.0091 × 10⁻⁴");
}

TEST(Number, WritesATypographicMinusButNoMinusZero) {
  EXPECT_EQ(fixed(-0.5, 1), "−0.5");
  EXPECT_EQ(fixed(-0.01, 1), "0.0");
  EXPECT_EQ(with_sign(fixed(2.1, 1)), "+2.1");
  EXPECT_EQ(with_sign(fixed(-2.1, 1)), "−2.1");
  EXPECT_EQ(with_sign(fixed(0.01, 1)), "0.0");
}

TEST(Number, KeepsSignificantDigits) {
  EXPECT_EQ(significant(0.031234, 3), "0.0312");
  EXPECT_EQ(significant(31.2, 3), "31.2");
  EXPECT_EQ(significant(-312.14, 3), "−312");
  EXPECT_EQ(significant(31249.0, 3), "31200");
  EXPECT_EQ(significant(-1.9e-14, 2), "−1.9 × 10⁻¹⁴");
}

TEST(Number, DropsTheEndZerosOfExactFigures) {
  EXPECT_EQ(without_end_zeros("40.0"), "40");
  EXPECT_EQ(without_end_zeros("400"), "400");
  EXPECT_EQ(without_end_zeros("1.050"), "1.05");
  EXPECT_EQ(without_end_zeros("−1.90000 × 10⁻¹⁴"), "−1.9 × 10⁻¹⁴");
}

TEST(Number, WritesDurations) {
  EXPECT_EQ(duration(0.84), "0.8 s");
  EXPECT_EQ(duration(41.7), "42 s");
  EXPECT_EQ(duration(59.7), "1 min 00 s");
  EXPECT_EQ(duration(125.0), "2 min 05 s");
}

TEST(Number, RefusesWhatIsNotFinite) {
  EXPECT_THROW(fixed(std::numeric_limits<double>::quiet_NaN(), 1), std::logic_error);
  EXPECT_THROW(rounded(1.0, std::numeric_limits<double>::infinity()), std::logic_error);
  EXPECT_THROW(rounded(1.0, -0.1), std::logic_error);
}

}  // namespace
}  // namespace fringecal::reports

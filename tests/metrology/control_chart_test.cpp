#include "metrology/control_chart.h"
#include "core/error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fringecal::metrology {
namespace {

std::vector<ChartValue> noise(int n, double drift_per_day, unsigned seed) {
  std::mt19937 generator(seed);
  std::vector<ChartValue> out;
  for (int i = 0; i < n; ++i) {
    double x = -6;  // sum of twelve uniforms: normal enough, and the same everywhere
    for (int j = 0; j < 12; ++j) x += static_cast<double>(generator()) / 4294967296.0;
    out.push_back({.day = i * 7.0, .value = x + drift_per_day * i * 7});
  }
  return out;
}

// Eqs. 1, 3 and 4 by hand for 1, 3, 2, 4, 3 (m = 2.6; ranges 2 1 2 1, mean 1.5, s = 1.32979).
TEST(ControlChart, FollowsItsFormulas) {
  std::vector<ChartValue> values;
  for (const double v : {1.0, 3.0, 2.0, 4.0, 3.0}) values.push_back({static_cast<double>(values.size()), v});
  const auto chart = control_chart(values, 5);
  ASSERT_TRUE(chart);
  EXPECT_NEAR(chart->mean, 2.6, 1e-12);
  EXPECT_NEAR(chart->s, 1.5 / 1.128, 1e-12);
  EXPECT_NEAR(chart->points[0].ewma, 0.2 * 1 + 0.8 * 2.6, 1e-12);
  EXPECT_NEAR(chart->points[1].ewma, 0.2 * 3 + 0.8 * 2.28, 1e-12);
  EXPECT_NEAR(chart->points[0].ewma_limit, 2.7 * 1.5 / 1.128 * 0.2, 1e-12);
  EXPECT_NEAR(chart->points[0].cusum_low, 1.6 / (1.5 / 1.128) - 0.5, 1e-12);
  EXPECT_EQ(chart->points[0].cusum_high, 0);
}

// A jump of four standard deviations after 30 quiet weeks: Shewhart's chart sees 84 % of such points at once, so one of
// five in a row almost surely; a drift of a tenth of s per week only the CUSUM and EWMA see in time.
TEST(ControlChart, SignalsAJumpAndADrift) {
  auto jump = noise(40, 0, 3);
  for (std::size_t i = 30; i < jump.size(); ++i) jump[i].value += 5;
  const auto chart = control_chart(jump, 20);
  ASSERT_TRUE(chart);
  bool shewhart = false, cusum = false;
  for (std::size_t i = 30; i < 35; ++i) {
    for (const Signal s : chart->points[i].signals) {
      shewhart = shewhart || s == Signal::shewhart;
      cusum = cusum || s == Signal::cusum;
    }
  }
  EXPECT_TRUE(shewhart);
  EXPECT_TRUE(cusum);
}

// False alarms: ARL0 of the three charts together is above 100, of 20 quiet points after the baseline most series have none.
TEST(ControlChart, IsMostlyQuietWithoutACause) {
  int alarmed = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const auto chart = control_chart(noise(50, 0, seed), 30);
    ASSERT_TRUE(chart);
    bool any = false;
    for (std::size_t i = 30; i < 50; ++i) any = any || !chart->points[i].signals.empty();
    alarmed += any ? 1 : 0;
  }
  EXPECT_LT(alarmed, 25);
}

TEST(ControlChart, NeedsFiveValuesThatDiffer) {
  EXPECT_FALSE(control_chart(noise(4, 0, 1)));
  EXPECT_FALSE(control_chart(std::vector<ChartValue>(8, {0, 1})));
}

// Without noise the line is exact: 0.01 a day from 0 meets 1 on day 100.
TEST(Forecast, FindsTheDayOfALine) {
  std::vector<ChartValue> values;
  for (int i = 0; i <= 5; ++i) values.push_back({i * 10.0, i * 0.1});
  const auto f = forecast(values, {.upper = 1.0 - 1e-9});
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->slope_per_day, 0.01, 1e-12);
  ASSERT_TRUE(f->expected_day);
  EXPECT_EQ(*f->expected_day, 100);
}

// Coverage: the next value lies in the interval of eq. 5 in 95.45 % of cases; 2000 series: standard error 0.5 %.
TEST(Forecast, StatesAnIntervalThatHolds) {
  int inside = 0;
  constexpr int kSeries = 2000;
  for (unsigned seed = 1; seed <= kSeries; ++seed) {
    auto values = noise(9, 0.02, seed);
    const double next = values.back().value, day = values.back().day;
    values.pop_back();
    // The interval's ends are where a limit is just reached on that day: found by asking with the value as the limit.
    std::vector<ChartValue> shifted = values;
    const auto reached = [&](const Limits& limits) {
      auto f = forecast(shifted, limits, 7);
      return f && f->earliest_day && *f->earliest_day <= day;
    };
    if (reached({.upper = next}) && reached({.lower = next})) ++inside;
  }
  EXPECT_NEAR(inside / static_cast<double>(kSeries), 0.9545, 4 * 0.005);
}

TEST(Forecast, NeedsValuesOfSeveralDays) {
  EXPECT_FALSE(forecast(std::vector<ChartValue>(6, {3, 1}), {.upper = 2}));
  EXPECT_FALSE(forecast(noise(3, 0, 1), {.upper = 2}));
}

TEST(DayOf, CountsFromTheEpoch) {
  EXPECT_DOUBLE_EQ(day_of("1970-01-02T12:00:00Z"), 1.5);
  EXPECT_DOUBLE_EQ(day_of("2026-11-22T00:00:00Z"), 20779);
  EXPECT_THROW(day_of("22.11.2026"), InputError);
  EXPECT_THROW(day_of("2026-02-30T00:00:00Z"), InputError);
}

}  // namespace
}  // namespace fringecal::metrology

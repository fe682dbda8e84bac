#include "metrology/control_chart.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

namespace fringecal::metrology {
namespace {

constexpr double kLambda = 0.2, kEwmaWidth = 2.7, kCusumSlack = 0.5, kCusumLimit = 5, kRangeFactor = 1.128;

}  // namespace

const char* name_of(Signal signal) {
  switch (signal) {
    case Signal::shewhart:
      return "Shewhart";
    case Signal::ewma:
      return "EWMA";
    case Signal::cusum:
      return "CUSUM";
  }
  throw std::logic_error("a signal without a name");
}

Result<ControlChart> control_chart(const std::vector<ChartValue>& values, int n_baseline) {
  require(n_baseline >= 5, "a baseline has at least 5 values");
  if (values.size() < 5) {
    return unanswerable(fmt::format("a control chart needs at least 5 values, not {}", values.size()));
  }
  ControlChart out;
  out.n_baseline = std::min(n_baseline, static_cast<int>(values.size()));
  double range = 0;
  for (int i = 0; i < out.n_baseline; ++i) {
    out.mean += values[i].value / out.n_baseline;
    if (i > 0) range += std::abs(values[i].value - values[i - 1].value) / (out.n_baseline - 1);
  }
  out.s = range / kRangeFactor;  // eq. 1
  if (!(out.s > 0))
    return unanswerable("the values of the baseline are all the same, so they have no limits of control");
  double z = out.mean, high = 0, low = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double x = values[i].value;
    ChartPoint point;
    z = kLambda * x + (1 - kLambda) * z;  // eq. 3
    point.ewma = z;
    point.ewma_limit =
        kEwmaWidth * out.s *
        std::sqrt(kLambda / (2 - kLambda) * (1 - std::pow(1 - kLambda, 2.0 * static_cast<double>(i + 1))));
    high = std::max(0.0, high + (x - out.mean) / out.s - kCusumSlack);  // eq. 4
    low = std::max(0.0, low - (x - out.mean) / out.s - kCusumSlack);
    point.cusum_high = high;
    point.cusum_low = low;
    if (std::abs(x - out.mean) > 3 * out.s) point.signals.push_back(Signal::shewhart);  // eq. 2
    if (std::abs(z - out.mean) > point.ewma_limit) point.signals.push_back(Signal::ewma);
    if (std::max(high, low) > kCusumLimit) point.signals.push_back(Signal::cusum);
    out.points.push_back(point);
  }
  return out;
}

Result<Forecast> forecast(const std::vector<ChartValue>& values, const Limits& limits, double horizon_days,
                          double coverage) {
  const auto n = static_cast<double>(values.size());
  if (values.size() < 4) {
    return unanswerable(fmt::format("a forecast needs at least 4 values, not {}", values.size()));
  }
  double mean_t = 0, mean_x = 0;
  for (const auto& v : values) {
    mean_t += v.day / n;
    mean_x += v.value / n;
  }
  double s_tt = 0, s_tx = 0;
  for (const auto& v : values) {
    s_tt += (v.day - mean_t) * (v.day - mean_t);
    s_tx += (v.day - mean_t) * (v.value - mean_x);
  }
  if (!(s_tt > 0)) return unanswerable("all values are of one day, so they show no trend");
  Forecast out{.slope_per_day = s_tx / s_tt};
  double squares = 0;
  for (const auto& v : values) {
    const double r = v.value - mean_x - out.slope_per_day * (v.day - mean_t);
    squares += r * r;
  }
  const double s_r = std::sqrt(squares / (n - 2)), t_p = student_factor(n - 2, coverage);
  out.u_slope_per_day = s_r / std::sqrt(s_tt);
  const double last = values.back().day;
  const auto outside = [&](double low, double high) {
    return (limits.upper && high >= *limits.upper) || (limits.lower && low <= *limits.lower);
  };
  constexpr double kStepDays = 1;
  for (double t = last; t <= last + horizon_days; t += kStepDays) {
    const double x = mean_x + out.slope_per_day * (t - mean_t);
    const double half = t_p * s_r * std::sqrt(1 + 1 / n + (t - mean_t) * (t - mean_t) / s_tt);  // eq. 5
    if (!out.earliest_day && outside(x - half, x + half)) out.earliest_day = t;
    if (!out.expected_day && outside(x, x)) out.expected_day = t;
  }
  return out;
}

double day_of(const std::string& date) {
  int year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0;
  if (std::sscanf(date.c_str(), "%4d-%2d-%2dT%2d:%2d:%2dZ", &year, &month, &day, &hour, &minute, &second) != 6) {
    throw InputError(fmt::format("\"{}\" is not a date like 2026-11-22T08:30:00Z", date));
  }
  const std::chrono::year_month_day ymd{std::chrono::year(year), std::chrono::month(static_cast<unsigned>(month)),
                                        std::chrono::day(static_cast<unsigned>(day))};
  if (!ymd.ok()) throw InputError(fmt::format("\"{}\" is not a day of the calendar", date));
  return static_cast<double>(std::chrono::sys_days(ymd).time_since_epoch().count()) +
         (hour * 3600 + minute * 60 + second) / 86400.0;
}

}  // namespace fringecal::metrology

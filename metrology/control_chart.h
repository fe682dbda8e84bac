// Control charts of a quantity over time, and a forecast of when it reaches a limit.
//
// The baseline is the first n_baseline values (at least 5). Mean m of them, and the standard deviation of short time
// from their moving ranges: s = mean |x_i - x_{i-1}| / 1.128                                               (1) [ISO7870-2, table 1: d2(2)]
//   Shewhart  |x - m| > 3 s: signal                                                                           (2) [ISO7870-2]
//   EWMA      z_i = lambda x_i + (1 - lambda) z_{i-1}, z_0 = m; lambda = 0.2;
//             |z_i - m| > 2.7 s sqrt(lambda / (2 - lambda) (1 - (1 - lambda)^{2 i})): signal                   (3) [ISO7870-6]
//   CUSUM     C+_i = max(0, C+_{i-1} + (x_i - m) / s - 1/2), C- likewise; above 5: signal                      (4) [ISO7870-4]
// Forecast: a straight line through all values since the last adjustment, by least squares over time t (days),
//   x(t) = a + b t; a future value lies in x(t) +- t_p(n - 2) s_r sqrt(1 + 1/n + (t - tm)^2 / S_tt)            (5)
// The limit is reached at the first t, within `horizon_days`, at which it lies inside that interval; `expected` where the line
// itself meets it. It warns; it is *not* a recalibration date.
#pragma once

#include "core/result.h"
#include "metrology/decision.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

struct ChartValue {
  double day = 0;  // since any origin
  double value = 0;
};

enum class Signal { shewhart, ewma, cusum };
const char* name_of(Signal signal);

struct ChartPoint {
  double ewma = 0, ewma_limit = 0, cusum_high = 0, cusum_low = 0;
  std::vector<Signal> signals;
};

struct ControlChart {
  double mean = 0, s = 0;
  int n_baseline = 0;
  std::vector<ChartPoint> points;  // one per value
};

/// Eqs. 1 to 4. No result: fewer than 5 values, or a baseline without any scatter.
Result<ControlChart> control_chart(const std::vector<ChartValue>& values, int n_baseline = 10);

struct Forecast {
  double slope_per_day = 0, u_slope_per_day = 0;
  std::optional<double> earliest_day, expected_day;  // of reaching a limit; absent: not within the horizon
};

/// Eq. 5. No result: fewer than 4 values or all on one day.
Result<Forecast> forecast(const std::vector<ChartValue>& values, const Limits& limits, double horizon_days = 730,
                          double coverage = kCoverage);

/// Days since 1970-01-01 of an RFC 3339 UTC date. Throws InputError.
double day_of(const std::string& rfc3339);

}  // namespace fringecal::metrology

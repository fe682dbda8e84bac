// Propagation of distributions by a Monte Carlo method.
//   y_r = f(x_r), x_r drawn from the joint distribution of the inputs, r = 1 .. M                    (1) [JCGM101, 7.2, 7.3]
//   y = mean of y_r,  u(y) = their standard deviation (M - 1)                                        (2) [JCGM101, 7.6]
//   symmetric interval: the (1 - p)/2 and (1 + p)/2 quantiles of the sorted y_r; shortest: the       (3) [JCGM101, 7.7]
//   narrowest [y_(r), y_(r+q)], q = round(p M)
// Adaptive [JCGM101, 7.9]: blocks of M = max(10^4, ceil(100 / (1 - p))) trials until twice the standard error of each of
// y, u, y_low, y_high over the blocks is below the numerical tolerance of u:
//   delta = 10^l / 2,  u = c 10^l with c of n_dig digits                                             (4) [JCGM101, 7.9.2]
// and the result is taken from all trials together. Where max_trials end it first, `stable` is false.
//
// Validation of the GUM's result [JCGM101, 8]:
//   d_low = |y - U - y_low|,  d_high = |y + U - y_high|; valid when neither exceeds delta of u(y)        (5)
//
// Deterministic: block b has the generator of seed and b; the result does not depend on the number of threads.
// Distributions: [JCGM101, 6.4]; of the inputs whose Form is student_t, u is the scale.
#pragma once

#include "metrology/budget.h"

#include <cstdint>
#include <functional>
#include <span>

namespace fringecal::metrology {

/// An input and its distribution. `limits_d` > 0 makes a rectangular distribution one with inexactly known limits,
/// the curvilinear trapezoid of [JCGM101, 6.4.3]: half-width d of each limit.
struct RandomInput {
  double mean = 0;
  Form form = Form::normal;
  double scale = 1;  // normal: standard deviation; student_t: scale; rectangular, triangular, arcsine: half-width
  double nu = kInfiniteNu;
  double limits_d = 0;
};

using MeasurementModel = std::function<double(std::span<const double> inputs)>;

struct MonteCarloOptions {
  double coverage = 0.95;
  int digits = 2;  // of u that must be stable, eq. 4
  std::uint64_t seed = 1;
  std::int64_t max_trials = 10'000'000;
};

struct MonteCarloResult {
  double y = 0, u = 0;
  double symmetric_low = 0, symmetric_high = 0, shortest_low = 0, shortest_high = 0;
  double coverage = 0.95;
  std::int64_t trials = 0;
  bool stable = false;
};

/// Eqs. 1 to 4. A model that gives a value that is not finite: std::logic_error.
MonteCarloResult propagate(const MeasurementModel& model, std::span<const RandomInput> inputs,
                           const MonteCarloOptions& options = {});

/// Eq. 4.
double numerical_tolerance(double u, int digits);

struct Validation {
  double d_low = 0, d_high = 0, tolerance = 0;
  bool valid = false;
};

/// Eq. 5, for y +- U against the symmetric interval of the Monte Carlo.
Validation validate(double y, double u, double U, const MonteCarloResult& result, int digits = 2);

/// The input that a contribution stands for, about zero: u is turned into the half-width of its form.
RandomInput random_input(const Contribution& contribution);

}  // namespace fringecal::metrology

#include "metrology/monte_carlo.h"

#include "core/error.h"
#include "core/parallel.h"

#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>
#include <boost/random/student_t_distribution.hpp>
#include <boost/random/uniform_01.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fringecal::metrology {
namespace {

using Generator = boost::random::mt19937_64;

double draw(const RandomInput& input, Generator& generator) {
  boost::random::uniform_01<double> uniform;
  switch (input.form) {
    case Form::normal:
      return boost::random::normal_distribution<double>(input.mean, input.scale)(generator);
    case Form::student_t:
      if (!std::isfinite(input.nu)) {
        return boost::random::normal_distribution<double>(input.mean, input.scale)(generator);
      }
      return input.mean + input.scale * boost::random::student_t_distribution<double>(input.nu)(generator);
    case Form::rectangular: {
      // [JCGM101, 6.4.3.4]: the limits themselves drawn, symmetric about the mean.
      const double half = input.scale + input.limits_d * (1 - 2 * uniform(generator));
      return input.mean + half * (2 * uniform(generator) - 1);
    }
    case Form::triangular: {
      const double first = uniform(generator);
      return input.mean + input.scale * (first + uniform(generator) - 1);
    }
    case Form::arcsine:
      return input.mean + input.scale * std::sin(2 * std::numbers::pi * uniform(generator));
  }
  throw std::logic_error("a form of distribution that cannot be drawn");
}

struct Summary {
  double y = 0, u = 0, symmetric_low = 0, symmetric_high = 0, shortest_low = 0, shortest_high = 0;
};

Summary summary_of(std::vector<double>& values, double coverage) {
  std::sort(values.begin(), values.end());
  const auto m = static_cast<std::int64_t>(values.size());
  Summary out;
  for (const double v : values) out.y += v;
  out.y /= static_cast<double>(m);
  double squares = 0;
  for (const double v : values) squares += (v - out.y) * (v - out.y);
  out.u = std::sqrt(squares / static_cast<double>(m - 1));  // eq. 2
  const auto q = static_cast<std::int64_t>(std::llround(coverage * static_cast<double>(m)));
  const std::int64_t r = (m - q) / 2;  // eq. 3
  out.symmetric_low = values[r];
  out.symmetric_high = values[std::min(m - 1, r + q)];
  std::int64_t best = 0;
  for (std::int64_t i = 1; i + q < m; ++i) {
    if (values[i + q] - values[i] < values[best + q] - values[best]) best = i;
  }
  out.shortest_low = values[best];
  out.shortest_high = values[std::min(m - 1, best + q)];
  return out;
}

std::vector<double> block_of(const MeasurementModel& model, std::span<const RandomInput> inputs, std::int64_t trials,
                             std::uint64_t seed, std::int64_t block) {
  // Blocks are seeded by an odd multiplier (the golden ratio's), so that neighbouring seeds share no block.
  Generator generator(seed + 0x9E3779B97F4A7C15ULL * static_cast<std::uint64_t>(block + 1));
  std::vector<double> x(inputs.size()), values(static_cast<std::size_t>(trials));
  for (auto& value : values) {
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = draw(inputs[i], generator);
    value = model(x);  // eq. 1
    require(std::isfinite(value), "a measurement model gives a finite value for every draw");
  }
  return values;
}

/// Twice the standard error of one figure over the blocks.
double doubled_error(const std::vector<Summary>& blocks, double Summary::*figure) {
  const auto h = static_cast<double>(blocks.size());
  double mean = 0, squares = 0;
  for (const auto& b : blocks) mean += b.*figure / h;
  for (const auto& b : blocks) squares += (b.*figure - mean) * (b.*figure - mean);
  return 2 * std::sqrt(squares / (h * (h - 1)));
}

}  // namespace

double numerical_tolerance(double u, int digits) {
  require(u > 0 && digits >= 1 && digits <= 6, "a tolerance belongs to a positive u and 1 to 6 digits");
  // u = c 10^l with c an integer of `digits` digits after rounding: 0.0999 to one digit is 1 x 10^-1.
  int l = static_cast<int>(std::floor(std::log10(u))) - (digits - 1);
  if (std::round(u / std::pow(10.0, l)) >= std::pow(10.0, digits)) ++l;
  return 0.5 * std::pow(10.0, l);  // eq. 4
}

MonteCarloResult propagate(const MeasurementModel& model, std::span<const RandomInput> inputs,
                           const MonteCarloOptions& options) {
  require(options.coverage > 0 && options.coverage < 1, "a coverage probability lies between 0 and 1");
  const auto per_block =
      std::max<std::int64_t>(10'000, static_cast<std::int64_t>(std::ceil(100 / (1 - options.coverage))));
  constexpr std::int64_t kRound = 8;  // blocks made side by side before the test of stability
  std::vector<double> all;
  std::vector<Summary> blocks;
  bool stable = false;
  while (!stable && static_cast<std::int64_t>(all.size()) < options.max_trials) {
    const auto first = static_cast<std::int64_t>(blocks.size());
    std::vector<std::vector<double>> values(kRound);
    blocks.resize(static_cast<std::size_t>(first + kRound));
    parallel_for(kRound, [&](int i) {
      values[i] = block_of(model, inputs, per_block, options.seed, first + i);
      blocks[static_cast<std::size_t>(first + i)] = summary_of(values[i], options.coverage);
    });
    for (const auto& v : values) all.insert(all.end(), v.begin(), v.end());
    double mean_u = 0;
    for (const auto& b : blocks) mean_u += b.u / static_cast<double>(blocks.size());
    if (!(mean_u > 0)) {
      stable = true;  // nothing varies
      break;
    }
    const double tolerance = numerical_tolerance(mean_u, options.digits);
    stable = true;
    for (const auto figure : {&Summary::y, &Summary::u, &Summary::symmetric_low, &Summary::symmetric_high,
                              &Summary::shortest_low, &Summary::shortest_high}) {
      stable = stable && doubled_error(blocks, figure) < tolerance;
    }
  }
  const Summary s = summary_of(all, options.coverage);
  return {.y = s.y,
          .u = s.u,
          .symmetric_low = s.symmetric_low,
          .symmetric_high = s.symmetric_high,
          .shortest_low = s.shortest_low,
          .shortest_high = s.shortest_high,
          .coverage = options.coverage,
          .trials = static_cast<std::int64_t>(all.size()),
          .stable = stable};
}

Validation validate(double y, double u, double U, const MonteCarloResult& result, int digits) {
  Validation out{.d_low = std::abs(y - U - result.symmetric_low),
                 .d_high = std::abs(y + U - result.symmetric_high),
                 .tolerance = u > 0 ? numerical_tolerance(u, digits) : 0};
  out.valid = out.d_low <= out.tolerance && out.d_high <= out.tolerance;  // eq. 5
  return out;
}

RandomInput random_input(const Contribution& c) {
  double scale = c.u;
  if (c.form == Form::rectangular) scale = c.u * std::sqrt(3.0);
  if (c.form == Form::triangular) scale = c.u * std::sqrt(6.0);
  if (c.form == Form::arcsine) scale = c.u * std::numbers::sqrt2;
  return {.mean = 0, .form = c.form, .scale = scale, .nu = c.nu};
}

}  // namespace fringecal::metrology

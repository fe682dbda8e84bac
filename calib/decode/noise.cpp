#include "calib/decode/noise.h"

#include "core/parallel.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

namespace fringecal::decode {
namespace {

constexpr int kBins = 32;
/// Second differences use every kStride-th row (or column) triple: 350 000 of the 1.4 million pixels, sigma to 0.1 %.
constexpr int kStride = 4;

using Bins = std::array<std::vector<float>, kBins>;

/// Rows of r (eq. 1) and of the level at which its noise is counted; unusable pixels have level < 0.
struct ResidualRow {
  std::vector<float> r, level;
};

/// One linear combination of frames, of unit norm, and how its level is found.
struct Combination {
  std::vector<std::size_t> frames;
  std::vector<float> weights;
};

std::vector<Combination> combinations_for(const AxisFrames& frames) {
  const int n = static_cast<int>(frames.phase.size());
  if (n >= 4) {
    Combination out{.frames = frames.phase, .weights = {}};
    const double c = n % 2 == 0 ? std::sqrt(1.0 / n) : std::sqrt(2.0 / n);
    const int fastest = n / 2;  // periods over the n steps, rounded down
    for (int k = 0; k < n; ++k) {
      out.weights.push_back(static_cast<float>(c * std::cos(2 * std::numbers::pi * fastest * k / n)));  // (1)
    }
    return {out};
  }
  std::vector<Combination> out;
  for (const std::size_t f : frames.phase) out.push_back({{f}, {1.0f}});
  if (out.empty()) {
    for (const auto& f : {frames.white, frames.black}) {
      if (f) out.push_back({{*f}, {1.0f}});
    }
  }
  if (out.empty()) {
    for (const std::size_t f : frames.gray) out.push_back({{f}, {1.0f}});
  }
  return out;
}

void load_residual(const Capture& capture, const Combination& combination, int y, ResidualRow& out,
                   std::vector<float>& buffer) {
  const auto top = static_cast<float>(capture.saturation_level());
  std::fill(out.r.begin(), out.r.end(), 0.0f);
  std::fill(out.level.begin(), out.level.end(), 0.0f);
  const float share = 1.0f / static_cast<float>(combination.frames.size());
  for (std::size_t k = 0; k < combination.frames.size(); ++k) {
    load_row(capture.frames[combination.frames[k]], y, buffer);
    const float w = combination.weights[k];
    for (std::size_t x = 0; x < buffer.size(); ++x) {
      const float value = buffer[x];
      out.r[x] += w * value;
      // At an end of the scale the noise is cut off; minus infinity survives the sum.
      out.level[x] += value <= 0 || value >= top ? -std::numeric_limits<float>::infinity() : share * value;
    }
  }
}

/// Second differences (eq. 2) of one triple of rows, or within one row.
void collect(const std::array<const ResidualRow*, 3>& rows, bool within_row, float level_to_bin, Bins& bins) {
  constexpr float kNorm = 0.40824829f;  // 1 / sqrt(6)
  const std::size_t width = rows[1]->r.size(), margin = within_row ? 1 : 0;
  for (std::size_t x = margin; x + margin < width; ++x) {
    const std::size_t before = x - margin, after = x + margin;
    const float level = rows[1]->level[x];
    if (!(level >= 0 && rows[0]->level[before] >= 0 && rows[2]->level[after] >= 0)) continue;
    const int bin = std::min(kBins - 1, static_cast<int>(level * level_to_bin));
    bins[static_cast<std::size_t>(bin)].push_back(kNorm * (rows[0]->r[before] - 2 * rows[1]->r[x] + rows[2]->r[after]));
  }
}

/// Variance of the values without what lies beyond four standard deviations, as if nothing had been cut from a normal
/// distribution. Starts at the median of the absolute values, which quantisation coarsens; two rounds of clipping mend
/// that.
double clipped_variance(std::vector<float>& values) {
  std::vector<float> sizes(values.size());
  std::transform(values.begin(), values.end(), sizes.begin(), [](float v) { return std::abs(v); });
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  double sigma = std::max(0.3, *middle / 0.6745);  // 0.3: the quantisation step's own 1/sqrt(12)
  constexpr double kClip = 4.0, kKept = 0.99893;   // variance of a normal distribution cut at 4 sigma
  for (int round = 0; round < 3; ++round) {
    double sum = 0;
    std::size_t n = 0;
    const auto limit = static_cast<float>(kClip * sigma);
    for (const float v : values) {
      if (std::abs(v) > limit) continue;
      sum += static_cast<double>(v) * v;
      ++n;
    }
    sigma = std::sqrt(sum / static_cast<double>(n) / kKept);
    sigma = std::max(sigma, 1e-3);
  }
  return sigma * sigma;
}

struct Point {
  double level, variance, count;
};

/// The line read + gain I through the bins; a variance from n values has the relative variance 2 / n, so n / variance^2
/// is its weight.
NoiseModel line_through(const std::vector<Point>& points) {
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0;
  for (const Point& p : points) {
    const double weight = p.count / (p.variance * p.variance);
    w += weight;
    wx += weight * p.level;
    wy += weight * p.variance;
    wxx += weight * p.level * p.level;
    wxy += weight * p.level * p.variance;
  }
  const double mean_level = wx / w, mean_variance = wy / w, spread = wxx / w - mean_level * mean_level;
  NoiseModel out;
  // One narrow level says nothing of the slope: under two grey levels of spread the line is flat.
  if (spread > 4.0) out.gain = std::max(0.0, (wxy / w - mean_level * mean_variance) / spread);
  out.read_variance = mean_variance - out.gain * mean_level;
  if (out.read_variance < 0) {
    out.gain = wxy / wxx;
    out.read_variance = 0;
  }
  return out;
}

}  // namespace

double NoiseModel::sigma(double level) const {
  return std::sqrt(std::max(1.0 / 12.0, read_variance + gain * std::max(0.0, level)));
}

NoiseModel estimate_noise(const Capture& capture, const AxisFrames& frames) {
  const auto width = static_cast<std::size_t>(capture.info.width_px);
  const int height = capture.info.height_px;
  const bool within_row = frames.axis == CodeAxis::y;  // the fringes of axis y run along the rows
  const float level_to_bin = static_cast<float>(kBins) / static_cast<float>(capture.saturation_level() + 1);
  const std::vector<Combination> combinations = combinations_for(frames);
  // Bands of rows fill bins of their own, joined in their order: the same bins whatever the thread count.
  constexpr int kBand = 64;
  const int bands = (height + kBand - 1) / kBand;
  std::vector<Bins> band_bins(static_cast<std::size_t>(bands));
  parallel_for(bands, [&](int band) {
    Bins& bins = band_bins[static_cast<std::size_t>(band)];
    std::vector<float> buffer(width);
    std::array<ResidualRow, 3> rows;
    for (auto& row : rows) row = {std::vector<float>(width), std::vector<float>(width)};
    const int end = std::min(height, (band + 1) * kBand);
    for (const Combination& combination : combinations) {
      for (int y = band * kBand; y + (within_row ? 0 : 2) < end; y += kStride) {
        for (int k = 0; k < (within_row ? 1 : 3); ++k) {
          load_residual(capture, combination, y + k, rows[static_cast<std::size_t>(k)], buffer);
        }
        if (within_row) {
          collect({&rows[0], &rows[0], &rows[0]}, true, level_to_bin, bins);
        } else {
          collect({&rows[0], &rows[1], &rows[2]}, false, level_to_bin, bins);
        }
      }
    }
  });
  std::vector<Point> points;
  std::size_t samples = 0;
  for (std::size_t b = 0; b < kBins; ++b) {
    std::vector<float> values;
    for (const Bins& bins : band_bins) values.insert(values.end(), bins[b].begin(), bins[b].end());
    if (values.size() < 100) continue;  // too few for a variance of its own
    samples += values.size();
    points.push_back(
        {(static_cast<double>(b) + 0.5) / level_to_bin, clipped_variance(values), static_cast<double>(values.size())});
  }
  if (samples < kMinSamples) {
    const double level = (capture.saturation_level() + 1) / 256.0;
    return {.read_variance = level * level,
            .gain = 0,
            .source = fmt::format("assumed: one grey level at 8 bit, because only {} pixels could tell", samples)};
  }
  NoiseModel out = line_through(points);
  out.source =
      fmt::format("estimated from {} second differences along the fringes of {}", samples,
                  frames.phase.size() >= 4 ? "the phase frames' residual" : "the single frames (upper estimate)");
  return out;
}

}  // namespace fringecal::decode

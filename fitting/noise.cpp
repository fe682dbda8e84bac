#include "fitting/noise.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fringecal::fitting {
namespace {

/// The residuals over their grid, and where there is one.
struct Grid {
  int width = 0, height = 0;
  std::vector<double> d;  // zero where there is none
  std::vector<unsigned char> is;

  explicit Grid(std::span<const GridResidual> residuals) {
    int left = residuals[0].x, right = left, top = residuals[0].y, bottom = top;
    for (const GridResidual& r : residuals) {
      left = std::min(left, r.x);
      right = std::max(right, r.x);
      top = std::min(top, r.y);
      bottom = std::max(bottom, r.y);
    }
    width = right - left + 1;
    height = bottom - top + 1;
    const std::size_t n = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    d.assign(n, 0.0);
    is.assign(n, 0);
    for (const GridResidual& r : residuals) {
      const std::size_t i =
          static_cast<std::size_t>(r.y - top) * static_cast<std::size_t>(width) + static_cast<std::size_t>(r.x - left);
      d[i] = r.d_mm;
      is[i] = 1;
    }
  }

  struct Lag {
    double sum = 0, pairs = 0;
    double mean() const { return pairs > 0 ? sum / pairs : 0.0; }
  };
  Lag lag(int h, int v) const {
    Lag out;
    for (int y = 0; y + v < height; ++y) {
      const std::size_t a = static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
      const std::size_t b = static_cast<std::size_t>(y + v) * static_cast<std::size_t>(width);
      double sum = 0;
      int pairs = 0;
      for (int x = std::max(0, -h); x < std::min(width, width - h); ++x) {
        const std::size_t i = a + static_cast<std::size_t>(x), j = b + static_cast<std::size_t>(x + h);
        sum += d[i] * d[j];
        pairs += is[i] & is[j];
      }
      out.sum += sum;
      out.pairs += pairs;
    }
    return out;
  }
};

}  // namespace

Result<ResidualNoise> noise_of(std::span<const GridResidual> residuals, int parameters) {
  constexpr std::size_t kFewest = 100;
  constexpr double kWhite = 4.0;
  if (residuals.size() < kFewest) {
    return unanswerable(
        fmt::format("an autocorrelation needs {} residuals and there are {}", kFewest, residuals.size()));
  }
  const Grid grid(residuals);
  const double n = static_cast<double>(residuals.size()), variance = grid.lag(0, 0).mean();
  if (!(variance > 0.0)) return unanswerable("all residuals are zero, so they have no correlation");
  ResidualNoise out;
  const Grid::Lag row = grid.lag(1, 0), column = grid.lag(0, 1);
  const double pairs = row.pairs + column.pairs;
  out.z = pairs > 0 ? (row.sum + column.sum) / pairs / variance * std::sqrt(pairs) : 0.0;
  out.n_effective = n;
  if (std::abs(out.z) <= kWhite) return out;
  out.kind = ResidualKind::correlated;
  // Sums of pairs that exist, weighted with their number: a lag that few pairs have counts little.
  const int most = std::max(1, std::min(grid.width, grid.height) / 4);
  double sum = 1.0;
  for (int L = 1; L <= most; ++L) {
    const auto add = [&](int h, int v) {
      sum += 2.0 * grid.lag(h, v).sum / (n * variance);
    };  // eq. 1, and its opposite lag
    for (int v = 1; v < L; ++v) {
      add(L, v);
      add(-L, v);
    }
    add(L, 0);
    for (int h = -L; h <= L; ++h) add(h, L);
    const double area = (2.0 * L + 1.0) * (2.0 * L + 1.0), left = 1.0 - area * parameters / n;
    if (!(left > 0.1)) break;
    const double S = std::max(1.0, sum / left);  // eq. 3
    out.reach_px = L;
    out.inflation = std::sqrt(S);
    out.n_effective = n / S;
    if (L >= 2.2 * std::sqrt(S / std::numbers::pi)) return out;
  }
  out.kind = ResidualKind::form;
  out.n_effective = 1.0;
  return out;
}

}  // namespace fringecal::fitting

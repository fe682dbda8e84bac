#include "hw/virtual/point_spread.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::virt {
namespace {

double below(double x, double blur) {
  if (!(blur > 0)) return std::clamp(x + 0.5, 0.0, 1.0);
  const auto F = [&](double t) {
    const double z = t / blur;
    return t * 0.5 * std::erfc(-z / std::numbers::sqrt2) +
           blur * std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  };
  return F(x + 0.5) - F(x - 0.5);  // eq. 1
}

std::vector<Eigen::Vector2d> spread_samples(double blur, unsigned count) {
  std::vector<double> place(count);
  double variance = 0;
  for (unsigned i = 0; i < count; ++i) {
    double low = -0.5 - 8.0 * blur, high = 0.5 + 8.0 * blur;
    for (int step = 0; step < 60; ++step) {
      const double middle = 0.5 * (low + high);
      (below(middle, blur) < (i + 0.5) / count ? low : high) = middle;
    }
    place[i] = 0.5 * (low + high);
    variance += place[i] * place[i] / count;
  }
  const double scale = std::sqrt((blur * blur + 1.0 / 12.0) / variance);
  std::vector<Eigen::Vector2d> out;
  for (unsigned i = 0; i < count; ++i) {
    unsigned reversed = 0;
    for (unsigned bit = 1; bit < count; bit <<= 1) reversed = 2 * reversed + ((i & bit) != 0 ? 1 : 0);
    out.emplace_back(scale * place[i], scale * place[reversed]);
  }
  return out;
}

}  // namespace

PointSpread::PointSpread(double blur_px)
    : fine_(spread_samples(blur_px, kFine)), coarse_(spread_samples(blur_px, kCoarse)) {
  for (const auto& s : fine_) reach_px_ = std::max(reach_px_, std::abs(s.x()));
}

}  // namespace fringecal::virt

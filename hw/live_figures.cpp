#include "hw/live_figures.h"

#include "core/error.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace fringecal::hw {
namespace {

constexpr int kBlock = 32;
constexpr std::size_t kBlockClasses = 4096;

template <class Pixel>
LiveFigures figures(const Image<Pixel>& image, double saturation) {
  LiveFigures out;
  const auto n = static_cast<double>(image.size());
  std::vector<std::size_t> counts(static_cast<std::size_t>(saturation) + 1);
  for (const Pixel v : image.values()) ++counts[std::min<std::size_t>(v, counts.size() - 1)];
  double sum = 0, above = 0;
  for (std::size_t v = counts.size(); v-- > 0;) {
    const auto count = static_cast<double>(counts[v]);
    const double share = static_cast<double>(v) / saturation;
    if (above <= 1e-4 * n && above + count > 1e-4 * n) out.level = share;
    above += count;
    sum += share * count;
    out.histogram[std::min<std::size_t>(31, v * 32 / counts.size())] += count / n;  // eq. 1
  }
  out.mean = sum / n;
  out.saturated = static_cast<double>(counts.back()) / n;

  double squares = 0;
  for (int y = 1; y + 1 < image.height(); ++y) {
    const Pixel *above_row = image.row(y - 1).data(), *row = image.row(y).data(), *below = image.row(y + 1).data();
    double line = 0;
    for (int x = 1; x + 1 < image.width(); ++x) {
      const double dx = row[x + 1] - row[x - 1], dy = below[x] - above_row[x];
      line += dx * dx + dy * dy;
    }
    squares += line;
  }
  const double inner = static_cast<double>(image.width() - 2) * (image.height() - 2);
  if (out.mean > 0) out.sharpness = squares / (inner * saturation * saturation) / (out.mean * out.mean);  // eq. 2

  std::vector<double> contrasts;
  int shift = 0;
  while ((counts.size() - 1) >> shift >= kBlockClasses) ++shift;
  std::vector<std::uint16_t> in_block(((counts.size() - 1) >> shift) + 1);  // counted: faster than sorting them
  for (int y0 = 0; y0 + kBlock <= image.height(); y0 += kBlock) {
    for (int x0 = 0; x0 + kBlock <= image.width(); x0 += kBlock) {
      std::fill(in_block.begin(), in_block.end(), std::uint16_t{0});
      for (int y = 0; y < kBlock; ++y) {
        const Pixel* row = image.row(y0 + y).data() + x0;
        for (int x = 0; x < kBlock; ++x) ++in_block[std::min<std::size_t>(row[x] >> shift, in_block.size() - 1)];
      }
      const auto quantile = [&](double q) {
        const int below = static_cast<int>(q * (kBlock * kBlock - 1));
        std::size_t v = 0;
        for (int passed = in_block[0]; passed <= below; passed += in_block[v]) ++v;
        return static_cast<double>(v << shift);
      };
      const double high = quantile(0.95), low = quantile(0.05);
      if (high < 0.03 * saturation) continue;
      contrasts.push_back((high - low) / (high + low));  // eq. 3
    }
  }
  if (!contrasts.empty()) {
    const auto middle = contrasts.begin() + static_cast<std::ptrdiff_t>(contrasts.size() / 2);
    std::nth_element(contrasts.begin(), middle, contrasts.end());
    out.modulation = *middle;
  }
  return out;
}

}  // namespace

LiveFigures live_figures(const GrayImage& frame, int saturation_level) {
  require(saturation_level > 0 && width_of(frame) > 2 && height_of(frame) > 2, "a frame has levels and neighbours");
  return std::visit([&](const auto& image) { return figures(image, saturation_level); }, frame);
}

}  // namespace fringecal::hw

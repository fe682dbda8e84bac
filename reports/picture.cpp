#include "reports/picture.h"

#include "core/image_file.h"
#include "reports/number.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace fringecal::reports {
namespace {

struct Box {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // half open
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
};

/// The pixels with values and a margin of 3 % around them.
Box valid_box(const Image<float>& values) {
  Box box{values.width(), values.height(), 0, 0};
  for (int y = 0; y < values.height(); ++y) {
    for (int x = 0; x < values.width(); ++x) {
      if (!std::isfinite(values(x, y))) continue;
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
    }
  }
  const int margin = 2 + std::max(box.width(), box.height()) * 3 / 100;
  return {std::max(box.x0 - margin, 0), std::max(box.y0 - margin, 0), std::min(box.x1 + margin, values.width()),
          std::min(box.y1 + margin, values.height())};
}

Image<float> cut(const Image<float>& values, const Box& box) {
  Image<float> out(box.width(), box.height());
  for (int y = 0; y < out.height(); ++y) {
    const auto from = values.row(box.y0 + y).subspan(box.x0, out.width());
    std::copy(from.begin(), from.end(), out.row(y).begin());
  }
  return out;
}

std::string png_uri(const std::string& png) { return "data:image/png;base64," + base64(png); }

/// Multiples of 1, 2 or 5 times a power of ten, about `count` of them inside the range.
std::vector<double> ticks(double low, double high, int count) {
  const double raw = (high - low) / count;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double ratio = raw / power;
  const double step = power * (ratio <= 1.0 ? 1.0 : ratio <= 2.0 ? 2.0 : ratio <= 5.0 ? 5.0 : 10.0);
  std::vector<double> out;
  // Half a step of tolerance in 1e6 keeps an end that is a tick but for rounding.
  for (double k = std::ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; ++k) out.push_back(k * step);
  return out;
}

std::string number_for_tick(double value, double step) {
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  return fixed(value, std::min(decimals, 6));
}

std::string svg_text(double x, double y, std::string_view anchor, std::string_view words, std::string_view more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}>{}</text>", x, y, anchor, more,
                     escape(words));
}

std::string colour_bar_png(ColourMap map) {
  constexpr int kSteps = 128;
  Image<Rgb> bar(1, kSteps);
  for (int k = 0; k < kSteps; ++k) bar(0, k) = colour_at(map, 1.0 - (k + 0.5) / kSteps);
  return encode_png(bar);
}

/// Where things stand on the drawing.
struct Layout {
  static constexpr double kLeft = 40, kTop = 10, kBottom = 22, kGap = 14, kBar = 12, kRight = 70;
  double scale = 1;              // drawing px per image px
  double width = 0, height = 0;  // of the picture
};

/// Numbers of an axis over its pixels first .. last: the place of each, in pixels, and its words.
std::vector<std::pair<double, std::string>> numbers_of(const AxisScale& scale, int first, int last, int count) {
  const double a = scale.first + first * scale.step, b = scale.first + last * scale.step;
  std::vector<std::pair<double, std::string>> out;
  for (const double v : ticks(std::min(a, b), std::max(a, b), count)) {
    out.emplace_back((v - scale.first) / scale.step, fixed(v, 0));
  }
  return out;
}

std::string axis_numbers(const Box& box, const HeatMapOptions& options, const Layout& at) {
  std::string svg;
  for (const auto& [x, words] : numbers_of(options.x, box.x0, box.x1 - 1, 5)) {
    const double px = Layout::kLeft + (x + 0.5 - box.x0) * at.scale;
    svg += fmt::format("<path d=\"M{0:.1f},{1:.1f}v4\"/>", px, Layout::kTop + at.height);
    svg += svg_text(px, Layout::kTop + at.height + 16, "middle", words);
  }
  for (const auto& [y, words] : numbers_of(options.y, box.y0, box.y1 - 1, 4)) {
    const double py = Layout::kTop + (y + 0.5 - box.y0) * at.scale;
    svg += fmt::format("<path d=\"M{0:.1f},{1:.1f}h-4\"/>", Layout::kLeft, py);
    svg += svg_text(Layout::kLeft - 7, py + 4, "end", words);
  }
  return svg;
}

std::string colour_bar(const HeatMapOptions& options, Range range, const Layout& at) {
  const double x = Layout::kLeft + at.width + Layout::kGap, height = at.height;
  const double top = Layout::kTop + (at.height - height) / 2;
  std::string svg = fmt::format(
      "<image x=\"{:.1f}\" y=\"{:.1f}\" width=\"{}\" height=\"{:.1f}\" preserveAspectRatio=\"none\" href=\"{}\"/>", x,
      top, Layout::kBar, height, png_uri(colour_bar_png(options.map)));
  const auto marks = ticks(range.low * options.scale, range.high * options.scale, height > 120 ? 6 : 4);
  const double step = marks.size() > 1 ? marks[1] - marks[0] : 1.0;
  for (const double mark : marks) {
    const double t = (mark / options.scale - range.low) / (range.high - range.low);
    const double y = top + (1.0 - t) * height;
    svg += fmt::format("<path d=\"M{:.1f},{:.1f}h4\"/>", x + Layout::kBar, y);
    std::string words = number_for_tick(mark, step);
    if (options.map == ColourMap::diverging) words = with_sign(words);
    svg += svg_text(x + Layout::kBar + 7, y + 4, "start", words);
  }
  const double label_x = x + Layout::kBar + Layout::kRight - 16, label_y = top + height / 2;
  svg += svg_text(label_x, label_y, "middle", options.label,
                  fmt::format(" transform=\"rotate(-90 {:.1f} {:.1f})\"", label_x, label_y));
  return svg;
}

Image<Rgb> colourise(const Image<float>& values, Range range, ColourMap map) {
  Image<Rgb> out(values.width(), values.height());
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double v = values.values()[k];
    out.values()[k] = std::isfinite(v) ? colour_at(map, (v - range.low) / (range.high - range.low)) : kNoValue;
  }
  return out;
}

}  // namespace

std::optional<Range> robust_range(const Image<float>& values, ColourMap map) {
  std::vector<float> sorted;
  sorted.reserve(values.size());
  for (const float v : values.values()) {
    if (std::isfinite(v)) sorted.push_back(map == ColourMap::diverging ? std::abs(v) : v);
  }
  if (sorted.empty()) return std::nullopt;
  const auto quantile = [&](double q) {
    const auto k = static_cast<std::ptrdiff_t>(std::lround(q * static_cast<double>(sorted.size() - 1)));
    std::nth_element(sorted.begin(), sorted.begin() + k, sorted.end());
    return static_cast<double>(sorted[static_cast<std::size_t>(k)]);
  };
  Range range;
  if (map == ColourMap::diverging) {
    range.high = quantile(0.99);
    range.low = -range.high;
  } else {
    range = {quantile(0.005), quantile(0.995)};
  }
  // A constant image still needs two ends: float resolution around the value, or any width around zero.
  const double least = std::max(1e-6 * std::max(std::abs(range.low), std::abs(range.high)), 1e-12);
  if (!(range.high - range.low > least)) range = {range.low - least, range.high + least};
  return range;
}

Image<float> block_mean(const Image<float>& values, int k) {
  require(k >= 1, "a block has at least one pixel");
  const int width = (values.width() + k - 1) / k, height = (values.height() + k - 1) / k;
  Image<float> out(width, height, std::numeric_limits<float>::quiet_NaN());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int x1 = std::min((x + 1) * k, values.width()), y1 = std::min((y + 1) * k, values.height());
      double sum = 0;
      int n = 0;
      for (int v = y * k; v < y1; ++v) {
        for (int u = x * k; u < x1; ++u) {
          if (!std::isfinite(values(u, v))) continue;
          sum += values(u, v);
          ++n;
        }
      }
      if (n > 0 && 2 * n >= (x1 - x * k) * (y1 - y * k)) out(x, y) = static_cast<float>(sum / n);
    }
  }
  return out;
}

Markup heat_map(const Image<float>& values, const HeatMapOptions& options) {
  const auto range = robust_range(values, options.map);
  if (!range) return element("p", {{"class", "empty"}}, text("No values to show."));
  const Box box = options.zoom_to_valid ? valid_box(values) : Box{0, 0, values.width(), values.height()};
  const double room = options.width_px - Layout::kLeft - Layout::kGap - Layout::kBar - Layout::kRight;
  Layout at;
  at.scale = std::min(room / box.width(), static_cast<double>(options.max_height_px) / box.height());
  at.width = box.width() * at.scale;
  at.height = box.height() * at.scale;
  // About one and a quarter picture pixels per drawing pixel: sharp enough on paper, small in the file.
  const int k = std::max(1, static_cast<int>(std::floor(0.8 / at.scale + 0.5)));
  const Image<float> small = block_mean(cut(values, box), k);
  // Blocks may overhang the cut by part of a block.
  const double drawn_width = small.width() * k * at.scale, drawn_height = small.height() * k * at.scale;
  const double height = Layout::kTop + at.height + Layout::kBottom;
  std::string svg = fmt::format(
      "<svg class=\"map\" role=\"img\" viewBox=\"0 0 {0} {1:.1f}\" width=\"{0}\" height=\"{1:.1f}\">"
      "<svg x=\"{2}\" y=\"{3}\" width=\"{4:.2f}\" height=\"{5:.2f}\"><image width=\"{6:.2f}\" height=\"{7:.2f}\" "
      "preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"{8}\"/></svg>",
      options.width_px, height, Layout::kLeft, Layout::kTop, at.width, at.height, drawn_width, drawn_height,
      png_uri(encode_png(colourise(small, *range, options.map))));
  svg += fmt::format("<rect class=\"frame\" fill=\"none\" x=\"{}\" y=\"{}\" width=\"{:.2f}\" height=\"{:.2f}\"/>",
                     Layout::kLeft, Layout::kTop, at.width, at.height);
  svg += axis_numbers(box, options, at) + colour_bar(options, *range, at) + "</svg>";
  return Markup::trusted(svg);
}

Markup thumbnail(const GrayImage& image, int saturation_level, int max_width_px) {
  const int width = width_of(image), height = height_of(image);
  Image<float> values(width, height);
  std::visit([&](const auto& i) { std::copy(i.values().begin(), i.values().end(), values.values().begin()); }, image);
  const Image<float> small = block_mean(values, std::max(1, (width + max_width_px - 1) / max_width_px));
  Image8 gray(small.width(), small.height());
  for (std::size_t k = 0; k < small.size(); ++k) {
    const double level = 255.0 * small.values()[k] / std::max(saturation_level, 1);
    gray.values()[k] = static_cast<std::uint8_t>(std::lround(std::clamp(level, 0.0, 255.0)));
  }
  const std::string png = encode_png(GrayImage(gray));
  return element("img", {{"alt", "captured frame"}, {"src", png_uri(png)}}, Markup());
}

}  // namespace fringecal::reports

#include "reports/limit_figure.h"

#include "reports/number.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::reports {
namespace {

constexpr double kWidth = 640, kLabels = 168, kRight = 14, kTop = 8, kRow = 17, kBottom = 26;
constexpr double kEdge = 150;  // the scale ends at 150 % of the limit

struct Row {
  const ResultLine* line;
  double percent, half;  // value and U in percent of the limit
  bool lower, upper;
};

std::vector<Row> rows_of(const std::vector<ResultLine>& lines) {
  std::vector<Row> out;
  for (const auto& line : lines) {
    const auto& q = *line.quantity;
    if (!q.limits) continue;
    const auto limit = q.value < 0 ? (q.limits->lower ? q.limits->lower : q.limits->upper)
                                   : (q.limits->upper ? q.limits->upper : q.limits->lower);
    const double scale = std::abs(*limit);
    if (!(scale > 0)) continue;
    out.push_back({&line, 100 * q.value / scale, 100 * q.uncertainty.U / scale, q.limits->lower.has_value(),
                   q.limits->upper.has_value()});
  }
  return out;
}

std::string line_svg(double x1, double y1, double x2, double y2, const char* colour, double width) {
  return fmt::format(
      "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\" stroke-width=\"{}\"/>", x1, y1, x2,
      y2, colour, width);
}

std::string words_svg(double x, double y, const char* anchor, const std::string& words) {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"10.5\" fill=\"#1b1f24\">{}</text>",
                     x, y, anchor, escape(words));
}

Markup figure_of(const std::vector<Row>& rows) {
  const bool two_sided = std::any_of(rows.begin(), rows.end(), [](const Row& r) { return r.lower || r.percent < 0; });
  const double from = two_sided ? -kEdge : 0;
  const double height = kTop + kRow * static_cast<double>(rows.size()) + kBottom, foot = height - kBottom;
  const auto x_of = [&](double percent) {
    return kLabels + (std::clamp(percent, from, kEdge) - from) / (kEdge - from) * (kWidth - kLabels - kRight);
  };
  std::string svg = fmt::format(
      "<svg class=\"limits\" role=\"img\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1:.0f}\" "
      "width=\"{0}\" height=\"{1:.0f}\" font-family=\"Liberation Sans, Arial, sans-serif\">",
      kWidth, height);
  double y = kTop;
  for (const auto& row : rows) {
    const double middle = y + kRow / 2;
    const auto grey = [&](double a, double b) {
      svg += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{}\" fill=\"#d5d9de\"/>", x_of(a),
                         y, x_of(b) - x_of(a), kRow);
    };
    if (row.upper) grey(100, kEdge);
    if (row.lower && two_sided) grey(-kEdge, -100);
    if (&row != &rows.front()) svg += line_svg(kLabels, y, kWidth - kRight, y, "#ffffff", 1);
    std::string label = fmt::format("{}  {}", row.line->number, row.line->symbol);
    std::string place = row.line->artefact;
    if (place.size() > 20) place.clear();  // it stands in the table
    svg += words_svg(0, middle + 3.6, "start", label) + words_svg(kLabels - 8, middle + 3.6, "end", place);
    y += kRow;
  }
  for (const double tick : {-100.0, -50.0, 0.0, 50.0, 100.0}) {
    if (tick < from) continue;
    const bool strong = tick == 0 || std::abs(tick) == 100;
    svg += line_svg(x_of(tick), kTop, x_of(tick), foot + 4, strong ? "#1b1f24" : "#b9c0c8", strong ? 0.9 : 0.6);
    if (strong) svg += words_svg(x_of(tick), foot + 17, "middle", fixed(tick, 0) + "\u00a0%");
  }
  y = kTop;
  for (const auto& row : rows) {
    const double middle = y + kRow / 2, low = x_of(row.percent - row.half), high = x_of(row.percent + row.half);
    svg += line_svg(low, middle, high, middle, "#0b5a7a", 1.6) +
           line_svg(low, middle - 3.5, low, middle + 3.5, "#0b5a7a", 1.6) +
           line_svg(high, middle - 3.5, high, middle + 3.5, "#0b5a7a", 1.6);
    const double at = x_of(row.percent);
    if (row.percent > kEdge || row.percent < from) {
      const double back = row.percent > kEdge ? -8 : 8;
      svg += fmt::format("<path d=\"M{0:.1f} {1:.1f}l{2} -5v10z\" fill=\"#0b5a7a\"/>", at, middle, back);
    } else {
      svg += fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.6\" fill=\"#0b5a7a\"/>", at, middle);
    }
    y += kRow;
  }
  return Markup::trusted(svg + "</svg>");
}

}  // namespace

std::vector<Markup> limit_figures(const std::vector<ResultLine>& lines, std::size_t rows_per_figure) {
  const std::vector<Row> rows = rows_of(lines);
  std::vector<Markup> out;
  for (std::size_t k = 0; k < rows.size(); k += rows_per_figure) {
    const auto end = rows.begin() + static_cast<std::ptrdiff_t>(std::min(rows.size(), k + rows_per_figure));
    out.push_back(figure_of({rows.begin() + static_cast<std::ptrdiff_t>(k), end}));
  }
  return out;
}

}  // namespace fringecal::reports

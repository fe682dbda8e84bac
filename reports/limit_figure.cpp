#include "reports/limit_figure.h"

#include "reports/number.h"
#include "reports/svg.h"

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

Markup figure_of(const std::vector<Row>& rows) {
  const bool two_sided = std::any_of(rows.begin(), rows.end(), [](const Row& r) { return r.lower || r.percent < 0; });
  const double from = two_sided ? -kEdge : 0;
  const double height = kTop + kRow * static_cast<double>(rows.size()) + kBottom, foot = height - kBottom;
  const auto x_of = [&](double percent) {
    return kLabels + (std::clamp(percent, from, kEdge) - from) / (kEdge - from) * (kWidth - kLabels - kRight);
  };
  std::string drawing = svg::begin("limits", kWidth, height);
  double y = kTop;
  for (const auto& row : rows) {
    const double middle = y + kRow / 2;
    const auto grey = [&](double a, double b) {
      drawing += svg::box(x_of(a), y, x_of(b) - x_of(a), kRow, svg::kBeyond);
    };
    if (row.upper) grey(100, kEdge);
    if (row.lower && two_sided) grey(-kEdge, -100);
    if (&row != &rows.front()) drawing += svg::line(kLabels, y, kWidth - kRight, y, "#ffffff", 1);
    std::string label = fmt::format("{}  {}", row.line->number, row.line->symbol);
    std::string place = row.line->artefact;
    if (place.size() > 20) place.clear();  // it stands in the table
    drawing += svg::words(0, middle + 3.6, "start", label) + svg::words(kLabels - 8, middle + 3.6, "end", place);
    y += kRow;
  }
  for (const double tick : {-100.0, -50.0, 0.0, 50.0, 100.0}) {
    if (tick < from) continue;
    const bool strong = tick == 0 || std::abs(tick) == 100;
    drawing += svg::line(x_of(tick), kTop, x_of(tick), foot + 4, strong ? svg::kInk : svg::kQuiet, strong ? 0.9 : 0.6);
    if (strong) drawing += svg::words(x_of(tick), foot + 17, "middle", fixed(tick, 0) + "\u00a0%");
  }
  y = kTop;
  for (const auto& row : rows) {
    const double middle = y + kRow / 2, low = x_of(row.percent - row.half), high = x_of(row.percent + row.half);
    drawing += svg::line(low, middle, high, middle, svg::kBlue, 1.6) +
               svg::line(low, middle - 3.5, low, middle + 3.5, svg::kBlue, 1.6) +
               svg::line(high, middle - 3.5, high, middle + 3.5, svg::kBlue, 1.6);
    const double at = x_of(row.percent);
    if (row.percent > kEdge || row.percent < from) {
      const double back = row.percent > kEdge ? -8 : 8;
      drawing += fmt::format("<path d=\"M{0:.1f} {1:.1f}l{2} -5v10z\" fill=\"#0b5a7a\"/>", at, middle, back);
    } else {
      drawing += svg::mark(row.line->as_found ? svg::Mark::circle : svg::Mark::disc, at, middle);
    }
    y += kRow;
  }
  return Markup::trusted(drawing + svg::kEnd);
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

// Results over time, from the history that a certificate is issued from.
#include "metrology/control_chart.h"
#include "reports/certificate_figures.h"
#include "reports/certificate_html.h"
#include "reports/number.h"
#include "reports/svg.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::reports {
namespace {

constexpr double kWidth = 640, kPanelHeight = 132, kTop = 22, kLeft = 52, kRight = 12, kFoot = 26;
constexpr std::size_t kMostPanels = 6;

struct Point {
  double day = 0;
  std::string date;  // YYYY-MM-DD
  const PastResult* result;
};

/// One symbol of one artefact over time.
struct Course {
  std::string title, unit;
  std::vector<Point> points;
  std::optional<metrology::Limits> limits;  // of the newest
};

/// Of each verification the result of largest magnitude; of an alignment all.
std::vector<Course> courses_of(const std::vector<PastResult>& past, const char* kind) {
  std::vector<Course> out;
  std::vector<std::pair<std::string, std::string>> keys;  // symbol and artefact of each
  for (const auto& r : past) {
    if (r.kind != kind) continue;
    const std::pair key(r.symbol, r.artefact);
    const auto at = static_cast<std::size_t>(std::find(keys.begin(), keys.end(), key) - keys.begin());
    if (at == keys.size()) {
      keys.push_back(key);
      out.push_back(
          {r.artefact.empty() || r.artefact.size() > 24 ? r.symbol : r.symbol + ", " + r.artefact, r.unit, {}, {}});
    }
    auto& points = out[at].points;
    out[at].limits = r.limits;
    const bool alignment = r.kind == "alignment";
    if (!alignment && !points.empty() && points.back().result->entry == r.entry) {
      if (std::abs(r.value) > std::abs(points.back().result->value)) points.back().result = &r;
      continue;
    }
    points.push_back({metrology::day_of(r.date), r.date.substr(0, 10), &r});
  }
  return out;
}

/// About four multiples of 1, 2 or 5 times a power of ten within [low, high].
std::vector<double> ticks_in(double low, double high) {
  const double raw = (high - low) / 4, power = std::pow(10, std::floor(std::log10(raw))), ratio = raw / power;
  const double step = power * (ratio <= 1 ? 1 : ratio <= 2 ? 2 : ratio <= 5 ? 5 : 10);
  std::vector<double> out;
  for (double k = std::ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; ++k) out.push_back(k * step);
  return out;
}

std::string tick_text(double value) { return fmt::format("{:.4g}", std::abs(value) < 1e-12 ? 0.0 : value); }

struct Panel {
  double left, top, width;
};

/// Draws one course; appends the numbers it shows.
std::string draw(const Course& course, const Panel& panel, std::string& numbers) {
  double low = 0, high = 0;  // zero is always in sight: these are errors
  const auto see = [&](double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  };
  for (const auto& p : course.points) {
    see(p.result->value - p.result->U.value_or(0));
    see(p.result->value + p.result->U.value_or(0));
  }
  if (course.limits) {
    if (course.limits->lower) see(*course.limits->lower);
    if (course.limits->upper) see(*course.limits->upper);
  }
  if (!(high > low)) high = low + 1;
  const double room = 0.06 * (high - low);
  if (low < 0) low -= room;
  high += room;
  const double x0 = panel.left + kLeft, x1 = panel.left + panel.width - kRight;
  const double y0 = panel.top + kTop, y1 = panel.top + kPanelHeight - kFoot;
  const double first = course.points.front().day, last = course.points.back().day;
  const auto x_of = [&](double day) {
    return last > first ? x0 + 6 + (day - first) / (last - first) * (x1 - x0 - 12) : (x0 + x1) / 2;
  };
  const auto y_of = [&](double value) { return y1 - (value - low) / (high - low) * (y1 - y0); };
  std::string out = svg::words(panel.left + kLeft, panel.top + 13, "start", course.title + " / " + course.unit, 9.5);
  const auto beyond = [&](double from, double to) {
    out += svg::box(x0, y_of(to), x1 - x0, y_of(from) - y_of(to), svg::kBeyond);
  };
  if (course.limits && course.limits->upper) beyond(*course.limits->upper, high);
  if (course.limits && course.limits->lower) beyond(low, *course.limits->lower);
  for (const double tick : ticks_in(low, high)) {
    out += svg::line(x0, y_of(tick), x1, y_of(tick), svg::kQuiet, tick == 0 ? 1 : 0.5) +
           svg::words(x0 - 5, y_of(tick) + 3.2, "end", shown(tick_text(tick)), 8.5);
    numbers += " " + tick_text(tick);
  }
  if (course.limits) {
    for (const auto& limit : {course.limits->lower, course.limits->upper}) {
      if (limit) out += svg::line(x0, y_of(*limit), x1, y_of(*limit), svg::kInk, 1.1, "5 3");
    }
  }
  out += svg::box(x0, y0, x1 - x0, y1 - y0, "none", svg::kQuiet, 0.7);
  for (const auto& p : course.points) {
    const double x = x_of(p.day), y = y_of(p.result->value);
    if (const double U = p.result->U.value_or(0); U > 0) {
      const double a = y_of(p.result->value - U), b = y_of(p.result->value + U);
      out += svg::line(x, a, x, b, svg::kBlue, 1.3) + svg::line(x - 3, a, x + 3, a, svg::kBlue, 1.3) +
             svg::line(x - 3, b, x + 3, b, svg::kBlue, 1.3);
    }
    out += svg::mark(p.result->position == "as found" ? svg::Mark::circle : svg::Mark::disc, x, y, 3.1);
  }
  out += svg::words(x0, y1 + 13, "start", course.points.front().date, 8.5);
  numbers += " " + course.title + " " + course.unit + " " + course.points.front().date;
  if (course.points.back().date != course.points.front().date) {
    out += svg::words(x1, y1 + 13, "end", course.points.back().date, 8.5);
    numbers += " " + course.points.back().date;
  }
  return out;
}

std::optional<CertificateFigure> figure_of(std::vector<Course> courses, const char* name, const std::string& caption) {
  // What is judged comes first; one point is no course.
  std::erase_if(courses, [](const Course& c) { return c.points.size() < 2; });
  std::stable_partition(courses.begin(), courses.end(), [](const Course& c) { return c.limits.has_value(); });
  if (courses.size() > kMostPanels) courses.resize(kMostPanels);
  if (courses.empty()) return std::nullopt;
  const std::size_t per_row = courses.size() == 1 ? 1 : 2;
  const double rows = std::ceil(static_cast<double>(courses.size()) / static_cast<double>(per_row));
  std::string numbers, drawing = svg::begin(name, kWidth, rows * kPanelHeight);
  for (std::size_t k = 0; k < courses.size(); ++k) {
    const double width = kWidth / static_cast<double>(per_row);
    const std::size_t row = k / per_row, column = k % per_row;
    drawing += draw(courses[k], {static_cast<double>(column) * width, static_cast<double>(row) * kPanelHeight, width},
                    numbers);
  }
  return CertificateFigure{name, Markup::trusted(drawing + svg::kEnd), caption, numbers};
}

}  // namespace

std::vector<CertificateFigure> history_figures(const Certificate& c, const Catalogue& words) {
  std::vector<CertificateFigure> out;
  const auto add = [&](const char* kind, const char* name) {
    auto figure = figure_of(courses_of(c.past, kind), name, words(std::string("figures.") + name));
    if (figure) out.push_back(std::move(*figure));
  };
  add("verification", "history");
  add("alignment", "alignment");
  return out;
}

}  // namespace fringecal::reports

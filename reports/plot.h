// Plots as inline SVG, drawn by gnuplot's svg terminal: script and data on its standard input, no shell, no files, 20
// s.
//
// Deterministic for one version of gnuplot: its start-up files are not read, coordinates are written with the fewest
// digits that read back. Words in a plot are data, never gnuplot's or SVG's language. The ids inside are prefixed with
// `id` (letters, digits, underscore), which must be unique on the page.
// Errors: EnvironmentError where gnuplot is missing (with the package to install), too slow, or refuses the plot;
// std::logic_error for columns of different length or a number that is infinite. NaN in y breaks a line.
#pragma once

#include "reports/html.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fringecal::reports {

namespace ink {
inline constexpr const char* kPrimary = "#0b5a7a";
inline constexpr const char* kSecondary = "#b4501e";
inline constexpr const char* kQuiet = "#8a929c";
inline constexpr const char* kBand = "#f3d9b8";
}  // namespace ink

enum class Mark { line, steps, points, line_points, vectors };

struct Series {
  std::string label = {};  // in the key; empty: not in the key
  Mark mark = Mark::line;
  std::string colour = ink::kPrimary;
  double size = 1.4;  // line width in px, or point size
  bool right_axis = false;
  std::vector<double> x = {}, y = {};
  std::vector<double> u = {};            // half length of an error bar at each point; empty: none
  std::vector<double> dx = {}, dy = {};  // vectors only
};

struct Axis {
  std::string label = {};
  std::optional<std::pair<double, double>> range = {};  // first > second turns the axis round
  std::optional<double> tick = {};                      // distance of the numbers, which then start at 0
};

/// A strip of the x axis behind the data.
struct Band {
  double from = 0, to = 0;
};

/// A thin dashed line across, with its words outside at the right.
struct Level {
  double y = 0;
  std::string label;
};

struct Plot {
  int width_px = 500, height_px = 280;
  Axis x = {}, y = {};
  std::optional<Axis> right = {};
  std::vector<Series> series = {};
  std::vector<Band> bands = {};
  std::vector<Level> levels = {};
  bool equal_scales = false;  // one unit is as long on x as on y
};

Markup draw(const Plot& plot, const std::string& id);

}  // namespace fringecal::reports

#include "reports/plot.h"

#include "core/error.h"
#include "reports/process.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace fringecal::reports {
namespace {

constexpr std::chrono::seconds kLimit{20};
constexpr const char* kAdvice =
    "it draws the plots of the report: install the Debian package gnuplot-nox and run again";

/// A gnuplot string. Between single quotes nothing is special but the quote itself, which becomes a typographic one,
/// and the line's end.
std::string quoted(std::string_view words) {
  std::string out = "'";
  for (const char c : words) {
    if (c == '\'') {
      out += "\u2019";
    } else {
      out += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return out + "'";
}

std::string axis(std::string_view name, const Axis& a) {
  const char* const closer = name == "x" ? "0,0.6" : name == "y" ? "0.8,0" : "-0.8,0";
  std::string out = fmt::format("set {}label {} offset {} textcolor rgb '#3a424c'\n", name, quoted(a.label), closer);
  if (a.range) out += fmt::format("set {}range [{}:{}]\n", name, a.range->first, a.range->second);
  if (a.tick) out += fmt::format("set {}tics 0,{}\n", name, *a.tick);
  return out;
}

/// The columns of one series as a named block; a NaN in y becomes an empty line, which breaks the line drawn.
std::string data_block(const Series& s, std::size_t number) {
  require(s.x.size() == s.y.size() && (s.u.empty() || s.u.size() == s.x.size()) && s.dx.size() == s.dy.size() &&
              (s.mark != Mark::vectors || s.dx.size() == s.x.size()),
          "the columns of a plot have one length");
  std::string out = fmt::format("$d{} << END_OF_SERIES\n", number);
  for (std::size_t k = 0; k < s.x.size(); ++k) {
    if (std::isnan(s.y[k])) {
      out += '\n';
      continue;
    }
    require(std::isfinite(s.x[k]) && std::isfinite(s.y[k]), "a plotted number is finite");
    out += fmt::format("{} {}", s.x[k], s.y[k]);
    if (!s.u.empty()) out += fmt::format(" {}", s.u[k]);
    if (s.mark == Mark::vectors) out += fmt::format(" {} {}", s.dx[k], s.dy[k]);
    out += '\n';
  }
  return out + "END_OF_SERIES\n";
}

std::string clause(const Series& s, std::size_t number) {
  const std::string colour = fmt::format("lc rgb '{}'", s.colour);
  const std::string axes = s.right_axis ? " axes x1y2" : "";
  const std::string key = s.label.empty() ? " notitle" : " title " + quoted(s.label);
  const std::string data = fmt::format("$d{}", number);
  std::string bars;
  if (!s.u.empty()) bars = fmt::format("{} using 1:2:3{} with yerrorbars pt 0 lw 1 {} notitle, ", data, axes, colour);
  switch (s.mark) {
    case Mark::line:
      return fmt::format("{}{} using 1:2{} with lines lw {} {}{}", bars, data, axes, s.size, colour, key);
    case Mark::steps:
      return fmt::format("{}{} using 1:2{} with steps lw {} {}{}", bars, data, axes, s.size, colour, key);
    case Mark::points:
      return fmt::format("{}{} using 1:2{} with points pt 7 ps {} {}{}", bars, data, axes, s.size, colour, key);
    case Mark::line_points:
      return fmt::format("{}{} using 1:2{} with linespoints pt 7 ps {} lw 1 {}{}", bars, data, axes, s.size, colour,
                         key);
    case Mark::vectors:
      return fmt::format("{} using 1:2:3:4{} with vectors head size screen 0.008,22 filled lw {} {}{}", data, axes,
                         s.size, colour, key);
  }
  throw std::logic_error("broken contract: a series has a mark");
}

std::string script_for(const Plot& plot, const std::string& id) {
  require(!plot.series.empty(), "a plot has a series");
  std::string s = "set encoding utf8\nset minussign\nset pointintervalbox 0\n";
  s += fmt::format("set terminal svg size {},{} noenhanced name '{}' font 'sans-serif,12'\n", plot.width_px,
                   plot.height_px, id);
  s += "set border 3 lw 0.8 lc rgb '#5b6470'\nset tics nomirror out scale 0.6 textcolor rgb '#3a424c'\n"
       "set format x '%h'\nset format y '%h'\nset format y2 '%h'\nset xtics offset 0,0.35\nset ytics offset 0.5,0\n"
       "set grid xtics ytics lw 0.6 lc rgb '#e4e7eb' dt solid\n"
       "set key at graph 1.0, screen 0.985 right top horizontal maxrows 1 samplen 1.6 width -4 textcolor rgb "
       "'#3a424c'\n";
  const bool named =
      std::any_of(plot.series.begin(), plot.series.end(), [](const Series& one) { return !one.label.empty(); });
  if (!named) s += "unset key\n";
  s += axis("x", plot.x) + axis("y", plot.y);
  if (plot.right) s += "set border 11\nset y2tics\n" + axis("y2", *plot.right);
  std::size_t longest = 0;
  for (const auto& level : plot.levels) longest = std::max(longest, level.label.size());
  if (longest > 0) s += fmt::format("set rmargin {}\n", longest + 1);
  if (plot.equal_scales) s += "set size ratio -1\n";
  std::size_t object = 1;
  for (const auto& band : plot.bands) {
    s += fmt::format(
        "set object {} rectangle from first {}, graph 0 to first {}, graph 1 behind fc rgb '{}' fs solid noborder\n",
        object++, band.from, band.to, ink::kBand);
  }
  std::size_t arrow = 1;
  for (const auto& level : plot.levels) {
    s += fmt::format(
        "set arrow {0} from graph 0, first {1} to graph 1, first {1} nohead lw 1 dt (6,4) lc rgb '{2}'\n"
        "set label {0} {3} at graph 1.015, first {1} left front textcolor rgb '#5b6470'\n",
        arrow++, level.y, ink::kQuiet, quoted(level.label));
  }
  std::string clauses;
  for (std::size_t k = 0; k < plot.series.size(); ++k) {
    s += data_block(plot.series[k], k);
    clauses += (k > 0 ? ", " : "plot ") + clause(plot.series[k], k);
  }
  return s + clauses + "\n";
}

void replace_all(std::string& s, std::string_view what, std::string_view with) {
  for (std::size_t at = s.find(what); at != std::string::npos; at = s.find(what, at + with.size())) {
    s.replace(at, what.size(), with);
  }
}

/// Cuts what begins with `from` and ends with `to`, every time.
void cut_all(std::string& s, std::string_view from, std::string_view to) {
  for (std::size_t at = s.find(from); at != std::string::npos; at = s.find(from, at)) {
    const std::size_t end = s.find(to, at);
    require(end != std::string::npos, "gnuplot closes what it opens");
    s.erase(at, end + to.size() - at);
  }
}

/// gnuplot opens a group at every change of its pen, also where nothing follows.
void cut_empty_groups(std::string& s) {
  constexpr std::string_view kEnd = "</g>";
  for (std::size_t at = s.find("<g "); at != std::string::npos;) {
    const std::size_t inside = s.find('>', at) + 1;
    const std::size_t next = s.find_first_not_of(" \t\n", inside);
    if (std::string_view(s).substr(next, kEnd.size()) == kEnd) {
      s.erase(at, next + kEnd.size() - at);
    } else {
      ++at;
    }
    at = s.find("<g ", at);
  }
}

/// A document of its own becomes a part of a page: no prolog, no tool tips, ids that belong to this plot alone.
std::string inlined(std::string svg, const std::string& id) {
  svg.erase(0, svg.find("<svg"));
  cut_all(svg, "<title>", "</title>");
  cut_all(svg, "<desc>", "</desc>");
  cut_all(svg, "<filter ", "</filter>");
  cut_empty_groups(svg);
  replace_all(svg, "id='gp", fmt::format("id='{}-", id));
  replace_all(svg, "href='#gp", fmt::format("href='#{}-", id));
  replace_all(svg, "id=\"gnuplot_canvas\"", fmt::format("id=\"{}-canvas\"", id));
  svg.insert(4, " class=\"plot\" role=\"img\"");
  return svg;
}

}  // namespace

Markup draw(const Plot& plot, const std::string& id) {
  const FilterOutput drawn = run_filter({"gnuplot", "-d", "-"}, script_for(plot, id), kLimit, kAdvice);
  const bool complete = drawn.output.find("</svg>") != std::string::npos;
  if (drawn.status != 0 || !complete) {
    throw EnvironmentError(fmt::format("gnuplot did not draw the plot '{}' (exit status {}): {}", id, drawn.status,
                                       drawn.errors.substr(0, 400)));
  }
  return Markup::trusted(inlined(drawn.output, id));
}

}  // namespace fringecal::reports

#include "reports/commissioning_sections.h"
#include "reports/number.h"
#include "reports/picture.h"
#include "reports/plot.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace fringecal::reports {
namespace {

/// Half the columns of a zoom, in periods: two or three whole periods stay in view.
constexpr double kZoomPeriods = 1.3;
constexpr double kUnknownPeriod_px = 24;

struct Window {
  double from = 0, to = 0;
};

/// A jump of the plain absolute phase between neighbours: up or down by more than half a period.
struct Jump {
  std::size_t at = 0;  // between this column and the next
  bool up = false;
};

std::vector<Jump> jumps_of(const ProfileColumns& profile) {
  std::vector<Jump> out;
  for (std::size_t k = 0; k + 1 < profile.column_px.size(); ++k) {
    if (profile.column_px[k + 1] - profile.column_px[k] > 1.5) continue;
    const double step = profile.phase_rad[k + 1] - profile.phase_rad[k];
    if (std::abs(step) > std::numbers::pi) out.push_back({k, step > 0});
  }
  return out;
}

void check(const ProfileColumns& profile) {
  require(profile.column_px.size() == profile.gray_number.size() &&
              profile.column_px.size() == profile.phase_rad.size() && !profile.column_px.empty(),
          "the columns of a profile have one length and are not empty");
}

/// Around the jump nearest to the middle of the row; without one, around the middle.
Window zoom_window(const ProfileColumns& profile, double period_px) {
  const double middle = 0.5 * (profile.column_px.front() + profile.column_px.back());
  double centre = middle, best = std::numeric_limits<double>::infinity();
  for (const auto& jump : jumps_of(profile)) {
    const double place = profile.column_px[jump.at] + 0.5;
    if (std::abs(place - middle) < best) {
      best = std::abs(place - middle);
      centre = place;
    }
  }
  const double half = kZoomPeriods * (period_px > 0 ? period_px : kUnknownPeriod_px);
  return {std::floor(centre - half), std::ceil(centre + half)};
}

/// The strips between a jump and the opposite one that follows within half a period: there the Gray code and the phase
/// disagree.
std::vector<Band> disagreements(const ProfileColumns& profile, const Window& window, double period_px) {
  std::vector<Band> out;
  const auto jumps = jumps_of(profile);
  for (std::size_t k = 0; k + 1 < jumps.size(); ++k) {
    const double from = profile.column_px[jumps[k].at] + 0.5, to = profile.column_px[jumps[k + 1].at] + 0.5;
    const bool pair = jumps[k].up != jumps[k + 1].up && to - from < 0.5 * period_px;
    if (pair && from >= window.from && to <= window.to) out.push_back({from, to});
  }
  return out;
}

/// The columns inside the window; a gap between columns breaks the line.
Plot profile_plot(const ProfileColumns& profile, const Window& window, const std::string& title) {
  Series phase{.label = "absolute phase", .mark = Mark::line, .colour = ink::kPrimary, .size = 1.3, .x = {}, .y = {}};
  Series gray{.label = "Gray number (right)",
              .mark = Mark::steps,
              .colour = ink::kSecondary,
              .size = 1.0,
              .right_axis = true,
              .x = {},
              .y = {}};
  double last = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t k = 0; k < profile.column_px.size(); ++k) {
    const double column = profile.column_px[k];
    if (column < window.from || column > window.to) continue;
    if (column - last > 1.5) {
      for (Series* s : {&phase, &gray}) {
        s->x.push_back(column);
        s->y.push_back(std::numeric_limits<double>::quiet_NaN());
      }
    }
    phase.x.push_back(column);
    phase.y.push_back(profile.phase_rad[k]);
    gray.x.push_back(column - 0.5);  // a step of the Gray number belongs to the whole pixel, centre +- 0.5
    gray.y.push_back(profile.gray_number[k]);
    last = column;
  }
  // The two curves rise together; ranges that are open on opposite sides keep them apart.
  const auto range = [](const std::vector<double>& values, double below, double above) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const double v : values) {
      if (std::isnan(v)) continue;
      low = std::min(low, v);
      high = std::max(high, v);
    }
    const double span = std::max(high - low, 1.0);
    return std::optional(std::pair(low - below * span, high + above * span));
  };
  return {.width_px = 500,
          .height_px = 230,
          .x = {.label = title + ", column in px", .range = std::pair(window.from, window.to), .tick = {}},
          .y = {.label = "absolute phase, rad", .range = range(phase.y, 0.06, 0.3), .tick = {}},
          .right = Axis{.label = "Gray number",
                        .range = range(gray.y, 0.3, 0.06),
                        .tick = window.to - window.from < 200 ? 1.0 : 20.0},
          .series = {gray, phase},
          .bands = {},
          .levels = {}};
}

struct Panel {
  const ProfileColumns* profile;
  std::string id, words;
  double period_px;
};

Markup panels(const AlignmentSection& alignment) {
  std::vector<Panel> shown;
  const auto period_of = [&](bool last) {
    if (alignment.iterations.empty()) return kUnknownPeriod_px;
    return last ? alignment.iterations.back().period_px : alignment.iterations.front().period_px;
  };
  if (alignment.before) shown.push_back({&*alignment.before, "before", "Before", period_of(false)});
  if (alignment.after) shown.push_back({&*alignment.after, "after", "After", period_of(true)});
  if (shown.empty()) return {};
  for (const auto& panel : shown) check(*panel.profile);
  const Window zoom = zoom_window(*shown.front().profile, shown.front().period_px);
  Markup rows, zooms;
  for (const auto& panel : shown) {
    const auto& profile = *panel.profile;
    const Window whole{profile.column_px.front(), profile.column_px.back()};
    rows +=
        figure("half", draw(profile_plot(profile, whole, fmt::format("row {}", profile.row_px)), "profile_" + panel.id),
               panel.words + " alignment: Gray steps and absolute phase along one row.");
    Plot plot = profile_plot(profile, zoom, fmt::format("row {}, zoom", profile.row_px));
    plot.bands = disagreements(profile, zoom, panel.period_px);
    plot.series.back().mark = Mark::line_points;
    plot.series.back().size = 0.28;
    const char* const note = plot.bands.empty()
                                 ? ": no jump in this window; the edges of the Gray code and the phase coincide."
                                 : ": between a Gray edge and the period edge the phase jumps by 2π (shaded).";
    zooms += figure("half", draw(plot, "zoom_" + panel.id), panel.words + " alignment, zoom on period edges" + note);
  }
  return element("div", {{"class", "figures"}}, rows + zooms);
}

Markup iteration_table(const AlignmentSection& alignment) {
  const std::vector<Column> columns = {{"capture", "", ""},
                                       {"θ, mrad", "number", "fringes to slide"},
                                       {"u, mrad", "number", "fringes to slide"},
                                       {"bit", "number", "assembly error, eq. 21"},
                                       {"δ, µm", "number", "assembly error, eq. 21"},
                                       {"u, µm", "number", "assembly error, eq. 21"},
                                       {"δ/p", "number", "assembly error, eq. 21"},
                                       {"jump, px", "number", "assembly error, eq. 21"},
                                       {"period, px", "number", "assembly error, eq. 21"},
                                       {"turn by, mrad", "number", "adjuster"},
                                       {"verdict", "", "adjuster"}};
  std::vector<std::vector<Markup>> rows;
  for (const auto& i : alignment.iterations) {
    const Rounded theta = rounded(i.theta_mrad.value, i.theta_mrad.u), delta = rounded(i.delta_um.value, i.delta_um.u);
    const Markup turn = i.turn_mrad ? text(with_sign(fixed(*i.turn_mrad, 3))) : text("none");
    Markup verdict = text(i.verdict);
    if (!i.instruction.empty()) verdict += element("span", {{"class", "sub"}}, text(i.instruction));
    rows.push_back({text(std::to_string(i.number)), text(with_sign(theta.value)), text(theta.u),
                    text(std::to_string(i.bit)), text(with_sign(delta.value)), text(delta.u),
                    text(with_sign(fixed(i.fraction_of_period, 4))), text(fixed(i.jump_px, 1)),
                    text(fixed(i.period_px, 1)), turn, verdict});
  }
  return table("full", columns, rows);
}

Markup delta_maps(const AlignmentSection& alignment) {
  Markup maps;
  const auto add = [&](const std::optional<Image<float>>& map, const char* words) {
    if (!map) return;
    const HeatMapOptions options{
        .map = ColourMap::sequential, .label = "δ, µm", .width_px = 440, .max_height_px = 300, .zoom_to_valid = false};
    maps += figure("half", heat_map(*map, options), words);
  };
  add(alignment.delta_before_um, "As found: δ of the finest bit that jumps, over the picture (axes: cells of 40 px).");
  add(alignment.delta_after_um, "As left: the same. Each picture has its own range.");
  return maps.empty() ? Markup() : element("div", {{"class", "figures"}}, maps);
}

}  // namespace

Markup alignment_section(const CommissioningReport& report) {
  if (!report.alignment) return {};
  const AlignmentSection& alignment = *report.alignment;
  Markup out;
  if (!alignment.conclusion.empty()) out += element("p", text(alignment.conclusion));
  out += element("p", {{"class", "note"}},
                 text(fmt::format(
                     "δ is the sideways distance on the grating between an edge of the named Gray bit and the edge of "
                     "the phase period it belongs to, p the period; both from maps without corrections. The loop "
                     "ends at |δ/p| ≤ {}.",
                     significant(alignment.tolerance_fraction, 2))));
  if (!alignment.iterations.empty()) out += iteration_table(alignment);
  return section("alignment", "Grating alignment", out + panels(alignment) + delta_maps(alignment));
}

}  // namespace fringecal::reports

#include "reports/uncertainty_page.h"

#include "reports/html.h"
#include "reports/number.h"
#include "reports/picture.h"

#include <fmt/format.h>

#include <limits>

namespace fringecal::reports {
namespace {

using metrology::PointUncertainty;
using metrology::Section;

/// A section as an image, the drawing's y upwards.
Image<float> picture_of(const Section& s, double PointUncertainty::*part) {
  Image<float> out(s.columns, s.rows, std::numeric_limits<float>::quiet_NaN());
  for (int row = 0; row < s.rows; ++row) {
    for (int column = 0; column < s.columns; ++column) {
      const auto& value = s.values[static_cast<std::size_t>(row * s.columns + column)];
      if (value) out(column, s.rows - 1 - row) = static_cast<float>((*value).*part);
    }
  }
  return out;
}

Markup section_figure(const Section& s, double PointUncertainty::*part, const std::string& what) {
  HeatMapOptions options;
  options.map = ColourMap::sequential;
  options.label = "u, µm";
  options.scale = 1000.0;
  options.max_height_px = 300;
  options.zoom_to_valid = false;
  options.x = {s.first_x_mm, s.step_mm};
  options.y = {s.first_y_mm + (s.rows - 1) * s.step_mm, -s.step_mm};
  const char* const axes = s.across == 'z' ? "X right, Y up" : s.across == 'y' ? "X right, Z up" : "Y right, Z up";
  return figure("half", heat_map(picture_of(s, part), options),
                fmt::format("{}, section {} = {:.0f} mm; {}, mm.", what, static_cast<char>(std::toupper(s.across)),
                            s.at_mm, axes));
}

Markup micrometres(double mm) { return text(fixed(1000.0 * mm, 1)); }

Markup table_of(const metrology::UncertaintyMap& map) {
  std::vector<std::vector<Markup>> rows;
  for (const auto& p : map.points) {
    rows.push_back({text(fixed(p.point_mm.x(), 0)), text(fixed(p.point_mm.y(), 0)), text(fixed(p.point_mm.z(), 0)),
                    micrometres(p.u_mm.x()), micrometres(p.u_mm.y()), micrometres(p.u_mm.z()), micrometres(p.camera_mm),
                    micrometres(p.projector_mm), micrometres(p.pose_mm), micrometres(p.calibration_mm),
                    micrometres(p.phase_mm), micrometres(p.total_mm)});
  }
  return table("",
               {{"X", "number", "point, mm"},
                {"Y", "number", "point, mm"},
                {"Z", "number", "point, mm"},
                {"X", "number", "u, µm"},
                {"Y", "number", "u, µm"},
                {"Z", "number", "u, µm"},
                {"camera", "number", "parts of |u|, µm"},
                {"projector", "number", "parts of |u|, µm"},
                {"pose", "number", "parts of |u|, µm"},
                {"calibration", "number", "|u|, µm"},
                {"phase", "number", "|u|, µm"},
                {"all", "number", "|u|, µm"}},
               rows);
}

Markup combinations_of(const metrology::UncertaintyMap& map) {
  std::vector<std::vector<Markup>> rows;
  for (const auto& c : map.combinations) {
    std::string words;
    for (const auto& share : c.shares) {
      words += fmt::format("{}{} {:+.2f}", words.empty() ? "" : ", ", share.parameter, share.in_u);
    }
    rows.push_back({text(words), micrometres(c.rms_mm), micrometres(c.worst_mm), text(c.open ? "left open" : "")});
  }
  return table("",
               {{"parameters, in their standard uncertainties", "", ""},
                {"rms, µm", "number", ""},
                {"worst, µm", "number", ""},
                {"", "", ""}},
               rows);
}

}  // namespace

std::string uncertainty_page(const UncertaintyPage& p) {
  const auto& map = p.map;
  Markup verdict = element(
      "p", text(fmt::format("The calibration alone: {:.1f} µm rms over the volume, {:.1f} µm at most, at X, Y, Z = "
                            "{:.0f}, {:.0f}, {:.0f} mm (standard uncertainty of a point, length of the vector).",
                            1000 * map.rms_mm, 1000 * map.worst_mm, map.worst_at_mm.x(), map.worst_at_mm.y(),
                            map.worst_at_mm.z())));
  for (const auto& words : metrology::open_words(map)) verdict += element("p", text(words));
  for (const auto& w : p.whiteness) verdict += element("p", text(metrology::words_of(w)));
  if (p.halves) verdict += element("p", text("Halves of the poses: " + metrology::verdict_of(*p.halves)));
  if (!p.without_halves.empty()) {
    verdict += element("p", text("Halves of the poses cannot be compared: " + p.without_halves));
  }
  Markup pictures;
  for (const auto& s : map.sections) pictures += section_figure(s, &PointUncertainty::total_mm, "All");
  for (const auto& [part, what] : {std::pair{&PointUncertainty::camera_mm, "Camera alone"},
                                   {&PointUncertainty::projector_mm, "Projector alone"},
                                   {&PointUncertainty::pose_mm, "Relative pose alone"},
                                   {&PointUncertainty::phase_mm, "Phase noise"}}) {
    if (!map.sections.empty()) pictures += section_figure(map.sections.front(), part, what);
  }
  Markup priors;
  for (const auto& prior : p.priors) {
    priors +=
        element("p", text(fmt::format("{} = {} ± {:.3g}: {}", prior.parameter, prior.value, prior.u, prior.reason)));
  }
  Markup body = element("h1", text("Uncertainty of the calibration: " + p.name));
  body += section("verdict", "What it comes to", verdict);
  body +=
      section("sections", "Sections of the volume",
              element("p", text("The parts are what each block of parameters would do alone; they are correlated and "
                                "mostly cancel, so their squares add up to more than the whole.")) +
                  pictures);
  body += section("open", "Combinations of parameters that move the volume most", combinations_of(map));
  if (!p.priors.empty()) body += section("priors", "Priors that took part", priors);
  body += section("table", "Points of the volume", table_of(map));
  return page("Uncertainty of the calibration", body);
}

}  // namespace fringecal::reports

#include "reports/commissioning_sections.h"
#include "reports/number.h"
#include "reports/picture.h"
#include "reports/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::reports {
namespace {

/// Points of one plot. More would not be seen and would make the file large.
constexpr std::size_t kMaxPoints = 2500;

constexpr std::size_t kMaxArrows = 700;

std::size_t stride_for(std::size_t n, std::size_t most) { return (n + most - 1) / most; }

std::string thinning_note(std::size_t stride) { return stride > 1 ? fmt::format(" One in {} is drawn.", stride) : ""; }

/// "p_R" -> p<sub>R</sub>: one letter with a short index; a longer name is a path and stays as it is.
Markup symbol(const std::string& name) {
  const bool indexed = name.size() > 2 && name.size() <= 5 && name[1] == '_';
  return indexed ? text(name.substr(0, 1)) + element("sub", text(name.substr(2))) : text(name);
}

/// The column of u is left out where no parameter has one.
Markup parameter_table(const std::vector<Parameter>& parameters) {
  const bool any_u =
      std::any_of(parameters.begin(), parameters.end(), [](const Parameter& p) { return p.u.has_value(); });
  std::vector<std::vector<Markup>> rows;
  for (const auto& p : parameters) {
    Markup name = symbol(p.name);
    if (!p.meaning.empty()) name += element("span", {{"class", "sub"}}, text(p.meaning));
    const Rounded r =
        p.u ? rounded(p.value, *p.u) : Rounded{without_end_zeros(significant(p.value, 6)), "not estimated"};
    std::vector<Markup> row = {name, text(r.value)};
    if (any_u) row.push_back(text(r.u));
    row.push_back(unit(p.unit.empty() ? "1" : p.unit));
    rows.push_back(row);
  }
  std::vector<Column> columns = {{"parameter", "", ""}, {"value", "number", ""}};
  if (any_u) columns.push_back({"u", "number", ""});
  columns.push_back({"unit", "", ""});
  return table("small full", columns, rows);
}

Markup residual_figures(const model::ResidualStatistics& r) {
  const std::vector<std::vector<Markup>> rows = {
      {text("camera, rms per coordinate"), text(significant(r.camera_rms_px, 3)), text("px")},
      {text("projector, rms"), text(significant(r.projector_rms, 3)), unit(r.projector_unit)},
      {text("board grid triangulated, rms"), text(significant(1000.0 * r.grid_rms_mm, 3)), text("µm")},
      {text("χ² per degree of freedom"), text(significant(r.chi2_per_dof, 3)), text("1")},
      {text("corners used"), text(std::to_string(r.corners_used)), text("")},
      {text("corners rejected"), text(std::to_string(r.corners_rejected)), text("")},
      {text("poses"), text(std::to_string(r.poses)), text("")},
      {text("iterations"), text(std::to_string(r.iterations)), text("")}};
  return table("small", {{"residuals", "", ""}, {"value", "number", ""}, {"unit", "", ""}}, rows);
}

Markup pose_list(const std::vector<PoseUse>& poses) {
  std::string used;
  std::vector<std::vector<Markup>> dropped;
  for (const auto& pose : poses) {
    if (pose.used) {
      used += (used.empty() ? "" : ", ") + pose.name;
    } else {
      dropped.push_back({text(pose.name), text(pose.reason)});
    }
  }
  Markup out = element("p", {{"class", "note"}}, text("Used: " + (used.empty() ? "none" : used) + "."));
  if (dropped.empty()) return out + element("p", {{"class", "note"}}, text("Dropped: none."));
  return out + table("small", {{"dropped", "", ""}, {"reason", "", ""}}, dropped);
}

/// A power of ten times 1, 2 or 5 not above x.
double round_down(double x) {
  const double power = std::pow(10.0, std::floor(std::log10(x)));
  const double ratio = x / power;
  return power * (ratio >= 5.0 ? 5.0 : ratio >= 2.0 ? 2.0 : 1.0);
}

double largest_residual(const std::vector<CameraResidual>& residuals) {
  double largest = 0;
  for (const auto& r : residuals) largest = std::max({largest, std::abs(r.residual_x_px), std::abs(r.residual_y_px)});
  return largest;
}

Markup scatter(const CalibrationSection& calibration) {
  const auto& residuals = calibration.camera_residuals;
  const std::size_t stride = stride_for(residuals.size(), kMaxPoints);
  Series s{.label = "", .mark = Mark::points, .size = 0.25, .x = {}, .y = {}};
  for (std::size_t k = 0; k < residuals.size(); k += stride) {
    s.x.push_back(residuals[k].residual_x_px);
    s.y.push_back(residuals[k].residual_y_px);
  }
  const double half = std::max(1.1 * largest_residual(residuals), 1e-9);
  const Plot plot{.width_px = 430,
                  .height_px = 380,
                  .x = {.label = "residual in x, px", .range = std::pair(-half, half), .tick = {}},
                  .y = {.label = "residual in y, px", .range = std::pair(-half, half), .tick = {}},
                  .right = {},
                  .series = {s},
                  .bands = {},
                  .levels = {},
                  .equal_scales = true};
  return figure("half", draw(plot, "camera_scatter"),
                fmt::format("Camera: reprojection residuals (measured − model) of {} corners.", residuals.size()) +
                    thinning_note(stride));
}

Markup vector_field(const CalibrationSection& calibration) {
  const auto& residuals = calibration.camera_residuals;
  const double width = calibration.image_width_px, height = calibration.image_height_px;
  const double typical = std::max(calibration.residuals.camera_rms_px, 1e-9);
  const double scale = round_down(0.025 * width / typical);  // a typical residual is drawn 1 to 3 % of the width long
  const std::size_t stride = stride_for(residuals.size(), kMaxArrows);
  Series s{.label = "", .mark = Mark::vectors, .size = 0.8, .x = {}, .y = {}};
  for (std::size_t k = 0; k < residuals.size(); k += stride) {
    s.x.push_back(residuals[k].pixel_x_px);
    s.y.push_back(residuals[k].pixel_y_px);
    s.dx.push_back(scale * residuals[k].residual_x_px);
    s.dy.push_back(scale * residuals[k].residual_y_px);
  }
  const double reference = round_down(0.08 * width / scale);
  const Series key{.label = "",
                   .mark = Mark::vectors,
                   .colour = ink::kSecondary,
                   .size = 2.0,
                   .x = {0.02 * width},
                   .y = {1.06 * height},
                   .dx = {reference * scale},
                   .dy = {0.0}};
  const Plot plot{.width_px = 500,
                  .height_px = 380,
                  .x = {.label = "column, px", .range = std::pair(0.0, width), .tick = {}},
                  .y = {.label = "row, px", .range = std::pair(1.1 * height, 0.0), .tick = {}},
                  .right = {},
                  .series = {s, key},
                  .bands = {},
                  .levels = {},
                  .equal_scales = true};
  return figure(
      "half", draw(plot, "camera_field"),
      fmt::format(
          "Camera: the same residuals over the image, enlarged {} times; the orange arrow at the bottom is {} px. "
          "Residuals of a good model point everywhere; a pattern is a missing term.",
          significant(scale, 1), significant(reference, 1)) +
          thinning_note(stride));
}

Markup projector_scatter(const CalibrationSection& calibration) {
  const auto& residuals = calibration.projector_residuals;
  const bool in_mm = calibration.residuals.projector_unit == "mm";
  const std::string shown_unit = in_mm ? "µm" : calibration.residuals.projector_unit;
  const std::size_t stride = stride_for(residuals.size(), kMaxPoints);
  Series s{.label = "", .mark = Mark::points, .size = 0.25, .x = {}, .y = {}};
  for (std::size_t k = 0; k < residuals.size(); k += stride) {
    s.x.push_back(residuals[k].pixel_x_px);
    s.y.push_back((in_mm ? 1000.0 : 1.0) * residuals[k].residual);
  }
  const Plot plot{.width_px = 500,
                  .height_px = 300,
                  .x = {.label = "column of the corner in the camera image, px",
                        .range = std::pair(0.0, static_cast<double>(calibration.image_width_px)),
                        .tick = {}},
                  .y = {.label = "residual on the pattern, " + shown_unit, .range = {}, .tick = {}},
                  .right = {},
                  .series = {s},
                  .bands = {},
                  .levels = {{0.0, ""}}};
  return figure(
      "half", draw(plot, "projector_scatter"),
      fmt::format("Projector: residuals of the coded coordinate on the pattern ({} corners).", residuals.size()) +
          thinning_note(stride));
}

Markup pictures(const CalibrationSection& calibration) {
  Markup out;
  const bool field = calibration.image_width_px > 0 && calibration.image_height_px > 0;
  if (!calibration.camera_residuals.empty()) out += scatter(calibration);
  if (!calibration.camera_residuals.empty() && field) out += vector_field(calibration);
  if (!calibration.projector_residuals.empty() && field) out += projector_scatter(calibration);
  if (calibration.coverage) {
    const HeatMapOptions options{.map = ColourMap::sequential,
                                 .label = "corners per cell",
                                 .width_px = 500,
                                 .max_height_px = 300,
                                 .zoom_to_valid = false};
    out += figure("half", heat_map(*calibration.coverage, options),
                  "Coverage: corners in each cell of the camera image, all poses together; grey: none. Axes in cells.");
  }
  return out.empty() ? out : element("div", {{"class", "figures"}}, out);
}

}  // namespace

Markup calibration_section(const CommissioningReport& report) {
  if (!report.calibration) return {};
  const CalibrationSection& calibration = *report.calibration;
  Markup left, right;
  if (!calibration.parameters.empty()) {
    left = element("h3", text("Parameters of the full model")) + parameter_table(calibration.parameters);
  }
  if (!calibration.paper_parameters.empty()) {
    right += element("h3", text("The paper’s parameters")) + parameter_table(calibration.paper_parameters);
  }
  right += element("h3", text("Residuals")) + residual_figures(calibration.residuals);
  Markup out;
  if (!calibration.method.empty()) out += element("p", text(calibration.method));
  out += element("div", {{"class", "columns"}}, element("div", left) + element("div", right));
  if (!calibration.poses.empty()) out += element("h3", text("Poses")) + pose_list(calibration.poses);
  return section("calibration", "Calibration", out + pictures(calibration));
}

}  // namespace fringecal::reports

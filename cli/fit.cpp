// fringecal fit plane|sphere|cylinder|line|circle FILE: the fit of one shape to a point file, as a table or as JSON.
#include "fitting/fit.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/point_file.h"
#include "core/value.h"
#include "fitting/form.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

using fitting::FitQuality;
using fitting::Rejection;

struct FitArguments {
  std::string shape, file;
  LengthUnit unit = LengthUnit::mm;
  double diameter_mm = 0;  // held; 0: fitted
  bool robust = false, vdi_2634 = false, zone = false, json = false;
};

/// Infinite (as many points as parameters: no scatter to judge by) is null in JSON.
Value number_or_null(double x) { return std::isfinite(x) ? Value(x) : Value(); }
std::string text(double x) { return std::isfinite(x) ? fmt::format("{:.2g}", x) : "unknown"; }
std::string text(const Eigen::Vector3d& p, int decimals) {
  return fmt::format("{:.{}f}  {:.{}f}  {:.{}f}", p.x(), decimals, p.y(), decimals, p.z(), decimals);
}

/// The rows that belong to a shape alone, for both kinds of output.
struct Rows {
  Value json = Value::object();
  std::string table;
  void add(const char* key, const Eigen::Vector3d& p) { json.set(key, Value::numbers(p)); }
  void line(const char* name, const std::string& value, const std::string& u) {
    table += fmt::format("  {:<20}{:<42}  u = {}\n", name, value, u);
  }
  void amplification(double a) {
    json.set("amplification", a);
    if (a > 10.0) {
      table += fmt::format(
          "  This small part of the surface amplifies errors of its points {:.0f} times in the diameter.\n", a);
    }
  }
  /// The standard's name of the 95 % shell.
  void name_form(const char* name) { form_name = name; }
  const char* form_name = nullptr;
};

Rows rows_of(const fitting::PlaneFit& fit) {
  Rows rows;
  rows.add("point_mm", fit.point_mm);
  rows.add("normal", fit.normal);
  rows.json.set("u_offset_mm", number_or_null(fit.u_offset_mm));
  rows.json.set("u_tilt_rad", number_or_null(fit.u_tilt_rad));
  rows.line("point / mm", text(fit.point_mm, 6), text(fit.u_offset_mm) + " mm (along the normal)");
  rows.line("normal", text(fit.normal, 9), text(fit.u_tilt_rad) + " rad");
  rows.name_form("E_Form.Pla.D95%");
  return rows;
}

Rows rows_of(const fitting::SphereFit& fit) {
  Rows rows;
  rows.add("center_mm", fit.center_mm);
  rows.json.set("diameter_mm", fit.diameter_mm);
  Value u = Value::array();
  for (const double x : fit.u_center_mm) u.append(number_or_null(x));
  rows.json.set("u_center_mm", u);
  rows.json.set("u_diameter_mm", number_or_null(fit.u_diameter_mm));
  rows.line(
      "center / mm", text(fit.center_mm, 6),
      fmt::format("{}  {}  {} mm", text(fit.u_center_mm.x()), text(fit.u_center_mm.y()), text(fit.u_center_mm.z())));
  rows.line("diameter / mm", fmt::format("{:.6f}", fit.diameter_mm), text(fit.u_diameter_mm) + " mm");
  rows.amplification(fit.amplification);
  rows.name_form("P_Form.Sph.D95%");
  return rows;
}

Rows rows_of(const fitting::CylinderFit& fit) {
  Rows rows;
  rows.add("axis_point_mm", fit.axis_point_mm);
  rows.add("axis_direction", fit.axis_direction);
  rows.json.set("diameter_mm", fit.diameter_mm);
  rows.json.set("u_axis_point_mm", number_or_null(fit.u_axis_point_mm));
  rows.json.set("u_axis_direction_rad", number_or_null(fit.u_axis_direction_rad));
  rows.json.set("u_diameter_mm", number_or_null(fit.u_diameter_mm));
  rows.line("axis point / mm", text(fit.axis_point_mm, 6), text(fit.u_axis_point_mm) + " mm (across the axis)");
  rows.line("axis direction", text(fit.axis_direction, 9), text(fit.u_axis_direction_rad) + " rad");
  rows.line("diameter / mm", fmt::format("{:.6f}", fit.diameter_mm), text(fit.u_diameter_mm) + " mm");
  rows.amplification(fit.amplification);
  rows.name_form("95 % shell");
  return rows;
}

Rows rows_of(const fitting::LineFit& fit) {
  Rows rows;
  rows.add("point_mm", fit.point_mm);
  rows.add("direction", fit.direction);
  rows.json.set("u_point_mm", number_or_null(fit.u_point_mm))
      .set("u_direction_rad", number_or_null(fit.u_direction_rad));
  rows.line("point / mm", text(fit.point_mm, 6), text(fit.u_point_mm) + " mm (across the line)");
  rows.line("direction", text(fit.direction, 9), text(fit.u_direction_rad) + " rad");
  return rows;
}

Rows rows_of(const fitting::CircleFit& fit) {
  Rows rows;
  rows.add("center_mm", fit.center_mm);
  rows.add("normal", fit.normal);
  rows.json.set("diameter_mm", fit.diameter_mm);
  Value u = Value::array();
  for (const double x : fit.u_center_mm) u.append(number_or_null(x));
  rows.json.set("u_center_mm", u);
  rows.json.set("u_normal_rad", number_or_null(fit.u_normal_rad))
      .set("u_diameter_mm", number_or_null(fit.u_diameter_mm));
  rows.line(
      "center / mm", text(fit.center_mm, 6),
      fmt::format("{}  {}  {} mm", text(fit.u_center_mm.x()), text(fit.u_center_mm.y()), text(fit.u_center_mm.z())));
  rows.line("normal", text(fit.normal, 9), text(fit.u_normal_rad) + " rad");
  rows.line("diameter / mm", fmt::format("{:.6f}", fit.diameter_mm), text(fit.u_diameter_mm) + " mm");
  return rows;
}

using Zone = std::optional<Result<fitting::MinimumZone>>;

/// What is said beside a fit: the zone of the points used, where it is asked for, and a doubt that they are one surface.
struct Remarks {
  Zone zone = std::nullopt;
  std::string doubt = {};
};

template <class Fit>
void write(const FitArguments& arguments, const char* rejection, const Result<Fit>& fit, const Remarks& remarks) {
  const Zone& zone = remarks.zone;
  if (!fit) throw InputError(fmt::format("{}: {}", arguments.file, fit.error().sentence));
  const FitQuality& q = fit->quality;
  Rows rows = rows_of(*fit);
  std::optional<fitting::FormDeviation> form;
  if (rows.form_name) form = fitting::form_of(q);
  if (zone && !*zone) throw InputError(fmt::format("{}: {}", arguments.file, zone->error().sentence));
  if (!arguments.json) {
    fmt::print("{} fitted to {} of {} points of {} (orthogonal least squares, rejection: {})\n{}", arguments.shape,
               q.n_used, q.n_used + q.n_rejected, arguments.file, rejection, rows.table);
    fmt::print("  {:<20}{:.6g}   standard deviation {}   distances {:.6g} to {:.6g}\n", "rms / mm", q.rms_mm,
               std::isfinite(q.standard_deviation_mm) ? fmt::format("{:.6g}", q.standard_deviation_mm) : "unknown",
               *q.min_mm, *q.max_mm);
    if (form)
      fmt::print("  {:<20}range {:.6g}   {} {:.6g}\n", "form / mm", form->range_mm, rows.form_name, form->shell_95_mm);
    if (zone)
      fmt::print("  {:<20}{:.6g} (proven: not below {:.6g})\n", "minimum zone / mm", (*zone)->width_mm,
                 (*zone)->lower_mm);
    if (!remarks.doubt.empty()) fmt::print("  {}.\n", remarks.doubt);
    return;
  }
  Value out = Value::object();
  out.set("shape", arguments.shape).set("file", arguments.file);
  out.set("unit", arguments.unit == LengthUnit::m ? "m" : "mm").set("rejection", rejection);
  for (const auto& [key, value] : *rows.json.if_object()) out.set(key, value);
  out.set("rms_mm", q.rms_mm).set("standard_deviation_mm", number_or_null(q.standard_deviation_mm));
  out.set("min_mm", *q.min_mm).set("max_mm", *q.max_mm);
  if (form) out.set("range_mm", form->range_mm).set("shell_95_mm", form->shell_95_mm);
  if (zone) out.set("minimum_zone_mm", (*zone)->width_mm).set("minimum_zone_lower_mm", (*zone)->lower_mm);
  out.set("n_used", q.n_used).set("n_rejected", q.n_rejected).set("iterations", q.iterations);
  if (!remarks.doubt.empty()) out.set("doubt", remarks.doubt);
  fmt::print("{}", to_json(out));
}

void run(const FitArguments& arguments) {
  const std::vector<Eigen::Vector3d> points_mm = read_points_mm(arguments.file, arguments.unit);
  fitting::FitOptions options{.rejection = arguments.robust     ? Rejection::robust
                                           : arguments.vdi_2634 ? Rejection::vdi_2634
                                                                : Rejection::none};
  if (arguments.diameter_mm > 0) options.fixed_diameter_mm = arguments.diameter_mm;
  const char* rejection = arguments.robust ? "robust" : arguments.vdi_2634 ? "vdi_2634" : "none";
  const auto zone_of = [&](const auto& fit, auto zone) -> Zone {
    if (!arguments.zone || !fit) return std::nullopt;
    std::vector<Eigen::Vector3d> used;
    for (std::size_t i = 0; i < points_mm.size(); ++i) {
      if (!fit->quality.rejected[i]) used.push_back(points_mm[i]);
    }
    return zone(used);
  };
  const auto write_surface = [&](const auto& fit_surface, auto zone) {
    const auto fit = fit_surface(points_mm, options);
    Remarks remarks{.zone = zone_of(fit, zone)};
    if (fit && options.rejection == Rejection::none) {
      fitting::FitOptions most = options;
      most.rejection = Rejection::robust;
      const auto robust = fit_surface(points_mm, most);
      remarks.doubt = fitting::why_not_one_surface(arguments.shape.c_str(), points_mm, fit->quality,
                                                   robust ? &robust->quality : nullptr);
    }
    write(arguments, rejection, fit, remarks);
  };
  if (arguments.shape == "plane") {
    write_surface(fitting::fit_plane, fitting::flatness);
  } else if (arguments.shape == "sphere") {
    write_surface(fitting::fit_sphere, fitting::sphericity);
  } else if (arguments.shape == "cylinder") {
    write_surface(fitting::fit_cylinder, fitting::cylindricity);
  } else if (arguments.robust || arguments.vdi_2634) {
    throw InputError(fmt::format("a {} is fitted to all points; leave out --robust and --vdi-2634", arguments.shape));
  } else if (arguments.shape == "line") {
    if (arguments.zone)
      throw InputError("--zone has no meaning for a line here; fit a plane, sphere, cylinder or circle");
    write(arguments, rejection, fitting::fit_line(points_mm), {});
  } else {
    const auto fit = fitting::fit_circle(points_mm);
    write(arguments, rejection, fit, {.zone = zone_of(fit, fitting::roundness)});
  }
}

}  // namespace

void add_fit(CLI::App& app) {
  auto arguments = std::make_shared<FitArguments>();
  CLI::App* fit = app.add_subcommand(
      "fit", "Fits a plane, sphere, cylinder, line or circle to a point file (orthogonal least squares)");
  fit->add_option("shape", arguments->shape, "plane, sphere, cylinder, line or circle")
      ->required()
      ->check(CLI::IsMember({"plane", "sphere", "cylinder", "line", "circle"}));
  fit->add_option("file", arguments->file, "points: .xyz (x y z per line), .ds (NIST) or .ply")->required();
  fit->add_option("--unit", arguments->unit, "unit of the file's coordinates: mm (default) or m")
      ->transform(
          CLI::CheckedTransformer(std::map<std::string, LengthUnit>{{"mm", LengthUnit::mm}, {"m", LengthUnit::m}})
              .description("{mm,m}"));
  CLI::Option* robust =
      fit->add_flag("--robust", arguments->robust,
                    "find the shape among other points first, then leave out points beyond 3.5 robust deviations");
  fit->add_flag("--vdi-2634", arguments->vdi_2634,
                "leave out at most 0.3 % of the points, those farthest out beyond 3 s")
      ->excludes(robust);
  fit->add_option("--diameter", arguments->diameter_mm, "hold the diameter of a sphere or cylinder at this value (mm)")
      ->check(CLI::PositiveNumber);
  fit->add_flag("--zone", arguments->zone,
                "also the minimum zone (flatness, sphericity, cylindricity, roundness), with its proven lower bound");
  fit->add_flag("--json", arguments->json, "print JSON with all digits instead of the table");
  fit->footer(
      "Where the points are plainly not of one surface a sentence says so (JSON: key doubt); the figures are still "
      "those of\n"
      "the fit that was asked for, and the exit code is 0.\n"
      "Example: fringecal fit sphere scan.xyz --unit m --robust --json");
  fit->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli

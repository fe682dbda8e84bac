// fringecal fit plane|sphere|cylinder FILE: the fit of one shape to a point file, as a table or as JSON.
#include "fitting/fit.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/point_file.h"
#include "core/value.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>

namespace fringecal::cli {
namespace {

using fitting::FitQuality;
using fitting::Rejection;

struct FitArguments {
  std::string shape, file;
  LengthUnit unit = LengthUnit::mm;
  bool robust = false, vdi_2634 = false, json = false;
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
};

Rows rows_of(const fitting::PlaneFit& fit) {
  Rows rows;
  rows.add("point_mm", fit.point_mm);
  rows.add("normal", fit.normal);
  rows.json.set("u_offset_mm", number_or_null(fit.u_offset_mm));
  rows.json.set("u_tilt_rad", number_or_null(fit.u_tilt_rad));
  rows.line("point / mm", text(fit.point_mm, 6), text(fit.u_offset_mm) + " mm (along the normal)");
  rows.line("normal", text(fit.normal, 9), text(fit.u_tilt_rad) + " rad");
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
  return rows;
}

template <class Fit>
void write(const FitArguments& arguments, const char* rejection, const Result<Fit>& fit) {
  if (!fit) throw InputError(fmt::format("{}: {}", arguments.file, fit.error().sentence));
  const FitQuality& q = fit->quality;
  Rows rows = rows_of(*fit);
  if (!arguments.json) {
    fmt::print("{} fitted to {} of {} points of {} (orthogonal least squares, rejection: {})\n{}", arguments.shape,
               q.n_used, q.n_used + q.n_rejected, arguments.file, rejection, rows.table);
    fmt::print("  {:<20}{:.6g}   standard deviation {}   distances {:.6g} to {:.6g}\n", "rms / mm", q.rms_mm,
               std::isfinite(q.standard_deviation_mm) ? fmt::format("{:.6g}", q.standard_deviation_mm) : "unknown",
               q.min_mm, q.max_mm);
    return;
  }
  Value out = Value::object();
  out.set("shape", arguments.shape).set("file", arguments.file);
  out.set("unit", arguments.unit == LengthUnit::m ? "m" : "mm").set("rejection", rejection);
  for (const auto& [key, value] : *rows.json.if_object()) out.set(key, value);
  out.set("rms_mm", q.rms_mm).set("standard_deviation_mm", number_or_null(q.standard_deviation_mm));
  out.set("min_mm", q.min_mm).set("max_mm", q.max_mm);
  out.set("n_used", q.n_used).set("n_rejected", q.n_rejected).set("iterations", q.iterations);
  fmt::print("{}", to_json(out));
}

void run(const FitArguments& arguments) {
  const std::vector<Eigen::Vector3d> points_mm = read_points_mm(arguments.file, arguments.unit);
  const fitting::FitOptions options{.rejection = arguments.robust     ? Rejection::robust
                                                 : arguments.vdi_2634 ? Rejection::vdi_2634
                                                                      : Rejection::none};
  const char* rejection = arguments.robust ? "robust" : arguments.vdi_2634 ? "vdi_2634" : "none";
  if (arguments.shape == "plane") {
    write(arguments, rejection, fitting::fit_plane(points_mm, options));
  } else if (arguments.shape == "sphere") {
    write(arguments, rejection, fitting::fit_sphere(points_mm, options));
  } else {
    write(arguments, rejection, fitting::fit_cylinder(points_mm, options));
  }
}

}  // namespace

void add_fit(CLI::App& app) {
  auto arguments = std::make_shared<FitArguments>();
  CLI::App* fit =
      app.add_subcommand("fit", "Fits a plane, sphere or cylinder to a point file (orthogonal least squares)");
  fit->add_option("shape", arguments->shape, "plane, sphere or cylinder")
      ->required()
      ->check(CLI::IsMember({"plane", "sphere", "cylinder"}));
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
  fit->add_flag("--json", arguments->json, "print JSON with all digits instead of the table");
  fit->footer("Example: fringecal fit sphere scan.xyz --unit m --robust --json");
  fit->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli

// fringecal find CLOUD: the spheres, cylinders and planes in a raw cloud.
#include "fitting/find.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/point_file.h"
#include "core/value.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

using fitting::ShapeKind;

struct FindArguments {
  std::string file, output;
  LengthUnit unit = LengthUnit::mm;
  std::vector<std::string> nominals;
  fitting::FindOptions options;
  bool json = false;
};

/// "sphere 50", "cylinder 119.85", "plane"
fitting::NominalShape parsed(const std::string& text) {
  const std::size_t space = text.find(' ');
  const std::string kind = text.substr(0, space);
  for (const ShapeKind k : {ShapeKind::plane, ShapeKind::sphere, ShapeKind::cylinder}) {
    if (kind != fitting::name_of(k)) continue;
    const double diameter = space == std::string::npos ? 0.0 : std::atof(text.c_str() + space);
    if (k != ShapeKind::plane && !(diameter > 0.0)) break;
    return {text, k, diameter};
  }
  throw InputError(
      fmt::format("--nominal '{}' is not 'plane', 'sphere DIAMETER' or 'cylinder DIAMETER' (in mm)", text));
}

void run(const FindArguments& arguments) {
  std::vector<fitting::NominalShape> nominals;
  for (const std::string& text : arguments.nominals) nominals.push_back(parsed(text));
  const auto points_mm = read_points_mm(arguments.file, arguments.unit);
  const auto found = fitting::find_shapes(points_mm, nominals, arguments.options);
  if (!found) throw InputError(fmt::format("{}: {}", arguments.file, found.error().sentence));
  Value rows = Value::array();
  std::string table =
      fmt::format("{} points in {}, {} shapes\n", points_mm.size(), arguments.file, found->shapes.size());
  std::size_t of_none = points_mm.size();
  for (const auto& s : found->shapes) {
    Value row = Value::object();
    row.set("shape", fitting::name_of(s.kind)).set("nominal", s.nominal.empty() ? Value() : Value(s.nominal));
    row.set("place_mm", Value::numbers(s.place_mm));
    if (s.kind != ShapeKind::sphere) row.set("direction", Value::numbers(s.direction));
    if (s.kind != ShapeKind::plane) row.set("diameter_mm", s.diameter_mm).set("u_diameter_mm", s.u_diameter_mm);
    row.set("standard_deviation_mm", s.standard_deviation_mm).set("n_surface", s.n_surface);
    row.set("n_margin", s.n_margin).set("n_silhouette", s.n_silhouette).set("n_beyond", s.n_beyond);
    rows.append(row);
    table += fmt::format("  {:<9}{:<18}", fitting::name_of(s.kind), s.nominal.empty() ? "" : "= " + s.nominal);
    if (s.kind != ShapeKind::plane)
      table += fmt::format("diameter {:.4f} mm (u {:.4f})  ", s.diameter_mm, s.u_diameter_mm);
    table += fmt::format("at {:.3f} {:.3f} {:.3f} mm, sd {:.4f} mm\n", s.place_mm.x(), s.place_mm.y(), s.place_mm.z(),
                         s.standard_deviation_mm);
    table += fmt::format(
        "           {} points; left out: {} beside another surface, {} at the silhouette, {} beyond 3.5 sd\n",
        s.n_surface, s.n_margin, s.n_silhouette, s.n_beyond);
    of_none -= s.n_surface + s.n_margin + s.n_silhouette + s.n_beyond;
  }
  table += fmt::format("  {} points of no shape\n", of_none);
  std::string missing;
  for (const auto& nominal : nominals) {
    bool is_there = false;
    for (const auto& s : found->shapes) is_there = is_there || s.nominal == nominal.name;
    if (!is_there) missing += missing.empty() ? nominal.name : ", " + nominal.name;
  }
  if (!arguments.output.empty()) {
    static constexpr const char* kReasons[] = {"none", "surface", "margin", "silhouette", "beyond"};
    std::string text = "x_mm,y_mm,z_mm,shape,reason\n";
    for (std::size_t i = 0; i < points_mm.size(); ++i) {
      const auto& p = points_mm[i];
      text += fmt::format("{},{},{},{},{}\n", p.x(), p.y(), p.z(), found->shape_of[i],
                          kReasons[static_cast<int>(found->reason[i])]);
    }
    write_atomically(arguments.output, text);
  }
  if (arguments.json) {
    Value out = Value::object();
    out.set("file", arguments.file).set("n_points", points_mm.size()).set("n_of_no_shape", of_none).set("shapes", rows);
    fmt::print("{}", to_json(out));
  } else {
    fmt::print("{}", table);
  }
  if (!missing.empty()) throw InputError(fmt::format("{}: not found: {}", arguments.file, missing));
}

}  // namespace

void add_find(CLI::App& app) {
  auto arguments = std::make_shared<FindArguments>();
  CLI::App* find = app.add_subcommand("find", "Finds spheres, cylinders and planes in a raw point cloud and fits them");
  find->add_option("file", arguments->file, "points: .xyz (x y z per line), .ds (NIST) or .ply")->required();
  find->add_option("--unit", arguments->unit, "unit of the file's coordinates: mm (default) or m")
      ->transform(
          CLI::CheckedTransformer(std::map<std::string, LengthUnit>{{"mm", LengthUnit::mm}, {"m", LengthUnit::m}})
              .description("{mm,m}"));
  find->add_option("--nominal", arguments->nominals,
                   "an artefact to look for: 'sphere 50', 'cylinder 119.85' (diameter in mm), 'plane'; repeatable");
  find->add_option("--min-points", arguments->options.min_points, "fewest points of a shape (default 200)")
      ->check(CLI::Range(30, 100000000));
  find->add_option("--margin", arguments->options.margin_spacings,
                   "width of the margins left out, in point distances (default 3)")
      ->check(CLI::Range(0.0, 100.0));
  find->add_option("-o,--output", arguments->output,
                   "CSV file: every point with its shape and the reason why it is used or left out");
  find->add_flag("--json", arguments->json, "print JSON with all digits instead of the table");
  find->footer("Example: fringecal find scan.xyz --unit m --nominal 'sphere 100' -o points.csv");
  find->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli

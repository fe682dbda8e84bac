// fringecal register: views of one object brought together, and written as one cloud.
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/artefact.h"
#include "metrology/registration.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::vector<std::string> views;
  std::string scanner, output;
  double sphere_diameter_mm = 20;
  metrology::RegistrationOptions registration;
  bool spheres_only = false, json = false;
};

Value to_value(const metrology::Registration& r, const std::vector<metrology::View>& views) {
  Value list = Value::array(), pairs = Value::array();
  for (std::size_t i = 0; i < views.size(); ++i) {
    list.append(Value::object()
                    .set("view", views[i].name)
                    .set("spheres", views[i].spheres_mm.size())
                    .set("part_from_view", model::to_value(r.part_from_view[i])));
  }
  for (const auto& p : r.pairs) {
    pairs.append(Value::object()
                     .set("a", views[p.a].name)
                     .set("b", views[p.b].name)
                     .set("points", p.n_points)
                     .set("mean_mm", p.mean_mm)
                     .set("sd_mm", p.sd_mm));
  }
  return Value::object()
      .set("schema", "fringecal.registration")
      .set("schema_version", 1)
      .set("views", list)
      .set("sphere_rms_mm", r.sphere_rms_mm)
      .set("pairs", pairs)
      .set("mean_deviation_mm", r.mean_deviation_mm)
      .set("mean_sd_mm", r.mean_sd_mm)
      .set("iterations", r.iterations);
}

void register_clouds(Options& o) {
  if (o.views.size() < 2) throw InputError("register: give at least two clouds");
  const auto scanner = model::read_scanner(o.scanner);
  std::vector<metrology::View> views;
  for (const auto& file : o.views) {
    metrology::View view{.name = file, .cloud = metrology::read_ply(file)};
    const metrology::NominalArtefact nominal{"reference sphere", metrology::ArtefactKind::sphere, o.sphere_diameter_mm};
    for (const auto& m : metrology::measure_all(view.cloud, scanner, nominal)) view.spheres_mm.push_back(m.place_mm);
    views.push_back(std::move(view));
  }
  o.registration.refine = !o.spheres_only;
  const auto result = metrology::register_views(views, o.registration);
  if (!result) throw InputError(result.error().sentence);
  metrology::write_ply(o.output, metrology::merged(views, *result));
  auto record = std::filesystem::path(o.output).replace_extension(".registration.json");
  const Value value = to_value(*result, views);
  write_atomically(record, to_json(value));
  if (o.json) {
    fmt::print("{}", to_json(value));
    return;
  }
  fmt::print("{} views in one cloud: {}\n", views.size(), o.output);
  fmt::print("  reference spheres agree within {:.4f} mm (rms)\n", result->sphere_rms_mm);
  fmt::print("  {} overlaps: mean deviation {:.4f} mm, mean standard deviation {:.4f} mm (paper: 0.1 and 0.076 mm)\n",
             result->pairs.size(), result->mean_deviation_mm, result->mean_sd_mm);
}

}  // namespace

void add_register(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto* command = app.add_subcommand("register", "Bring several views of an object together by reference spheres");
  command->add_option("views", o->views, "Clouds of measure, one a view; the first one's frame is kept")->required();
  command->add_option("--scanner", o->scanner, "Scanner file that the clouds were made with")->required();
  command->add_option("--sphere-diameter", o->sphere_diameter_mm, "Of the reference spheres, mm")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("-o,--output", o->output, "Cloud to write (binary PLY); the motions stand beside it as JSON")
      ->required();
  command->add_flag("--spheres-only", o->spheres_only, "Do not refine on the surface");
  command->add_flag("--json", o->json, "Print the record instead of the summary");
  command->footer("Example: fringecal register view-*.ply --scanner scanner.json --sphere-diameter 20 -o whole.ply");
  command->callback([o] { register_clouds(*o); });
}

}  // namespace fringecal::cli

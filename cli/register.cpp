// fringecal register: views of one object brought together, and written as one cloud.
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "hw/virtual/scene_distance.h"
#include "metrology/artefact.h"
#include "metrology/deviation_map.h"
#include "metrology/registration.h"
#include "reports/registration_page.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>

namespace fringecal::cli {
namespace {

constexpr double kMapCell_mm = 1.5;  // some 30 points of eight views: 5 um of noise in a cell of a map

struct Options {
  std::vector<std::string> views;
  std::string scanner, output, truth, page;
  double sphere_diameter_mm = 20;
  metrology::RegistrationOptions registration;
  bool spheres_only = false, json = false;
};

/// The cloud against the scene of a truth file of `render`.
std::optional<metrology::DeviationMap> against_truth(const Options& o, const metrology::PointCloud& whole) {
  if (o.truth.empty()) return std::nullopt;
  Fields truth(read_json(o.truth), o.truth);
  const auto scene = virt::scene_from(truth.table("scene"));
  const Rigid3 world_from_scene = model::rigid_from(truth.table("world_from_preset"));
  auto map = metrology::deviation_map(whole, virt::distance_from(scene), world_from_scene.inverse());
  if (!map) throw InputError(fmt::format("{}: {}", o.truth, map.error().sentence));
  return *std::move(map);
}

Value to_value(const metrology::DeviationMap& map, const std::vector<metrology::DeviationView>& sides) {
  Value list = Value::array();
  for (const auto& side : sides) list.append(Value::object().set("side", side.name).set("sd_of_cells_mm", side.sd_mm));
  return Value::object()
      .set("body_from_part", model::to_value(map.body_from_part))
      .set("points", map.n_points)
      .set("points_beyond", map.n_beyond)
      .set("mean_mm", map.mean_mm)
      .set("sd_mm", map.sd_mm)
      .set("width_95_mm", map.width_95_mm)
      .set("width_997_mm", map.width_997_mm)
      .set("cell_mm", kMapCell_mm)
      .set("sides", list);
}

std::string um(double mm) { return fmt::format("{:.1f}", 1e3 * mm); }

std::string page_of(const Options& o, const metrology::Registration& r, const std::vector<metrology::View>& views,
                    const std::optional<metrology::DeviationMap>& map,
                    const std::vector<metrology::DeviationView>& sides) {
  reports::RegistrationPage page{.title = fmt::format("{} views in one cloud", views.size()),
                                 .figures = {{"mean deviation of the overlaps", um(r.mean_deviation_mm) + " µm"},
                                             {"mean standard deviation of the overlaps", um(r.mean_sd_mm) + " µm"},
                                             {"of it noise of the points", um(r.mean_noise_mm) + " µm"},
                                             {"reference spheres agree within (rms)", um(r.sphere_rms_mm) + " µm"}}};
  for (std::size_t i = 0; i < views.size(); ++i) {
    page.views.push_back({views[i].name, std::to_string(views[i].cloud.points.size()),
                          std::to_string(views[i].spheres_mm.size()), std::to_string(r.n_grazing[i])});
  }
  for (const auto& p : r.pairs) {
    page.pairs.push_back(
        {views[p.a].name, views[p.b].name, std::to_string(p.n_points), um(p.mean_mm), um(p.sd_mm), um(p.noise_mm)});
  }
  if (map) {
    page.truth = reports::RegistrationPage::Truth{
        .source = fmt::format("Every point against the surface of the scene in {}, after the best fit of the whole.",
                              o.truth),
        .figures = {{"points", std::to_string(map->n_points)},
                    {"beyond 5 mm, of something else", std::to_string(map->n_beyond)},
                    {"mean deviation", um(map->mean_mm) + " µm"},
                    {"standard deviation", um(map->sd_mm) + " µm"},
                    {"95 % lie within", "±" + um(0.5 * map->width_95_mm) + " µm"},
                    {"99.7 % lie within", "±" + um(0.5 * map->width_997_mm) + " µm"}}};
    for (const auto& side : sides) {
      page.truth->maps.push_back(
          {side.name, side.mean_mm, side.left_mm, side.top_mm, side.cell_mm, um(side.sd_mm) + " µm"});
    }
  }
  return reports::registration_page(page);
}

Value to_value(const metrology::Registration& r, const std::vector<metrology::View>& views) {
  Value list = Value::array(), pairs = Value::array();
  for (std::size_t i = 0; i < views.size(); ++i) {
    list.append(Value::object()
                    .set("view", views[i].name)
                    .set("spheres", views[i].spheres_mm.size())
                    .set("grazing", r.n_grazing[i])
                    .set("part_from_view", model::to_value(r.part_from_view[i])));
  }
  for (const auto& p : r.pairs) {
    pairs.append(Value::object()
                     .set("a", views[p.a].name)
                     .set("b", views[p.b].name)
                     .set("points", p.n_points)
                     .set("mean_mm", p.mean_mm)
                     .set("sd_mm", p.sd_mm)
                     .set("noise_mm", p.noise_mm));
  }
  return Value::object()
      .set("schema", "fringecal.registration")
      .set("schema_version", 1)
      .set("views", list)
      .set("sphere_rms_mm", r.sphere_rms_mm)
      .set("pairs", pairs)
      .set("mean_deviation_mm", r.mean_deviation_mm)
      .set("mean_sd_mm", r.mean_sd_mm)
      .set("mean_noise_mm", r.mean_noise_mm)
      .set("iterations", r.iterations);
}

void register_clouds(Options& o) {
  if (o.views.size() < 2) throw InputError("register: give at least two clouds");
  const auto scanner = model::read_scanner(o.scanner);
  std::vector<metrology::View> views;
  for (const auto& file : o.views) {
    metrology::View view{.name = file, .cloud = metrology::read_ply(file), .spheres_mm = {}};
    view.pupils = {scanner.world_from_cam().translation_mm, scanner.world_from_proj().translation_mm};
    const metrology::NominalArtefact nominal{"reference sphere", metrology::ArtefactKind::sphere, o.sphere_diameter_mm};
    for (const auto& m : metrology::measure_all(view.cloud, scanner, nominal)) view.spheres_mm.push_back(m.place_mm);
    views.push_back(std::move(view));
  }
  o.registration.refine = !o.spheres_only;
  const auto result = metrology::register_views(views, o.registration);
  if (!result) throw InputError(result.error().sentence);
  const auto whole = metrology::merged(views, *result);
  const auto map = against_truth(o, whole);
  const auto sides = map ? metrology::views_of(whole, *map, kMapCell_mm) : std::vector<metrology::DeviationView>{};
  metrology::write_ply(o.output, whole, map ? std::span<const float>(map->deviation_mm) : std::span<const float>());
  auto record = std::filesystem::path(o.output).replace_extension(".registration.json");
  Value value = to_value(*result, views);
  if (map) value.set("deviations_from_truth", to_value(*map, sides));
  write_atomically(record, to_json(value));
  if (!o.page.empty()) write_atomically(o.page, page_of(o, *result, views, map, sides));
  if (o.json) {
    fmt::print("{}", to_json(value));
    return;
  }
  fmt::print("{} views in one cloud: {}\n", views.size(), o.output);
  fmt::print("  reference spheres agree within {:.4f} mm (rms)\n", result->sphere_rms_mm);
  fmt::print(
      "  {} overlaps: mean deviation {:.4f} mm, mean standard deviation {:.4f} mm, of it {:.4f} mm noise of the points "
      "(paper: 0.1 and 0.076 mm)\n",
      result->pairs.size(), result->mean_deviation_mm, result->mean_sd_mm, result->mean_noise_mm);
  if (map) {
    fmt::print("  against the truth: {} points, mean {:+.4f} mm, standard deviation {:.4f} mm, 95 % within {:.4f} mm\n",
               map->n_points, map->mean_mm, map->sd_mm, 0.5 * map->width_95_mm);
  }
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
  command
      ->add_option(
          "--max-incidence", o->registration.max_incidence_deg,
          "Points that camera or light see at more than this angle from their normal, degrees, do not take part in "
          "joining the views; they stay in the cloud")
      ->check(CLI::Range(10.0, 89.0))
      ->capture_default_str();
  command->add_option(
      "--truth", o->truth,
      "Truth file that `render` wrote with the first view: each point's deviation from the true surface goes "
      "into the cloud (property deviation_mm)");
  command->add_option("--page", o->page,
                      "HTML page to write: the figures, and with --truth the map of the deviations from four sides");
  command->add_flag("--spheres-only", o->spheres_only, "Do not refine on the surface");
  command->add_flag("--json", o->json, "Print the record instead of the summary");
  command->footer(
      "Example: fringecal register view-*.ply --scanner scanner.json --sphere-diameter 20 -o whole.ply --page "
      "whole.html\n"
      "On the virtual scanner: fringecal render --scene \"plaster 0\" -o view-0 --truth view-0.json, and so on to "
      "\"plaster 7\"; measure each; register with --truth view-0.json");
  command->callback([o] { register_clouds(*o); });
}

}  // namespace fringecal::cli

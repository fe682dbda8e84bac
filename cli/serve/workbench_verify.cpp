// What the verification page draws in space: the volume, where the artefacts shall stand, where they stood, and the
// residual clouds of the fits.
#include "cli/serve/workbench.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/prediction.h"
#include "metrology/verification.h"

#include <fmt/format.h>

#include <algorithm>
#include <regex>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

/// x, y, z of one point after the other.
Value flat(const std::vector<Eigen::Vector3d>& line) {
  Value out = Value::array();
  for (const auto& p : line) {
    for (const double v : p) out.append(v);
  }
  return out;
}

Value flat(const std::vector<std::vector<Eigen::Vector3d>>& lines) {
  Value out = Value::array();
  for (const auto& line : lines) out.append(flat(line));
  return out;
}

/// Each artefact of a capture: its name, its place, and its outline where the artefact is known.
Value artefacts_of(const metrology::Series& series, int capture, const std::vector<metrology::Gauge>& gauges) {
  Value out = Value::array();
  const auto places = series.places_of(capture);
  for (std::size_t k = 0; k < places.size(); ++k) {
    metrology::Series alone;
    alone.artefacts = {series.artefacts[k]};
    alone.places = {places[k]};
    Value artefact = Value::object()
                         .set("name", series.artefacts[k])
                         .set("place", flat(std::vector{Eigen::Vector3d(places[k][0], places[k][1], places[k][2])}));
    if (!gauges.empty()) artefact.set("lines", flat(metrology::outlines_of(alone, 0, gauges)));
    out.append(artefact);
  }
  return out;
}

/// Fits of a capture, as its result has them, with the names of the residual clouds that are there.
Value fits_of(const Value& result, const fs::path& folder, const std::string& capture) {
  Value out = Value::array();
  const Value* features = result.find("features");
  if (!features || !features->if_array()) return out;
  std::size_t number = 0;
  for (Value feature : *features->if_array()) {
    const std::string cloud = fmt::format("{}-{}.ply", capture, ++number);
    if (there(folder / "clouds" / cloud)) feature.set("cloud", cloud);
    out.append(std::move(feature));
  }
  return out;
}

}  // namespace

Value Workbench::verification_space(const std::string& name) const {
  const fs::path folder = verification_folder(name);
  const std::string plan_name = plan_of(name);
  Value out = Value::object().set("plan", plan_name), positions = Value::array();
  const metrology::Plan plan = metrology::read_plan(plan_name);
  if (there(commissioning() / "scanner.json")) {
    const auto fields = metrology::fields_of(plan, model::read_scanner(commissioning() / "scanner.json"));
    out.set("camera", flat(fields.camera)).set("code", flat(fields.code));
  }
  std::vector<metrology::Gauge> gauges;
  if (there(folder / "artefacts.toml")) gauges = metrology::read_gauges(folder / "artefacts.toml");
  for (const auto& series : plan.series) {
    for (int i = 0; i < series.captures; ++i) {
      const std::string capture = metrology::capture_name(series, i);
      Value position =
          Value::object().set("capture", capture).set("scene", series.scene).set("number", series.position_of(i) + 1);
      position.set("artefacts", artefacts_of(series, i, gauges));
      const fs::path result = folder / "captures" / (capture + ".json");
      if (there(result)) position.set("fits", fits_of(cached(result), folder, capture));
      positions.append(position);
    }
  }
  return out.set("positions", positions);
}

fs::path Workbench::verification_cloud(const std::string& name, const std::string& cloud) const {
  static const std::regex kCloud("[A-Za-z0-9_-]{1,99}\\.ply");
  fs::path file = verification_folder(name) / "clouds" / cloud;
  std::error_code error;
  if (!std::regex_match(cloud, kCloud) || !fs::is_regular_file(fs::symlink_status(file, error))) {
    throw InputError(fmt::format("there is no cloud \"{}\" in \"{}\"", cloud, name));
  }
  return file;
}

}  // namespace fringecal::cli::serve

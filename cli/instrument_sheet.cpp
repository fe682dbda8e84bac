#include "cli/instrument_sheet.h"

#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "core/provenance.h"
#include "metrology/acceptance.h"
#include "metrology/artefact_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

namespace fringecal::cli {
namespace fs = std::filesystem;
namespace {

using metrology::ArtefactKind;
using metrology::Gauge;

// The targets of this version on the virtual scanner; the paper's own figures stand beside them.
constexpr double kVirtualErrorLimit_mm = 0.06, kVirtualFormLimit_mm = 0.06;

double positive(Fields& fields, const char* key) {
  const double value = fields.number(key);
  if (!(value > 0)) fields.complain(fmt::format("{} is {}; give a positive number", key, value));
  return value;
}

Uncertain diameter_of(const Gauge& gauge, const metrology::Environment& environment) {
  double variance = 0;
  for (const auto& c : contributions_of(gauge, gauge.diameter_mm.front(), gauge.U_diameter_mm, environment)) {
    variance += c.u_of_quantity() * c.u_of_quantity();
  }
  return {length_at(gauge, gauge.diameter_mm.front(), environment), std::sqrt(variance)};
}

fs::path beside(const fs::path& file, const std::string& name) { return file.parent_path() / name; }

}  // namespace

InstrumentSheet sheet_of(const virt::VirtualScanner& instrument, const CommissionChoices& choices) {
  InstrumentSheet sheet;
  sheet.name = fmt::format("virtual {} seed {}", choices.preset, choices.seed);
  sheet.identification = fmt::format("virtual scanner {}, instrument {}", choices.preset, choices.seed);
  sheet.note = fmt::format(
      "Preset {}: a stand-in for the scanner of Chen et al. (2008), rendered with the errors of a real one.",
      choices.preset);
  sheet.pixel_mm = instrument.pixel_mm();
  sheet.working_distance_mm = instrument.design_working_distance_mm();
  sheet.pattern_pitch_mm = instrument.pattern_pitch_mm();
  sheet.plan = instrument.plan();
  sheet.flatness_mm = instrument.certified_flatness_mm();
  sheet.board = instrument.certified_board("chessboard");
  sheet.scenes = {{"plane", {{"plane", ArtefactKind::plane, 0}}},
                  {"spheres",
                   {{"sphere50", ArtefactKind::sphere, 50},
                    {"sphere38", ArtefactKind::sphere, 38},
                    {"sphere30", ArtefactKind::sphere, 30}}},
                  {"cylinder", {{"cylinder", ArtefactKind::cylinder, 119.85}}}};
  for (const auto& scene : sheet.scenes) {
    for (const auto& a : scene.artefacts) {
      if (a.kind != ArtefactKind::plane) sheet.diameter_mm[a.name] = instrument.certificate_mm(a.name);
    }
  }
  sheet.error_limit_mm = kVirtualErrorLimit_mm;
  sheet.form_limit_mm = kVirtualFormLimit_mm;
  return sheet;
}

InstrumentSheet read_sheet(const fs::path& file, const PatternPlan& plan, const metrology::Environment& environment) {
  Fields fields(read_toml(file), file.string());
  InstrumentSheet sheet;
  sheet.name = sheet.identification = fields.text("name");
  sheet.pixel_mm = positive(fields, "pixel_mm");
  sheet.working_distance_mm = positive(fields, "working_distance_mm");
  sheet.pattern_pitch_mm = positive(fields, "pattern_pitch_mm");
  if (fields.has("mrad_per_division")) sheet.mrad_per_division = positive(fields, "mrad_per_division");
  if (fields.has("flatness_mm")) sheet.flatness_mm = positive(fields, "flatness_mm");
  sheet.board = model::read_board(beside(file, fields.text("board")));
  const auto gauges = metrology::read_gauges(beside(file, fields.text("artefacts")));
  sheet.error_limit_mm = positive(fields, "error_limit_mm");
  sheet.form_limit_mm = positive(fields, "form_limit_mm");
  if (!plan.x) fields.complain("scanner.toml codes no x axis; the grating slides across the fringes of x");
  sheet.plan = plan;
  const std::string today = utc_now().substr(0, 10);
  for (Fields& f : fields.tables("scene")) {
    VerificationScene scene{.name = f.text("name"), .artefacts = {}};
    if (scene.name.empty() || scene.name.find_first_of("/\\ ") != std::string::npos) {
      f.complain(fmt::format("name '{}' becomes the name of files; give one word", scene.name));
    }
    for (const std::string& name : f.texts("artefacts")) {
      const Gauge& gauge = metrology::gauge_named(gauges, name);
      const auto parts = metrology::nominals_of(gauge);
      if (parts.size() != 1) {
        f.complain(fmt::format("'{}' is a {}; a commissioning measures spheres, cylinders and flats, verify the others",
                               name, metrology::name_of(gauge.kind)));
      }
      scene.artefacts.push_back(parts.front());
      if (parts.front().kind != ArtefactKind::plane) sheet.diameter_mm[name] = diameter_of(gauge, environment);
      if (metrology::is_expired(gauge, today)) sheet.expired.push_back(name);
    }
    f.finish();
    if (scene.artefacts.empty()) f.complain("names no artefact");
    for (const auto& other : sheet.scenes) {
      if (other.name == scene.name) f.complain(fmt::format("there are two scenes '{}'", scene.name));
    }
    sheet.scenes.push_back(std::move(scene));
  }
  fields.finish();
  if (sheet.scenes.empty()) fields.complain("there is no [[scene]]; say which artefacts are measured together");
  return sheet;
}

std::string fingerprint_of_sheet(const fs::path& file) {
  Fields fields(read_toml(file), file.string());
  std::string all = sha256_of_file(file);
  for (const char* key : {"board", "artefacts"}) all += sha256_of_file(beside(file, fields.text(key)));
  return sha256_hex(all);
}

}  // namespace fringecal::cli

#include "metrology/instrument_record.h"

#include "core/provenance_reader.h"

#include <fmt/format.h>

#include <numbers>

namespace fringecal::metrology {
namespace {

constexpr const char* kSchema = "fringecal.instrument_record";
constexpr int kVersion = 1;

void add_paper_model(std::vector<RecordedQuantity>& out, const model::Chen2008Model& m) {
  out.push_back({"kc1", "camera distortion, 2nd order, eq. 18", "", "mm^-2", m.kc1_per_mm2, {}});
  out.push_back({"kc2", "camera distortion, 4th order, eq. 18", "", "mm^-4", m.kc2_per_mm4, {}});
  out.push_back({"kp1", "projector distortion, 2nd order, eq. 19", "", "mm^-2", m.kp1_per_mm2, {}});
  out.push_back({"kp2", "projector distortion, 4th order, eq. 19", "", "mm^-4", m.kp2_per_mm4, {}});
  out.push_back({"L", "working distance", "", "mm", m.L_mm, {}});
  out.push_back({"b", "base, camera to projector", "", "mm", m.b_mm, {}});
  out.push_back({"alpha", "angle between the optical axes", "", "deg", m.alpha_rad * 180 / std::numbers::pi, {}});
  out.push_back({"p_R", "fringe period on the reference plane", "", "mm", m.p_R_mm, {}});
}

std::string unit_of(const std::string& parameter, const model::Scanner& scanner) {
  if (parameter.ends_with("_px")) return "px";
  if (parameter.ends_with("_mm")) return "mm";
  if (parameter.ends_with(".f") || parameter.ends_with(".u0")) {
    return scanner.projector.axis(scanner.projector.main_axis())->code.unit;
  }
  return "1";
}

Value to_value(const RecordedQuantity& q) {
  Value out = Value::object()
                  .set("symbol", q.symbol)
                  .set("name", q.name)
                  .set("artefact", kScannerItself)
                  .set("position", q.position)
                  .set("unit", q.unit)
                  .set("value", q.value);
  if (q.u) out.set("uncertainty", Value::object().set("u", *q.u).set("k", 2).set("U", 2 * *q.u));
  if (q.limits && q.limits->lower) out.set("lower_limit", *q.limits->lower);
  if (q.limits && q.limits->upper) out.set("upper_limit", *q.limits->upper);
  return out;
}

RecordedQuantity read_quantity(Fields fields) {
  RecordedQuantity q;
  q.symbol = fields.text("symbol");
  q.name = fields.text("name");
  if (const std::string artefact = fields.text("artefact"); artefact != kScannerItself) {
    fields.complain(
        fmt::format("artefact is \"{}\"; of an instrument's own quantities it is \"{}\"", artefact, kScannerItself));
  }
  q.position = fields.text("position");
  q.unit = fields.text("unit");
  q.value = fields.number("value");
  if (auto uncertainty = fields.optional_table("uncertainty")) {
    q.u = uncertainty->number("u");
    uncertainty->ignore("k");
    uncertainty->ignore("U");
    uncertainty->finish();
  }
  const auto lower = fields.optional_number("lower_limit"), upper = fields.optional_number("upper_limit");
  if (lower || upper) q.limits = Limits{lower, upper};
  fields.finish();
  return q;
}

}  // namespace

InstrumentRecord record_of(const model::Scanner& scanner, const std::string& ended) {
  InstrumentRecord out{.event = "calibration", .scanner = scanner.name, .ended = ended, .provenance = provenance_now()};
  const auto& r = scanner.residuals;
  out.outcome = fmt::format("{} poses, {} corners, camera {:.3f} px, board reproduced to {:.4f} mm rms", r.poses,
                            r.corners_used, r.camera_rms_px, r.grid_rms_mm);
  if (scanner.paper_model) add_paper_model(out.quantities, scanner.paper_model->model);
  for (const auto& name : scanner.uncertainty.names) {
    if (name.find("rotation") != std::string::npos) continue;  // increments about an attitude, not a course over years
    out.quantities.push_back({name, "calibrated parameter", "", unit_of(name, scanner), scanner.value_of(name),
                              scanner.uncertainty.u(name)});
  }
  out.quantities.push_back({"base", "distance of the pupils", "", "mm", scanner.base_mm(), {}});
  out.quantities.push_back({"camera_rms", "residual of the camera, rms", "", "px", r.camera_rms_px, {}});
  out.quantities.push_back(
      {"projector_rms", "residual of the projector, rms", "", r.projector_unit, r.projector_rms, {}});
  out.quantities.push_back({"grid_rms", "board against its nominal, rms", "", "mm", r.grid_rms_mm, {}});
  out.provenance.inputs = scanner.provenance.inputs;
  return out;
}

std::optional<RecordedQuantity> temperature_of(const std::vector<CaptureInfo>& captures) {
  double sum = 0;
  int n = 0;
  for (const auto& info : captures) {
    for (const auto& [sensor, degC] : info.temperatures_degC) {
      sum += degC;
      ++n;
    }
  }
  if (n == 0) return std::nullopt;
  return RecordedQuantity{"temperature", "mean of the captures' sensors", "", "degC", sum / n, {}};
}

Value to_value(const InstrumentRecord& record) {
  Value quantities = Value::array();
  for (const auto& q : record.quantities) quantities.append(to_value(q));
  return Value::object()
      .set("schema", kSchema)
      .set("schema_version", kVersion)
      .set("event", record.event)
      .set("scanner", record.scanner)
      .set("ended", record.ended)
      .set("outcome", record.outcome)
      .set("quantities", quantities)
      .set("provenance", fringecal::to_value(record.provenance));
}

InstrumentRecord instrument_record_from(const Value& value, const std::string& name) {
  Fields fields(value, name);
  fields.expect_schema(kSchema, kVersion);
  InstrumentRecord out;
  out.event = fields.text("event");
  out.scanner = fields.text("scanner");
  out.ended = fields.text("ended");
  out.outcome = fields.text("outcome");
  for (auto& q : fields.tables("quantities")) out.quantities.push_back(read_quantity(std::move(q)));
  out.provenance = provenance_from(fields.table("provenance"));
  fields.finish();
  return out;
}

std::int64_t append_once(History& history, const InstrumentRecord& record) {
  for (const auto& entry : history.entries(record.event)) {
    const std::string name = fmt::format("history, entry {}", entry.number);
    const auto before = instrument_record_from(parse_json(entry.document, name), name);
    if (before.scanner == record.scanner && before.provenance.inputs == record.provenance.inputs) return entry.number;
  }
  return history.append(record.event, to_value(record), record.ended).number;
}

}  // namespace fringecal::metrology

// report.json; its form is documented in commissioning_report.h.
#include "reports/commissioning_report.h"

#include <fmt/format.h>

namespace fringecal::reports {
namespace {

constexpr const char* kSchema = "fringecal.report";
constexpr int kSchemaVersion = 1;

template <class T>
void set_if(Value& object, std::string_view key, const std::optional<T>& value) {
  if (value) object.set(key, *value);
}

void set_uncertain(Value& object, const std::string& key, const Uncertain& quantity) {
  object.set(key, quantity.value).set("u_" + key, quantity.u);
}

/// An array of any structs, each through `one`.
template <class T, class One>
Value array_of(const std::vector<T>& items, const One& one) {
  Value out = Value::array();
  for (const auto& item : items) out.append(one(item));
  return out;
}

/// One member of each struct as an array of numbers.
template <class T>
Value column(const std::vector<T>& items, double T::*member) {
  return array_of(items, [&](const T& item) { return Value(item.*member); });
}

Value profile(const ProfileColumns& p) {
  return Value::object()
      .set("row_px", p.row_px)
      .set("column_px", Value::numbers(p.column_px))
      .set("gray_number", Value::numbers(p.gray_number))
      .set("phase_rad", Value::numbers(p.phase_rad));
}

Value iteration(const AlignmentIteration& i) {
  Value out = Value::object();
  out.set("number", i.number);
  set_uncertain(out, "theta_mrad", i.theta_mrad);
  out.set("bit", i.bit);
  set_uncertain(out, "delta_um", i.delta_um);
  out.set("fraction_of_period", i.fraction_of_period).set("period_px", i.period_px).set("jump_px", i.jump_px);
  set_if(out, "turn_mrad", i.turn_mrad);
  return out.set("instruction", i.instruction).set("verdict", i.verdict);
}

Value alignment(const AlignmentSection& a) {
  Value out = Value::object();
  out.set("tolerance_fraction", a.tolerance_fraction).set("conclusion", a.conclusion);
  out.set("iterations", array_of(a.iterations, iteration));
  if (a.before) out.set("before", profile(*a.before));
  if (a.after) out.set("after", profile(*a.after));
  return out;
}

Value parameter(const Parameter& p) {
  Value out = Value::object();
  out.set("name", p.name).set("value", p.value);
  set_if(out, "u", p.u);
  return out.set("unit", p.unit).set("meaning", p.meaning);
}

Value calibration(const CalibrationSection& c) {
  const auto pose = [](const PoseUse& p) {
    return Value::object().set("name", p.name).set("used", p.used).set("reason", p.reason);
  };
  return Value::object()
      .set("method", c.method)
      .set("parameters", array_of(c.parameters, parameter))
      .set("paper_parameters", array_of(c.paper_parameters, parameter))
      .set("residuals", model::to_value(c.residuals))
      .set("poses", array_of(c.poses, pose))
      .set("image_width_px", c.image_width_px)
      .set("image_height_px", c.image_height_px)
      .set("camera_residuals", Value::object()
                                   .set("pixel_x_px", column(c.camera_residuals, &CameraResidual::pixel_x_px))
                                   .set("pixel_y_px", column(c.camera_residuals, &CameraResidual::pixel_y_px))
                                   .set("residual_x_px", column(c.camera_residuals, &CameraResidual::residual_x_px))
                                   .set("residual_y_px", column(c.camera_residuals, &CameraResidual::residual_y_px)))
      .set("projector_residuals", Value::object()
                                      .set("pixel_x_px", column(c.projector_residuals, &ProjectorResidual::pixel_x_px))
                                      .set("pixel_y_px", column(c.projector_residuals, &ProjectorResidual::pixel_y_px))
                                      .set("residual", column(c.projector_residuals, &ProjectorResidual::residual)));
}

Value model_result(const ModelResult& m) {
  Value out = Value::object();
  out.set("model", m.model);
  set_if(out, "mean_diameter_mm", m.mean_diameter_mm);
  set_if(out, "error_mm", m.error_mm);
  set_if(out, "u_error_mm", m.u_error_mm);
  set_if(out, "repeatability_sd_mm", m.repeatability_sd_mm);
  return out.set("max_form_sd_mm", m.max_form_sd_mm).set("mean_form_sd_mm", m.mean_form_sd_mm);
}

Value repeat(const Repeat& r) {
  Value out = Value::object();
  set_if(out, "diameter_mm", r.diameter_mm);
  return out.set("form_sd_mm", r.form_sd_mm).set("n_points", r.n_points).set("n_rejected", r.n_rejected);
}

Value artefact(const ArtefactSection& a) {
  Value paper = Value::object();
  paper.set("text", a.paper.text);
  set_if(paper, "error_limit_mm", a.paper.error_limit_mm);
  set_if(paper, "form_sd_mm", a.paper.form_sd_mm);
  Value out = Value::object();
  out.set("name", a.name).set("kind", word_for(a.kind));
  if (a.certificate_mm) set_uncertain(out, "certificate_mm", *a.certificate_mm);
  return out.set("paper", paper)
      .set("verdict", word_for(a.verdict))
      .set("criterion", a.criterion)
      .set("models", array_of(a.models, model_result))
      .set("repeats", array_of(a.repeats, repeat))
      .set("remarks", array_of(a.remarks, [](const std::string& s) { return Value(s); }));
}

}  // namespace

Value to_value(const CommissioningReport& report) {
  Value out = Value::object();
  out.set("schema", kSchema).set("schema_version", kSchemaVersion);
  out.set("title", report.title).set("scanner_name", report.scanner_name);
  out.set("virtual_instrument", report.virtual_instrument);
  // As text above 2^63 - 1: a JSON integer here is signed.
  if (report.seed) {
    out.set("seed", *report.seed <= INT64_MAX ? Value(static_cast<std::int64_t>(*report.seed))
                                              : Value(fmt::format("{}", *report.seed)));
  }
  out.set("instrument_note", report.instrument_note);
  out.set("verdict", word_for(report.verdict)).set("verdict_text", report.verdict_text);
  out.set("verdicts", array_of(report.verdicts, [](const VerdictLine& line) {
            return Value::object().set("verdict", word_for(line.verdict)).set("text", line.text);
          }));
  out.set("provenance", to_value(report.provenance));
  out.set("stages", array_of(report.stages, [](const Stage& stage) {
            return Value::object().set("name", stage.name).set("duration_s", stage.duration_s);
          }));
  if (report.alignment) out.set("alignment", alignment(*report.alignment));
  out.set("fringes", array_of(report.fringes, [](const FringeFrame& frame) { return Value(frame.caption); }));
  if (report.phase_map) {
    out.set("phase_map", Value::object()
                             .set("caption", report.phase_map->caption)
                             .set("width_px", report.phase_map->phase_rad.width())
                             .set("height_px", report.phase_map->phase_rad.height()));
  }
  if (report.calibration) out.set("calibration", calibration(*report.calibration));
  if (report.phase_corrections) {
    out.set("phase_corrections",
            array_of(report.phase_corrections->sentences, [](const std::string& sentence) { return Value(sentence); }));
  }
  out.set("artefacts", array_of(report.artefacts, artefact));
  return out;
}

}  // namespace fringecal::reports

#include "calib/align_record.h"

#include "core/fields.h"

namespace fringecal::calib {
namespace {

constexpr const char* kSchema = "fringecal.alignment_record";

Value record(Value iterations) {
  return Value::object().set("schema", kSchema).set("schema_version", 1).set("iterations", std::move(iterations));
}

}  // namespace

Value to_value(const Misalignment& m) {
  Value bits = Value::array(), remarks = Value::array();
  for (const auto& b : m.bits) {
    bits.append(Value::object()
                    .set("bit", b.bit)
                    .set("delta_um", 1e3 * b.delta_mm.value)
                    .set("u_delta_um", 1e3 * b.delta_mm.u)
                    .set("u_noise_um", 1e3 * b.u_noise_mm)
                    .set("fraction_of_period", b.fraction_of_period)
                    .set("rising_um", 1e3 * b.rising_mm)
                    .set("falling_um", 1e3 * b.falling_mm)
                    .set("lever_mm", b.lever_mm)
                    .set("tilt_um", 1e3 * b.tilt_mm.value)
                    .set("u_tilt_um", 1e3 * b.tilt_mm.u)
                    .set("n_edges", b.n_edges)
                    .set("jump_px", b.jump_px)
                    .set("period_px", b.period_px));
  }
  for (const auto& remark : m.remarks) remarks.append(remark);
  Value out = Value::object().set("theta_mrad", 1e3 * m.theta_rad.value).set("u_theta_mrad", 1e3 * m.theta_rad.u);
  if (m.theta_from_steps_rad) {
    out.set("theta_from_steps_mrad", 1e3 * m.theta_from_steps_rad->value)
        .set("u_theta_from_steps_mrad", 1e3 * m.theta_from_steps_rad->u)
        .set("u_difference_mrad", 1e3 * m.u_difference_rad);
  }
  return out.set("u_noise_mrad", 1e3 * m.u_noise_rad)
      .set("captures_averaged", m.stacks)
      .set("delta_um", 1e3 * m.delta_mm.value)
      .set("u_delta_um", 1e3 * m.delta_mm.u)
      .set("delta_bit", m.bits.empty() ? Value() : Value(m.bits.front().bit))
      .set("fraction_of_period", m.fraction_of_period)
      .set("chi2_per_dof", m.chi2_per_dof)
      .set("bits", bits)
      .set("remarks", remarks);
}

Value to_value(const AlignmentStep& step) {
  return Value::object()
      .set("decision", name_of(step.decision))
      .set("sentence", step.sentence)
      .set("turn_mrad", 1e3 * step.turn_rad)
      .set("bit", step.bit)
      .set("delta_um", 1e3 * step.delta_mm.value)
      .set("u_delta_um", 1e3 * step.delta_mm.u)
      .set("tolerance_um", 1e3 * step.tolerance_mm)
      .set("gain", step.gain.value)
      .set("u_gain", step.gain.u)
      .set("backlash_mrad", 1e3 * step.backlash_rad.value)
      .set("u_backlash_mrad", 1e3 * step.backlash_rad.u);
}

Value to_value(const AlignmentIteration& iteration) {
  return Value::object()
      .set("capture", iteration.capture)
      .set("turn_before_mrad", 1e3 * iteration.turn_before_rad)
      .set("measured", to_value(iteration.measured))
      .set("step", to_value(iteration.step));
}

Value to_value(const AlignmentProfile& profile) {
  return Value::object()
      .set("row", profile.row)
      .set("column_px", Value::numbers(profile.column))
      .set("gray_number", Value::numbers(profile.gray_number))
      .set("phase_rad", Value::numbers(profile.phase_rad))
      .set("wrapped_rad", Value::numbers(profile.wrapped_rad));
}

Value record_of(std::span<const AlignmentIteration> iterations) {
  Value all = Value::array();
  for (const auto& iteration : iterations) all.append(to_value(iteration));
  return record(std::move(all));
}

AlignmentHistory read_record(const std::filesystem::path& file) {
  Fields fields(read_json(file), file.string());
  fields.expect_schema(kSchema, 1);
  AlignmentHistory history;
  const Value iterations = fields.raw("iterations");
  if (const auto* array = iterations.if_array()) history.iterations = *array;
  for (Fields& iteration : fields.tables("iterations")) {
    Fields measured = iteration.table("measured");
    history.readings.push_back({{1e-3 * measured.number("theta_mrad"), 1e-3 * measured.number("u_theta_mrad")},
                                1e-3 * iteration.number("turn_before_mrad")});
  }
  fields.finish();
  return history;
}

Value record_of(const AlignmentHistory& before, const AlignmentIteration& latest) {
  Value all = Value::array();
  for (const auto& iteration : before.iterations) all.append(iteration);
  all.append(to_value(latest));
  return record(std::move(all));
}

}  // namespace fringecal::calib

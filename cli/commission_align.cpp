// Step 1 of a commissioning: the paper's loop (b) to (e) on the virtual scanner's motorised adjuster.
#include "calib/align_loop.h"
#include "calib/align_map.h"
#include "cli/commission_steps.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "core/image_file.h"

#include <fmt/format.h>

#include <chrono>

namespace fringecal::cli {
namespace {

struct Iteration {
  double theta_mrad = 0, u_theta_mrad = 0, turn_mrad = 0;
  std::string decision, sentence;
};

Value to_value(const calib::Misalignment& m, const calib::AlignmentStep& step, double turn_mrad, double duration_s) {
  Value bits = Value::array();
  for (const auto& b : m.bits) {
    bits.append(Value::object()
                    .set("bit", b.bit)
                    .set("delta_um", 1e3 * b.delta_mm.value)
                    .set("u_delta_um", 1e3 * b.delta_mm.u)
                    .set("fraction_of_period", b.fraction_of_period)
                    .set("rising_um", 1e3 * b.rising_mm)
                    .set("falling_um", 1e3 * b.falling_mm)
                    .set("n_edges", b.n_edges)
                    .set("jump_px", b.jump_px)
                    .set("period_px", b.period_px));
  }
  Value remarks = Value::array();
  for (const auto& remark : m.remarks) remarks.append(remark);
  return Value::object()
      .set("schema", "fringecal.alignment")
      .set("schema_version", 1)
      .set("theta_mrad", 1e3 * m.theta_rad.value)
      .set("u_theta_mrad", 1e3 * m.theta_rad.u)
      .set("bit", step.bit)
      .set("delta_um", 1e3 * step.delta_mm.value)
      .set("u_delta_um", 1e3 * step.delta_mm.u)
      .set("tolerance_um", 1e3 * step.tolerance_mm)
      .set("chi2_per_dof", m.chi2_per_dof)
      .set("bits", bits)
      .set("remarks", remarks)
      .set("decision", calib::name_of(step.decision))
      .set("sentence", step.sentence)
      .set("turn_mrad", turn_mrad)
      .set("duration_s", duration_s);
}

Iteration iteration_from(const Value& value, const std::string& file) {
  Fields f(value, file);
  f.expect_schema("fringecal.alignment", 1);
  return {f.number("theta_mrad"), f.number("u_theta_mrad"), f.number("turn_mrad"), f.text("decision"),
          f.text("sentence")};
}

}  // namespace

void align_step(const CommissionSession& session, virt::VirtualScanner& instrument, virt::InstrumentState& state,
                Progress& progress) {
  const calib::GratingLayout layout{.pattern_pitch_mm = instrument.pattern_pitch_mm()};
  std::vector<calib::AlignmentReading> history;
  double turn_before_mrad = 0;
  for (int i = 0; i < kMaxAlignments; ++i) {
    const std::string name = fmt::format("alignment/iteration-{}", i);
    Iteration iteration;
    if (session.has(name + ".json")) {
      iteration = iteration_from(session.load(name + ".json"), session.path(name + ".json").string());
      history.push_back({{iteration.theta_mrad * 1e-3, iteration.u_theta_mrad * 1e-3}, turn_before_mrad * 1e-3});
      progress.done(Weights::alignment, true);
    } else {
      progress.start(fmt::format("aligning the grating, capture {}", i + 1));
      const auto begin = std::chrono::steady_clock::now();
      Capture first;
      const auto take = [&](int k) {
        const std::string stack = k == 0 ? name : fmt::format("{}-more-{}", name, k);
        Capture capture = instrument.capture(instrument.standard_scene("alignment"), state, session.stack_seed(stack));
        write_capture(session.path(stack), capture);
        auto one = calib::measure_misalignment(capture, layout);
        if (k == 0) first = std::move(capture);
        return one;
      };
      const auto reading = calib::read_setting(
          take, history, {.turn_before_rad = 1e-3 * turn_before_mrad, .layout = layout, .code = *instrument.plan().x});
      if (!reading) throw InputError(fmt::format("{}: {}", session.path(name).string(), reading.error().sentence));
      const auto& [measured, step] = *reading;
      write_atomically(session.path(name + "-delta.tiff"),
                       encode_tiff(calib::delta_map_um(first, measured, CodeAxis::x)));
      history.push_back({measured.theta_rad, turn_before_mrad * 1e-3});
      iteration = {1e3 * measured.theta_rad.value, 1e3 * measured.theta_rad.u, 1e3 * step.turn_rad,
                   calib::name_of(step.decision), step.sentence};
      const std::chrono::duration<double> duration = std::chrono::steady_clock::now() - begin;
      session.store(name + ".json", to_value(measured, step, iteration.turn_mrad, duration.count()));
      progress.done(Weights::alignment);
    }
    if (iteration.decision != calib::name_of(calib::AlignmentDecision::turn)) {
      const bool aligned = iteration.decision == calib::name_of(calib::AlignmentDecision::aligned);
      progress.done(Weights::alignment * (3 - i > 0 ? 2 - i : 0), true);
      progress.finish_step(fmt::format("{} after {} adjustments: theta = {:+.4f} mrad, u = {:.4f} mrad",
                                       aligned ? "grating aligned" : iteration.decision, i, iteration.theta_mrad,
                                       iteration.u_theta_mrad));
      return;
    }
    progress.finish_step(fmt::format("theta = {:+.4f} mrad: {}", iteration.theta_mrad, iteration.sentence));
    instrument.turn_adjuster(iteration.turn_mrad, state);
    turn_before_mrad = iteration.turn_mrad;
  }
  throw InputError(fmt::format("{}: the grating is not aligned after {} adjustments; see the iterations there",
                               session.path("alignment").string(), kMaxAlignments));
}

}  // namespace fringecal::cli

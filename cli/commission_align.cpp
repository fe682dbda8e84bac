// Step 1 of a commissioning: the paper's loop (b) to (e) .
#include "calib/align_map.h"
#include "calib/align_record.h"
#include "cli/commission_steps.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "core/image_file.h"

#include <fmt/format.h>

namespace fringecal::cli {
namespace {

constexpr const char* kRecord = "alignment/record.json";
constexpr const char* kDuration = "alignment/duration.json";

/// What the loop needs of an iteration that stands in the record.
struct Iteration {
  double theta_mrad = 0, u_theta_mrad = 0, turn_mrad = 0;
  std::string decision, sentence;
};

Iteration iteration_from(const Value& value, const std::string& file) {
  Fields f(value, file);
  Fields measured = f.table("measured"), step = f.table("step");
  return {measured.number("theta_mrad"), measured.number("u_theta_mrad"), step.number("turn_mrad"),
          step.text("decision"), step.text("sentence")};
}

}  // namespace

void align_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress) {
  const InstrumentSheet& sheet = instrument.sheet();
  calib::AlignmentLoopOptions loop;
  if (sheet.mrad_per_division) loop.rad_per_division = 1e-3 * *sheet.mrad_per_division;
  const calib::GratingLayout layout{.pattern_pitch_mm = sheet.pattern_pitch_mm};
  calib::AlignmentHistory history;
  double duration_s = 0, turn_before_mrad = 0;
  if (session.has(kRecord)) {
    history = calib::read_record(session.path(kRecord));
    duration_s = Fields(session.load(kDuration), session.path(kDuration).string()).number("duration_s");
  }
  for (std::size_t i = 0; i < kMaxAlignments; ++i) {
    const bool known = i < history.iterations.size();
    if (!known) {
      const Stopwatch watch;
      const std::string name = fmt::format("alignment/iteration-{}", i);
      progress.start(fmt::format("aligning the grating, capture {}", i + 1));
      Capture first;
      std::string latest_name;
      const auto take = [&](int k) {
        latest_name = k == 0 ? name : fmt::format("{}-more-{}", name, k);
        Capture capture = instrument.capture(latest_name, "alignment");
        auto one = calib::measure_misalignment(capture, layout);
        if (k == 0) first = std::move(capture);
        return one;
      };
      const auto reading = calib::read_setting(
          take, history.readings,
          {.turn_before_rad = 1e-3 * turn_before_mrad, .layout = layout, .code = *sheet.plan.x, .loop = loop});
      if (!reading) session.refuse_capture(latest_name, reading.error().sentence);
      write_atomically(session.path(name + "-delta.tiff"),
                       encode_tiff(calib::delta_map_um(first, reading->measured, CodeAxis::x)));
      const calib::AlignmentIteration latest{.capture = name,
                                             .turn_before_rad = 1e-3 * turn_before_mrad,
                                             .measured = reading->measured,
                                             .step = reading->step};
      session.store(kDuration, Value::object().set("duration_s", duration_s += watch.seconds()));
      session.store(kRecord, calib::record_of(history, latest));
      history = calib::read_record(session.path(kRecord));  // a run that is continued starts from the same digits
    }
    progress.done(Weights::alignment, known);
    const Iteration iteration = iteration_from(history.iterations[i], session.path(kRecord).string());
    if (iteration.decision != calib::name_of(calib::AlignmentDecision::turn)) {
      const bool aligned = iteration.decision == calib::name_of(calib::AlignmentDecision::aligned);
      progress.done(Weights::alignment * (i < 3 ? 2 - static_cast<double>(i) : 0), true);
      progress.finish_step(fmt::format("{} after {} adjustments: theta = {:+.4f} mrad, u = {:.4f} mrad",
                                       aligned ? "grating aligned" : iteration.decision, i, iteration.theta_mrad,
                                       iteration.u_theta_mrad));
      return;
    }
    progress.finish_step(fmt::format("theta = {:+.4f} mrad: {}", iteration.theta_mrad, iteration.sentence));
    const bool seen = i + 1 < history.iterations.size();
    instrument.turn_adjuster(iteration.turn_mrad, seen ? Turned::before : known ? Turned::perhaps : Turned::not_yet);
    turn_before_mrad = iteration.turn_mrad;
  }
  throw InputError(fmt::format("{}: the grating is not aligned after {} adjustments; see the iterations there",
                               session.path("alignment").string(), kMaxAlignments));
}

}  // namespace fringecal::cli

// Step 4 of a commissioning: the paper's section 4. Plane, three spheres, cylinder, each ten times, through the full
// model, the paper's eqs. 1 to 20, and its ideal eqs. 1 to 17, both with the parameters fitted to the same scanner.
#include "calib/decode/corrections.h"
#include "cli/behind.h"
#include "cli/commission_steps.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "metrology/reconstruct.h"

#include <fmt/format.h>

#include <optional>
#include <system_error>

namespace fringecal::cli {
namespace {

Value to_value(const metrology::ArtefactMeasurement& m) {
  Value out = Value::object().set("name", m.name).set("kind", metrology::name_of(m.kind));
  if (m.diameter_mm) out.set("diameter_mm", *m.diameter_mm).set("u_diameter_noise_mm", m.u_diameter_noise_mm);
  return out.set("form_standard_deviation_mm", m.form_standard_deviation_mm)
      .set("place_mm", Value::numbers(m.place_mm))
      .set("n_points", m.n_points)
      .set("n_grazing", m.n_grazing)
      .set("n_gross", m.n_gross);
}

void remove_capture(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::remove_all(folder, error);
  if (!error) return;
  throw EnvironmentError(
      fmt::format("{}: cannot be removed ({}); remove it by hand", folder.string(), error.message()));
}

Value corrections_value(const decode::MeasuringMap& map) {
  Value out = Value::object().set("linearised", map.linearised).set("words", decode::words_for(map));
  if (map.stack) {
    out.set("one_cycle_mrad", 1e3 * std::abs(map.stack->ellipse.offset))
        .set("two_cycles_mrad", 1e3 * std::abs(map.stack->ellipse.conjugate));
  }
  return out;
}

decode::CorrectionOptions corrections_of(const CommissionChoices& choices) {
  return {.linearisation = choices.linearisation ? decode::Correct::yes : decode::Correct::no,
          .stack = choices.stack_correction ? decode::Correct::yes : decode::Correct::no};
}

/// One stack through the three models; the deviation maps of the first repeat as files.
class Evaluation {
 public:
  Evaluation(const CommissionSession& session, const model::Scanner& scanner)
      : session_(session), scanner_(scanner), reconstruct_(scanner) {}

  void operator()(const Capture& capture, const VerificationScene& scene, int repeat) {
    const std::string name = fmt::format("verification/{}-{:02}", scene.name, repeat);
    const auto measured = decode::decode_for_measuring(capture, scanner_.projector.main_axis(),
                                                       scanner_.linearisation ? &*scanner_.linearisation : nullptr,
                                                       corrections_of(session_.choices()));
    Value models = Value::object(), u_calibration = Value::object();
    for (const auto& [model, word] : {std::pair(metrology::ReconstructionModel::full, "full"),
                                      std::pair(metrology::ReconstructionModel::chen2008, "chen2008"),
                                      std::pair(metrology::ReconstructionModel::ideal, "ideal")}) {
      const bool full = model == metrology::ReconstructionModel::full;
      points_ = reconstruct_(measured.map, {.model = model, .normals = false}, std::move(points_));
      const auto found = metrology::measure_artefacts(points_.cloud, scanner_, scene.artefacts);
      if (!found) session_.refuse_capture(name, fmt::format("{} model: {}", word, found.error().sentence));
      Value list = Value::array();
      for (const auto& m : *found) {
        list.append(to_value(m));
        if (!full || repeat > 0) continue;
        write_atomically(session_.path(fmt::format("{}-{}-deviation.tiff", name, m.name)), encode_tiff(m.deviation_mm));
        if (!m.diameter_mm) continue;
        const auto u = metrology::u_diameter_from_calibration(m, scanner_);
        if (!u) throw InputError(fmt::format("{}: {}: {}", name, m.name, u.error().sentence));
        u_calibration.set(m.name, *u);
      }
      models.set(word, list);
    }
    const double now_s = watch_.seconds();
    session_.store(name + ".json", Value::object()
                                       .set("models", models)
                                       .set("u_calibration_mm", u_calibration)
                                       .set("corrections", corrections_value(measured))
                                       .set("duration_s", now_s - last_s_));
    last_s_ = now_s;
    // The frames of the first repeat stay beside the results.
    if (repeat > 0) remove_capture(session_.path(name));
  }

 private:
  const CommissionSession& session_;
  const model::Scanner& scanner_;
  metrology::Reconstructor reconstruct_;
  metrology::Reconstruction points_;
  const Stopwatch watch_;
  double last_s_ = 0;  // durations add up although capture and evaluation overlap
};

}  // namespace

void verify_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress) {
  const auto scanner = model::read_scanner(session.path("scanner.json"));
  const auto& scenes = instrument.sheet().scenes;
  std::optional<Evaluation> evaluation;
  Behind behind;
  for (const auto& scene : scenes) {
    for (int repeat = 0; repeat < session.choices().repeats; ++repeat) {
      const std::string name = fmt::format("verification/{}-{:02}", scene.name, repeat);
      if (session.has(name + ".json")) {
        if (repeat > 0) remove_capture(session.path(name));
        progress.done(Weights::repeat, true);
        continue;
      }
      if (!evaluation) evaluation.emplace(session, scanner);
      progress.start(fmt::format("verifying, {} {} of {}", scene.name, repeat + 1, session.choices().repeats));
      behind.run(
          [&evaluation, &scene, repeat, capture = instrument.capture(name, fmt::format("{} {}", scene.name, repeat))] {
            (*evaluation)(capture, scene, repeat);
          });
      progress.done(Weights::repeat);
    }
    behind.finish();
    progress.finish_step(fmt::format("{} measured {}", scene.name, times(session.choices().repeats)));
  }
}

}  // namespace fringecal::cli

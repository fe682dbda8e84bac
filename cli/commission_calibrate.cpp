// Step 3 of a commissioning: board poses, then camera and projector; and the paper's closed form fitted to them.
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "calib/fit_chen2008.h"
#include "calib/flat_witness.h"
#include "cli/behind.h"
#include "cli/commission_steps.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

namespace fringecal::cli {
namespace {

/// Where the corners were in the picture, for whoever watches while the poses are taken.
Value corner_places(const model::BoardObservation& observation, int width_px, int height_px) {
  Value x = Value::array(), y = Value::array();
  for (const auto& corner : observation.corners) {
    x.append(corner.pixel.x());
    y.append(corner.pixel.y());
  }
  return Value::object().set("width_px", width_px).set("height_px", height_px).set("x_px", x).set("y_px", y);
}

/// With the poses so far, for whoever watches; where they do not suffice the file stays as it was.
constexpr int kSoFarFrom = 5, kSoFarEvery = 5;
constexpr const char* kSoFar = "calibration/so-far.json";

/// The captures of the linearisation once more, each as a plane. What verifies the flatness later is captured then, and
/// the flat put there anew.
std::vector<model::BoardObservation> flat_views(const CommissionSession& session, CommissionScanner& instrument,
                                                const model::PhaseLinearisation& linearisation) {
  std::vector<model::BoardObservation> out;
  for (int i = 0; i < kFlatStacks; ++i) {
    const std::string name = flat_stack_name(i);
    auto view = calib::observe_flat(instrument.capture(name, "alignment"), name, &linearisation);
    if (!view) session.refuse_capture(name, view.error().sentence);
    out.push_back(std::move(*view));
  }
  return out;
}

}  // namespace

void calibrate_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress) {
  if (session.has("scanner.json") && session.has("calibration/poses.json")) {
    progress.done(Weights::pose * kBoardPoses + Weights::solve, true);
    return;
  }
  const Stopwatch watch;
  const InstrumentSheet& sheet = instrument.sheet();
  const model::Board& board = sheet.board;
  calib::CalibrationOptions options;
  options.pixel_mm = sheet.pixel_mm;
  options.working_distance_mm = sheet.working_distance_mm;
  const model::PhaseLinearisation linearisation = load_linearisation(session);
  std::vector<model::BoardObservation> observations;
  if (sheet.flatness_mm) {
    progress.start("calibrating, the flat board as a witness");
    options.u_flatness_mm = calib::u_flatness_mm(*sheet.flatness_mm);
    options.flats = flat_views(session, instrument, linearisation);
  }
  int width_px = 0, height_px = 0;
  Value poses = Value::array();
  Provenance provenance = provenance_now();
  for (const auto& flat : options.flats) {
    provenance.inputs.emplace_back(flat.name, sha256_of_file(session.path(flat.name) / "capture.json"));
  }
  Behind behind;
  for (int i = 0; i < kBoardPoses; ++i) {
    const std::string name = fmt::format("calibration/pose-{:02}", i);
    progress.start(fmt::format("calibrating, board pose {} of {}", i + 1, kBoardPoses));
    Capture capture = instrument.capture(name, fmt::format("calibration {}", i));
    for (const auto& frame : capture.info.frames) provenance.inputs.emplace_back(name + "/" + frame.file, frame.sha256);
    width_px = capture.info.width_px;
    height_px = capture.info.height_px;
    behind.run([&, name, capture = std::move(capture)] {
      auto observation = calib::observe_board(capture, board, name, &linearisation);
      Value pose = Value::object().set("name", name).set("used", observation.has_value());
      if (observation) {
        session.store(name + "-corners.json",
                      corner_places(*observation, capture.info.width_px, capture.info.height_px));
        observations.push_back(std::move(*observation));
        const auto count = static_cast<int>(observations.size());
        if (count >= kSoFarFrom && count < kBoardPoses && count % kSoFarEvery == 0) {
          const auto so_far =
              calib::calibrate(observations, board, capture.info.width_px, capture.info.height_px, sheet.plan, options);
          if (so_far) model::write_scanner(session.path(kSoFar), *so_far);
        }
      } else {
        pose.set("reason", observation.error().sentence);
        // Whoever holds the board shall know at once.
        fmt::print(stderr, "{}: left out: {}\n", name, observation.error().sentence);
      }
      poses.append(pose);
    });
    progress.done(Weights::pose);
  }
  behind.finish();
  instrument.check_stop();
  progress.start("calibrating, solving for camera and projector");
  const auto calibrated = calib::calibrate(observations, board, width_px, height_px, sheet.plan, options);
  const std::string folder = session.path("calibration").string();
  if (!calibrated) throw InputError(fmt::format("{}: {}", folder, calibrated.error().sentence));
  auto with_paper = calib::with_paper_models(*calibrated);
  if (!with_paper) throw InputError(fmt::format("{}: {}", folder, with_paper.error().sentence));
  model::Scanner& scanner = *with_paper;
  scanner.name = sheet.name;
  scanner.linearisation = linearisation;
  scanner.provenance = provenance;
  model::write_scanner(session.path("scanner.json"), scanner);
  session.store("calibration/poses.json", Value::object().set("poses", poses).set("duration_s", watch.seconds()));
  std::filesystem::remove(session.path(kSoFar));
  progress.done(Weights::solve);
  progress.finish_step(
      fmt::format("calibrated from {} poses{}: camera rms {:.3f} px, projector rms {:.2g} {}, board "
                  "reproduced to {:.4f} mm rms",
                  scanner.residuals.poses,
                  scanner.flats.empty() ? "" : fmt::format(" and {} views of the flat", scanner.flats.size()),
                  scanner.residuals.camera_rms_px, scanner.residuals.projector_rms, scanner.residuals.projector_unit,
                  scanner.residuals.grid_rms_mm));
}

}  // namespace fringecal::cli

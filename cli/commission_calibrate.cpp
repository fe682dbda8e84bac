// Step 2 of a commissioning: board poses, then camera and projector; and the ideal-lens calibration for comparison.
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "cli/commission_steps.h"
#include "core/error.h"

#include <fmt/format.h>

#include <chrono>

namespace fringecal::cli {

void calibrate_step(const CommissionSession& session, const virt::VirtualScanner& instrument,
                    const virt::InstrumentState& state, Progress& progress) {
  if (session.has("scanner.json") && session.has("scanner_ideal.json") && session.has("calibration/poses.json")) {
    progress.done(Weights::pose * kBoardPoses + Weights::solve, true);
    return;
  }
  const auto begin = std::chrono::steady_clock::now();
  const model::Board board = instrument.certified_board("chessboard");
  std::vector<model::BoardObservation> observations;
  int width_px = 0, height_px = 0;
  Value poses = Value::array();
  Provenance provenance = provenance_now();
  for (int i = 0; i < kBoardPoses; ++i) {
    const std::string name = fmt::format("calibration/pose-{:02}", i);
    progress.start(fmt::format("calibrating, board pose {} of {}", i + 1, kBoardPoses));
    Capture capture;
    if (session.has(name)) {
      capture = read_capture(session.path(name));
    } else {
      capture = instrument.capture(instrument.standard_scene(fmt::format("calibration {}", i)), state,
                                   session.stack_seed(name));
      write_capture(session.path(name), capture);
    }
    for (const auto& frame : capture.info.frames) provenance.inputs.emplace_back(name + "/" + frame.file, frame.sha256);
    width_px = capture.info.width_px;
    height_px = capture.info.height_px;
    auto observation = calib::observe_board(capture, board, name);
    Value pose = Value::object().set("name", name).set("used", observation.has_value());
    if (observation) {
      observations.push_back(std::move(*observation));
    } else {
      pose.set("reason", observation.error().sentence);
    }
    poses.append(pose);
    progress.done(Weights::pose);
  }
  progress.start("calibrating, solving for camera and projector");
  const auto solve = [&](const calib::CalibrationOptions& options, const std::string& file) {
    auto scanner = calib::calibrate(observations, board, width_px, height_px, instrument.plan(), options);
    if (!scanner)
      throw InputError(fmt::format("{}: {}", session.path("calibration").string(), scanner.error().sentence));
    scanner->name = fmt::format("virtual {} seed {}", session.choices().preset, session.choices().seed);
    scanner->provenance = provenance;
    model::write_scanner(session.path(file), *scanner);
    return *scanner;
  };
  calib::CalibrationOptions options;
  options.pixel_mm = instrument.pixel_mm();
  options.working_distance_mm = instrument.design_working_distance_mm();
  const auto scanner = solve(options, "scanner.json");
  options.camera_terms = calib::DistortionTerms::none;
  options.projector_terms = calib::DistortionTerms::none;
  solve(options, "scanner_ideal.json");
  const std::chrono::duration<double> duration = std::chrono::steady_clock::now() - begin;
  session.store("calibration/poses.json", Value::object().set("poses", poses).set("duration_s", duration.count()));
  progress.done(Weights::solve);
  progress.finish_step(
      fmt::format("calibrated from {} poses: camera rms {:.3f} px, projector rms {:.2g} {}, board "
                  "reproduced to {:.4f} mm rms",
                  scanner.residuals.poses, scanner.residuals.camera_rms_px, scanner.residuals.projector_rms,
                  scanner.residuals.projector_unit, scanner.residuals.grid_rms_mm));
}

}  // namespace fringecal::cli

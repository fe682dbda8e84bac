#include "calib/calibrate.h"
#include "calib/board_detection.h"
#include "calib/fit_chen2008.h"
#include "calib/flat_witness.h"
#include "calib/halves.h"
#include "calib/linearise.h"
#include "calib/stepped_board.h"
#include "cli/calibrate_corners.h"
#include "cli/commands.h"
#include "cli/records.h"
#include "cli/uncertainty.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/instrument_record.h"
#include "metrology/uncertainty_map.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cmath>
#include <filesystem>
#include <map>
#include <memory>

namespace fringecal::cli {
namespace {

using calib::DistortionTerms;

struct Options {
  std::vector<std::filesystem::path> captures, flat, stepped_board;
  std::vector<double> stepped_z_mm;
  double u_step_mm = 0.002, u_square_mrad = 0.2;
  std::string board, output, history, report;
  CornerOptions corners;  // its fields that calibrate has too are filled in from here
  DistortionTerms camera_terms = DistortionTerms::automatic;
  DistortionTerms projector_terms = DistortionTerms::radial;
  std::optional<double> pixel_mm, working_distance_mm, flatness_mm;
  int min_poses = 3;
  calib::CalibrationMethod method = calib::CalibrationMethod::joint;
  calib::CameraStart start = calib::CameraStart::zhang;
  bool flat_board = false, json = false;
};

/// The corners in use, as the camera's solve takes them.
std::vector<calib::PlanarView> views_of(const model::Scanner& s) {
  std::vector<calib::PlanarView> out;
  for (const auto& o : s.observations) {
    calib::PlanarView view;
    for (const auto& c : o.corners) {
      if (!c.used) continue;
      view.board_mm.push_back(s.board->corner_mm(c.column, c.row).head<2>());
      view.pixels.push_back(c.pixel);
    }
    out.push_back(std::move(view));
  }
  return out;
}

/// What the captures leave open, in sentences.
std::vector<std::string> open_words(const model::Scanner& s) {
  const auto map = metrology::uncertainty_map(s, {.section_steps = 0});
  return map ? metrology::open_words(*map) : std::vector<std::string>{map.error().sentence};
}

/// Value of a parameter by its name in the covariance; empty for the increments of a rotation.
std::optional<double> value_of(const model::Scanner& s, const std::string& name) {
  const auto& c = s.camera;
  const auto& t = s.proj_from_cam.translation_mm;
  std::map<std::string, double> values = {{"camera.fx_px", c.fx_px},
                                          {"camera.fy_px", c.fy_px},
                                          {"camera.cx_px", c.cx_px},
                                          {"camera.cy_px", c.cy_px},
                                          {"proj_from_cam.translation_x_mm", t.x()},
                                          {"proj_from_cam.translation_y_mm", t.y()},
                                          {"proj_from_cam.translation_z_mm", t.z()}};
  int k = 0;
  for (const char* term : {"k1", "k2", "p1", "p2", "k3"}) {
    values[std::string("camera.") + term] = c.distortion[static_cast<std::size_t>(k)];
    values[std::string("projector.") + term] = s.projector.distortion[static_cast<std::size_t>(k++)];
  }
  for (const auto& [axis, prefix] : {std::pair(s.projector.x, "projector.x."), {s.projector.y, "projector.y."}}) {
    if (!axis) continue;
    values[std::string(prefix) + "f"] = axis->f;
    values[std::string(prefix) + "u0"] = axis->u0;
  }
  const auto found = values.find(name);
  return found == values.end() ? std::nullopt : std::optional(found->second);
}

/// The stepped board's readings, where one is given.
std::optional<calib::SteppedBoard> stepped_readings(const Options& options, const model::Board& board,
                                                    const model::PhaseLinearisation* table) {
  if (options.stepped_board.empty()) return std::nullopt;
  auto stepped = calib::observe_stepped_board(options.stepped_board, options.stepped_z_mm, board, table);
  if (!stepped) throw InputError(stepped.error().sentence);
  return std::move(*stepped);
}

calib::SteppedComparison compared(calib::SteppedBoard stepped, const Options& options, const model::Scanner& s) {
  stepped.u = calib::uncertainty_from(s);
  stepped.u.step_mm = options.u_step_mm;
  stepped.u.square_rad = 1e-3 * options.u_square_mrad;
  auto out = calib::compare_stepped_board(stepped, s);
  if (!out) throw InputError(out.error().sentence);
  return std::move(*out);
}

Value to_value(const calib::SteppedComparison& c) {
  Value out = Value::object().set("rms_xyz_mm", Value::numbers(c.direct.rms_xyz_mm));
  for (std::size_t i = 0; i < calib::kSteppedNames.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    out.set(calib::kSteppedNames[i], Value::object()
                                         .set("direct", c.direct.values[k])
                                         .set("u_direct", std::sqrt(c.direct.covariance(k, k)))
                                         .set("computed", c.computed.values[k])
                                         .set("u_computed", std::sqrt(c.computed.covariance(k, k)))
                                         .set("u_difference", c.u_difference[k]));
  }
  return out;
}

void print_stepped(const calib::SteppedComparison& c) {
  fmt::print(
      "  the paper's parameters from the stepped board (residuals {:.4f}, {:.4f}, {:.4f} mm rms in X, Y, Z), and "
      "from the full model on the same readings:\n",
      c.direct.rms_xyz_mm.x(), c.direct.rms_xyz_mm.y(), c.direct.rms_xyz_mm.z());
  for (std::size_t i = 0; i < calib::kSteppedNames.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    fmt::print("    {:<12}{:>14.7g} u = {:<9.2g}{:>14.7g} u = {:<9.2g} difference {:+.2g} = {:+.1f} u\n",
               calib::kSteppedNames[i], c.direct.values[k], std::sqrt(c.direct.covariance(k, k)), c.computed.values[k],
               std::sqrt(c.computed.covariance(k, k)), c.difference[k], c.difference[k] / c.u_difference[k]);
  }
}

void print_json(const Options& options, const model::Scanner& s, const std::vector<calib::DroppedPose>& dropped,
                const std::optional<calib::SteppedComparison>& stepped) {
  Value parameters = Value::object(), lost = Value::array(), open = Value::array();
  for (const auto& words : open_words(s)) open.append(words);
  for (const std::string& name : s.uncertainty.names) {
    Value one = Value::object();
    if (const auto value = value_of(s, name)) one.set("value", *value);
    parameters.set(name, one.set("u", *s.uncertainty.u(name)));
  }
  for (const auto& d : dropped) lost.append(Value::object().set("name", d.name).set("reason", d.reason));
  const auto& r = s.residuals;
  Value out = Value::object()
                  .set("scanner", options.output)
                  .set("dropped", lost)
                  .set("parameters", parameters)
                  .set("base_mm", s.base_mm())
                  .set("working_distance_mm", s.working_distance_mm)
                  .set("residuals", model::to_value(r))
                  .set("open", open)
                  .set("method", s.method);
  if (stepped) out.set("stepped_board", to_value(*stepped));
  if (s.paper_model) out.set("paper_rms_xyz_mm", Value::numbers(s.paper_model->rms_xyz_mm));
  if (s.paper_ideal_model) out.set("paper_ideal_rms_xyz_mm", Value::numbers(s.paper_ideal_model->rms_xyz_mm));
  fmt::print("{}", to_json(out));
}

std::string rms_words(const model::FittedChen2008& fitted) {
  const auto& rms = fitted.rms_xyz_mm;
  return fmt::format("{:.4f}, {:.4f}, {:.4f} mm rms in X, Y, Z", rms.x(), rms.y(), rms.z());
}

/// without_paper: why the paper's closed form was not fitted, where it was not.
void print_text(const Options& options, const model::Scanner& s, const std::vector<calib::DroppedPose>& dropped,
                const std::string& without_paper) {
  const auto& r = s.residuals;
  fmt::print("{}: {} poses, {} corners used, {} left out\n", options.output, r.poses, r.corners_used,
             r.corners_rejected);
  for (const auto& d : dropped) fmt::print("  left out: {}: {}\n", d.name, d.reason);
  for (const std::string& name : s.uncertainty.names) {
    if (const auto value = value_of(s, name)) {
      fmt::print("  {:<32}{:>14.6g}   u = {:.2g}\n", name, *value, *s.uncertainty.u(name));
    } else {
      fmt::print("  {:<32}{:>14}   u = {:.2g}\n", name, "", *s.uncertainty.u(name));
    }
  }
  fmt::print("  base line {:.3f} mm, working distance {:.2f} mm\n", s.base_mm(), s.working_distance_mm);
  fmt::print("  residuals: camera {:.4f} px, projector {:.4g} {} rms; triangulated grid {:.4f} mm rms\n",
             r.camera_rms_px, r.projector_rms, r.projector_unit, r.grid_rms_mm);
  if (s.paper_model && s.paper_ideal_model) {
    fmt::print("  the paper's closed form, fitted for Z = {:.0f} to {:.0f} mm: eqs. 1-20 {}, eqs. 1-17 {}\n",
               s.paper_model->z_min_mm, s.paper_model->z_max_mm, rms_words(*s.paper_model),
               rms_words(*s.paper_ideal_model));
  } else {
    fmt::print("  {}\n", without_paper);
  }
  for (const auto& p : s.priors) fmt::print("  prior: {} = {} +- {:.3g}: {}\n", p.parameter, p.value, p.u, p.reason);
  for (const auto& words : open_words(s)) fmt::print("  {}\n", words);
  fmt::print("  {}\n", s.method);
}

/// The phase linearisation from captures of a flat board; absent where none are given.
std::optional<model::PhaseLinearisation> linearisation_from(const std::vector<std::filesystem::path>& flat) {
  std::optional<calib::LinearisationFit> fit;
  for (const auto& folder : flat) {
    const Capture capture = read_capture(folder);
    if (!fit) fit.emplace(capture.info.plan.x ? CodeAxis::x : CodeAxis::y);
    const auto added = fit->add(capture, folder.string(), sha256_of_file(folder / "capture.json"));
    if (!added) throw InputError(added.error().sentence);
  }
  return fit ? std::optional(fit->table()) : std::nullopt;
}

/// The same captures as views of a plane.
std::vector<model::BoardObservation> flat_views(const std::vector<std::filesystem::path>& flat,
                                                const model::PhaseLinearisation* table) {
  std::vector<model::BoardObservation> out;
  for (const auto& folder : flat) {
    auto view = calib::observe_flat(read_capture(folder), folder.filename().string(), table);
    if (!view) throw InputError(fmt::format("{}: {}", folder.string(), view.error().sentence));
    out.push_back(std::move(*view));
  }
  return out;
}

void run_on_corners(const Options& options) {
  CornerOptions o = options.corners;
  o.board = options.board;
  o.output = options.output;
  o.terms = options.camera_terms;
  o.tsai = options.method == calib::CalibrationMethod::tsai;
  o.json = options.json;
  calibrate_corners(o);
}

void run(const Options& options) {
  if (!options.corners.corners.empty()) return run_on_corners(options);
  if (options.captures.empty() || options.board.empty() || options.output.empty()) {
    throw InputError("calibrate needs captures, --board and -o; or --corners");
  }
  const model::Board board = model::read_board(options.board);
  const auto linearisation = linearisation_from(options.flat);
  auto readings = stepped_readings(options, board, linearisation ? &*linearisation : nullptr);
  calib::BoardViews views = calib::observe_captures(options.captures, board, linearisation ? &*linearisation : nullptr);
  const int needed = std::max(3, options.min_poses);
  if (static_cast<int>(views.observations.size()) < needed) {
    std::string sentence = fmt::format("the board is found in {} of {} captures; at least {} are needed",
                                       views.observations.size(), options.captures.size(), needed);
    for (const auto& d : views.dropped) sentence += fmt::format("; {}: {}", d.name, d.reason);
    throw InputError(sentence);
  }
  calib::CalibrationOptions how;
  how.camera_terms = options.camera_terms;
  how.projector_terms = options.projector_terms;
  how.method = options.method;
  how.start = options.start;
  how.min_poses = needed;
  if (options.flat_board) how.u_bow_relative = 0;
  if (options.flatness_mm) {
    how.u_flatness_mm = calib::u_flatness_mm(*options.flatness_mm);
    how.flats = flat_views(options.flat, linearisation ? &*linearisation : nullptr);
  }
  how.pixel_mm = options.pixel_mm;
  how.working_distance_mm = options.working_distance_mm;
  auto scanner = calib::calibrate(views.observations, board, views.width_px, views.height_px, views.plan, how);
  if (!scanner) throw InputError(fmt::format("{}: {}", options.board, scanner.error().sentence));
  scanner->linearisation = linearisation;
  scanner->name = std::filesystem::path(options.output).stem().string();
  scanner->provenance.inputs = views.inputs;
  scanner->provenance.inputs.emplace_back("board", sha256_of_file(options.board));
  const auto with_paper = calib::with_paper_models(*scanner);
  if (with_paper) scanner = with_paper;
  std::optional<calib::SteppedComparison> stepped;
  if (readings) stepped = compared(std::move(*readings), options, *scanner);
  model::write_scanner(options.output, *scanner);
  if (!options.history.empty()) {
    auto record = metrology::record_of(*scanner, utc_now());
    std::vector<CaptureInfo> infos;
    for (const auto& folder : options.captures) infos.push_back(read_capture_info(folder));
    if (auto temperature = metrology::temperature_of(infos)) record.quantities.push_back(*temperature);
    record.provenance.inputs.emplace_back("scanner", sha256_of_file(options.output));
    metrology::History history = history_to_append(options.history);
    metrology::append_once(history, record);
  }
  if (!options.report.empty()) write_uncertainty_page(*scanner, options.report);
  if (options.json) {
    print_json(options, *scanner, views.dropped, stepped);
  } else {
    print_text(options, *scanner, views.dropped, with_paper ? "" : with_paper.error().sentence);
    if (stepped) print_stepped(*stepped);
    if (options.corners.cross_check) {
      print_cross_check(views_of(*scanner), views.width_px, views.height_px,
                        calib::terms_of(scanner->camera.distortion), *options.corners.cross_check);
    }
  }
}

}  // namespace

void add_calibrate(CLI::App& app) {
  static const std::map<std::string, DistortionTerms> kTerms = {
      {"none", DistortionTerms::none},
      {"radial", DistortionTerms::radial},
      {"radial+tangential", DistortionTerms::radial_tangential},
      {"full", DistortionTerms::full},
      {"auto", DistortionTerms::automatic}};
  static const std::map<std::string, calib::CalibrationMethod> kMethods = {{"joint", calib::CalibrationMethod::joint},
                                                                           {"staged", calib::CalibrationMethod::staged},
                                                                           {"tsai", calib::CalibrationMethod::tsai}};
  static const std::map<std::string, calib::CameraStart> kStarts = {{"zhang", calib::CameraStart::zhang},
                                                                    {"tsai", calib::CameraStart::tsai}};
  static const std::map<std::string, calib::OtherSolver> kSolvers = {{"mrcal", calib::OtherSolver::mrcal},
                                                                     {"opencv", calib::OtherSolver::opencv}};
  auto options = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("calibrate", "Finds camera and projector from captures of a calibration board");
  command->add_option("captures", options->captures, "Capture folders, one per pose of the board");
  command->add_option("--board", options->board, "TOML file of the board: kind, columns, rows, pitch_mm");
  command->add_option("-o,--output", options->output,
                      "Scanner file to write; with --corners a lens file, .cameramodel or .yml");
  command
      ->add_option(
          "--camera-terms", options->camera_terms,
          "Distortion of the camera: none, radial, radial+tangential, full, auto (default: what the data support)")
      ->transform(CLI::CheckedTransformer(kTerms).description(""));
  command
      ->add_option("--projector-terms", options->projector_terms,
                   "Distortion of the projector, the same words (default radial; along one code axis none or radial)")
      ->transform(CLI::CheckedTransformer(kTerms).description(""));
  command
      ->add_option(
          "--method", options->method,
          "joint (default): all at once, robust; staged: camera alone by plain least squares, then the projector, "
          "for comparison with programs that work so; tsai: the camera by Tsai's two stages, then the projector")
      ->transform(CLI::CheckedTransformer(kMethods).description(""));
  command->add_option("--start", options->start, "Start of the camera: zhang (default) or tsai; the result is the same")
      ->transform(CLI::CheckedTransformer(kStarts).description(""));
  auto& corners = options->corners;
  command->add_option(
      "--corners", corners.corners,
      "Instead of captures, a camera alone from corners: .vnl of mrcal, or one file of numbers per view");
  command->add_option("--image-size", corners.image_size, "With --corners: the image's width and height in px")
      ->expected(2)
      ->check(CLI::PositiveNumber);
  command->add_option("--places", corners.places,
                      "With --corners, instead of --board: file of the corners' places on the board, x y x y ..");
  command->add_option("--places-unit-mm", corners.places_unit_mm, "Unit of --places in mm")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_flag("--skew", corners.skew, "With --corners: estimate the skew of the pixels too");
  command->add_flag("--one-focal-length", corners.one_focal_length, "With --corners: fx = fy");
  command
      ->add_option("--cross-check", corners.cross_check,
                   "mrcal or opencv: solve the same corners with that library and print the differences in px and mm")
      ->transform(CLI::CheckedTransformer(kSolvers).description(""));
  auto* stepped = command->add_option(
      "--stepped-board", options->stepped_board,
      "Captures of the board, facing the projector, moved by known steps along its normal: the paper's parameters are "
      "estimated from them directly too, and compared with what the calibration makes of them");
  auto* heights = command->add_option("--stepped-z-mm", options->stepped_z_mm,
                                      "Heights of the stepped board, mm, towards the scanner, one per capture; the one "
                                      "at 0 is the reference plane");
  stepped->needs(heights);
  heights->needs(stepped);
  command->add_option("--u-step-mm", options->u_step_mm, "Standard uncertainty of each height")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--u-square-mrad", options->u_square_mrad,
                   "Standard uncertainty of the steps' direction against the board's normal")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--pixel-mm", options->pixel_mm, "Side of a camera pixel in mm, to print the paper's parameters")
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--working-distance-mm", options->working_distance_mm,
                   "Distance L of the reference plane (default: the boards' mean distance)")
      ->check(CLI::PositiveNumber);
  command->add_option("--history", options->history, "History to append the calibration to (made if it is not there)");
  command->add_option("--min-poses", options->min_poses, "Refuse with fewer poses than this (at least 3)")
      ->check(CLI::Range(3, 1000));
  auto* flat = command->add_option(
      "--flat", options->flat,
      "Captures of a plain flat board on the aligned instrument: the phase linearisation, kept in the "
      "Scanner file and used by measure, is measured on them");
  command
      ->add_option(
          "--flatness-mm", options->flatness_mm,
          "Certified flatness of that board over the field: the same captures then calibrate as well, as planes")
      ->check(CLI::PositiveNumber)
      ->needs(flat);
  command->add_flag("--flat-board", options->flat_board, "Take the board as flat instead of estimating its bow");
  command->add_option("--report", options->report,
                      "HTML page to write: the uncertainty over the volume, what is left open, halves of the poses");
  command->add_flag("--json", options->json, "Print the summary as JSON");
  command->footer(
      "Example: fringecal calibrate captures/board_* --board board.toml --pixel-mm 0.00645 -o scanner.json\n"
      "         fringecal calibrate captures/board_* --flat captures/flat_* --board board.toml -o scanner.json\n"
      "         fringecal calibrate --corners corners.vnl --board board.toml --image-size 1392 1040 -o "
      "camera.cameramodel\n"
      "         fringecal calibrate captures/board_* --board board.toml --pixel-mm 0.00645 -o scanner.json \\\n"
      "           --stepped-board step_m60 step_0 step_p60 --stepped-z-mm -60 0 60\n"
      "A board file: kind = \"chessboard\"  columns = 9  rows = 7  pitch_mm = 30");
  command->callback([options] { run(*options); });
}

}  // namespace fringecal::cli

// The commissioning report: one page for people (report.html) and the same content for programs (report.json), both
// from the plain structs below. Nothing metrological is computed here: every judged number, every verdict and every
// uncertainty is filled in by the caller. The report rounds, sorts nothing, and scales for its plots only.
//
// Units are in the names; frames are those of calib/model/scanner.h; u is a standard uncertainty (k = 1). Printed are
// U = 2 u (k = 2) for a certificate, and u with two significant digits elsewhere [GUM, 7.2.6]. What was not measured is
// an absent optional or an empty list, and its part of the page is left out. Numbers must be finite; NaN is allowed in
// the three pictures (phase_rad, coverage, deviation_mm), where it means "no value here".
//
// report.json: schema "fringecal.report", version 1. Keys are the members' names below, with the unit at the end where
// it has one; Uncertain {value, u} becomes KEY and KEY's "u_" twin ("theta_mrad", "u_theta_mrad"); an absent optional
// is a missing key; enums are words ("met", "not met", "not judged"; "plane", "sphere", "cylinder"). Pictures are not
// in it:
//   {schema, schema_version, title, scanner_name, virtual_instrument, seed?, instrument_note, verdict, verdict_text,
//    provenance {program, version, date, inputs_sha256 {name: hash}}, stages [{name, duration_s}],
//    fringes [caption], phase_map? {caption, width_px, height_px},
//    alignment? {tolerance_fraction, conclusion, iterations [...], before? , after? {row_px, column_px [], ...}},
//    calibration? {method, parameters [{name, value, u?, unit, meaning}], paper_parameters [...],
//      image_width_px, image_height_px, residuals {camera_rms_px, projector_rms, projector_unit, ...}, poses [{name,
//      used, reason}], camera_residuals {pixel_x_px [], pixel_y_px [], residual_x_px [], residual_y_px []},
//      projector_residuals {pixel_x_px [], pixel_y_px [], residual []  (in residuals.projector_unit)}},
//    phase_corrections? [sentence], artefacts [{name, kind, certificate_mm?, u_certificate_mm?, paper {text, error_limit_mm?, form_sd_mm?}, verdict,
//      criterion, models [...], repeats [...], remarks []}], verdicts [{verdict, text}]}
//
// Size: pictures are block-averaged and long scatter plots thinned (the caption says so), so that report.html of a full
// commissioning stays below 4 MB. Both files have the same bytes for the same struct: no clock is read here.
// Errors: EnvironmentError where gnuplot is missing or fails (plot.h) or a file cannot be written; std::logic_error for
// a number that is not finite or columns of different length.
#pragma once

#include "calib/model/scanner.h"
#include "core/image.h"
#include "core/provenance.h"
#include "core/uncertain.h"
#include "core/value.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

enum class Verdict { met, not_met, not_judged };

struct VerdictLine {
  Verdict verdict = Verdict::not_judged;
  std::string text;  // a whole sentence with its number: "All diameter errors are below 0.04 mm."
};

struct Stage {
  std::string name;  // "alignment", "calibration", ...
  double duration_s = 0;
};

/// One captured frame, shown as a thumbnail.
struct FringeFrame {
  std::string caption;  // describe(pattern)
  GrayImage image;
  int saturation_level = 255;  // this grey level is shown white
};

/// The absolute phase of one capture.
struct PhaseMapPicture {
  std::string caption;
  Image<float> phase_rad;  // NaN is invalid too
  Image8 valid;            // 0 where invalid; empty: all valid but NaN
};

/// One turn of the loop (b) to (e) of the paper's section 3.
struct AlignmentIteration {
  int number = 1;
  Uncertain theta_mrad;
  int bit = 0;                           // the Gray bit that delta belongs to; a delta without its bit means nothing
  Uncertain delta_um;                    // on the grating, signed [Chen2008, eq. 21]
  double fraction_of_period = 0;         // delta / p
  double period_px = 0, jump_px = 0;     // the paper's pixel counts
  std::optional<double> turn_mrad = {};  // what the adjuster was asked for; absent: no turn after this capture
  std::string instruction;               // for the person at the adjuster
  std::string verdict;                   // "turn again", "within tolerance"
};

/// The paper's Fig. 5 along one row: valid pixels only, columns ascending, all of one length.
struct ProfileColumns {
  int row_px = 0;
  std::vector<double> column_px, gray_number, phase_rad;
};

struct AlignmentSection {
  std::vector<AlignmentIteration> iterations = {};
  double tolerance_fraction = 0;  // |delta / p| that ends the loop
  std::string conclusion;         // one sentence
  std::optional<ProfileColumns> before = {}, after = {};
  /// delta of the finest bit over the field, um, as found and as left, in cells; NaN: no value. Not in report.json.
  std::optional<Image<float>> delta_before_um = {}, delta_after_um = {};
};

struct Parameter {
  std::string name;  // "f_C", "camera.k1"
  double value = 0;
  std::optional<double> u = {};  // absent: not estimated
  std::string unit;              // "px", "mm^-2" (powers are set properly); empty: dimensionless
  std::string meaning;           // "focal length of the camera"; may be empty
};

struct PoseUse {
  std::string name;
  bool used = true;
  std::string reason;  // why it was dropped
};

struct CameraResidual {
  double pixel_x_px = 0, pixel_y_px = 0;        // the corner in the image
  double residual_x_px = 0, residual_y_px = 0;  // measured - model
};

struct ProjectorResidual {
  double pixel_x_px = 0, pixel_y_px = 0;
  double residual = 0;  // of the coded coordinate, in ResidualStatistics::projector_unit
};

struct CalibrationSection {
  std::string method;                            // Scanner::method
  std::vector<Parameter> parameters = {};        // the full model
  std::vector<Parameter> paper_parameters = {};  // kc1, kc2, kp1, kp2, L, b, alpha, p_R
  model::ResidualStatistics residuals;
  std::vector<PoseUse> poses = {};
  int image_width_px = 0, image_height_px = 0;  // the field of the residual plots
  std::vector<CameraResidual> camera_residuals = {};
  std::vector<ProjectorResidual> projector_residuals = {};
  std::optional<Image<float>> coverage = {};  // corners per cell of the image, any cell size; NaN: none
};

/// The corrections of the periodic phase errors, as they were during the verification.
struct PhaseCorrectionSection {
  std::vector<std::string> sentences = {};       // what was on, and how much it took away
  std::optional<Image<float>> ripple_mrad = {};  // amplitude over the field, node by node; not in report.json
};

enum class ArtefactKind { plane, sphere, cylinder };

/// What the paper reports for this artefact.
struct PaperFigure {
  std::string text;                           // "flat board 800 x 700 mm, 10 times"
  std::optional<double> error_limit_mm = {};  // "< 0.04 mm"
  std::optional<double> form_sd_mm = {};      // its maximum standard deviation
};

/// One artefact measured through one model of the instrument.
struct ModelResult {
  std::string model;  // "full" | "chen2008" | "ideal"; the first in the list is the measurement,
                      // the others its ablation
  std::optional<double> mean_diameter_mm = {};     // of the repeats; absent for a plane
  std::optional<double> error_mm = {};             // mean - certificate; absent without a certificate
  std::optional<double> u_error_mm = {};           // standard uncertainty of error_mm
  std::optional<double> repeatability_sd_mm = {};  // standard deviation of the repeats' diameters
  double max_form_sd_mm = 0;                       // the paper's figure: largest of the repeats
  double mean_form_sd_mm = 0;
};

struct Repeat {
  std::optional<double> diameter_mm = {};  // absent for a plane
  double form_sd_mm = 0;
  std::size_t n_points = 0, n_rejected = 0;
};

struct ArtefactSection {
  std::string name;  // "Sphere 30 mm"
  ArtefactKind kind = ArtefactKind::plane;
  std::optional<Uncertain> certificate_mm = {};  // diameter and its standard uncertainty
  PaperFigure paper;
  Verdict verdict = Verdict::not_judged;
  std::string criterion;                 // what the verdict was held against
  std::vector<ModelResult> models = {};  // may be empty: not measured
  std::vector<Repeat> repeats = {};      // of models.front()
  Image<float> deviation_mm;             // of one repeat, along the surface normal; NaN where no point; empty: none
  std::string deviation_caption;         // which repeat, which sign
  std::vector<std::string> remarks = {};
};

struct CommissioningReport {
  std::string title = "Commissioning report";
  std::string scanner_name;
  bool virtual_instrument = false;  // prints "virtual instrument, not a real one" where nobody can miss it
  std::optional<std::uint64_t> seed = {};
  std::string instrument_note;  // preset and what it stands for
  Provenance provenance;
  std::vector<Stage> stages = {};
  Verdict verdict = Verdict::not_judged;  // of the whole commissioning
  std::string verdict_text;               // one sentence
  std::vector<VerdictLine> verdicts = {};
  std::vector<FringeFrame> fringes = {};
  std::optional<PhaseMapPicture> phase_map = {};
  std::optional<AlignmentSection> alignment = {};
  std::optional<CalibrationSection> calibration = {};
  std::optional<PhaseCorrectionSection> phase_corrections = {};
  std::vector<ArtefactSection> artefacts = {};
};

/// The page. Self-contained: style, pictures and plots are inside; nothing is loaded from anywhere.
std::string commissioning_html(const CommissioningReport& report);

/// The document of report.json.
Value to_value(const CommissioningReport& report);

/// report.html and report.json in a folder, each written atomically.
void write_commissioning_report(const std::filesystem::path& folder, const CommissioningReport& report);

/// Throws EnvironmentError where a program that the report needs is missing: for the start of a run that takes minutes.
void check_report_tools();

/// "met" | "not met" | "not judged".
std::string word_for(Verdict verdict);
/// "plane" | "sphere" | "cylinder".
std::string word_for(ArtefactKind kind);

}  // namespace fringecal::reports

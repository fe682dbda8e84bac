// Step 4 of a commissioning: the session's files put together for the report.
#include "calib/align_record.h"
#include "calib/model/chen2008.h"
#include "cli/commission_steps.h"
#include "core/file.h"
#include "core/image_file.h"
#include "metrology/reconstruct.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

namespace fringecal::cli {
namespace {

double number(const Value& tree, const char* key) {
  const Value* v = tree.find(key);
  if (v && v->if_real()) return *v->if_real();
  if (v && v->if_integer()) return static_cast<double>(*v->if_integer());
  return 0.0;
}

std::string text(const Value& tree, const char* key) {
  const Value* v = tree.find(key);
  return v && v->if_text() ? *v->if_text() : "";
}

const Value::Array& list(const Value& tree, const char* key) {
  static const Value::Array kEmpty;
  const Value* v = tree.find(key);
  return v && v->if_array() ? *v->if_array() : kEmpty;
}

reports::ProfileColumns profile_of(const Capture& capture) {
  const auto profile = calib::alignment_profile(capture, CodeAxis::x, capture.info.height_px / 2);
  return {profile.row, profile.column, profile.gray_number, profile.phase_rad};
}

reports::AlignmentSection alignment_section(const CommissionSession& session, double period_mm, double& duration_s) {
  reports::AlignmentSection section;
  section.tolerance_fraction = calib::AlignmentLoopOptions{}.tolerance_of_period;
  duration_s += number(session.load("alignment/duration.json"), "duration_s");
  for (const Value& v : calib::read_record(session.path("alignment/record.json")).iterations) {
    const Value& measured = *v.find("measured");
    const Value& step = *v.find("step");
    reports::AlignmentIteration iteration;
    iteration.number = static_cast<int>(section.iterations.size()) + 1;
    iteration.theta_mrad = {number(measured, "theta_mrad"), number(measured, "u_theta_mrad")};
    iteration.bit = static_cast<int>(number(step, "bit"));
    iteration.delta_um = {number(step, "delta_um"), number(step, "u_delta_um")};
    iteration.fraction_of_period = iteration.delta_um.value * 1e-3 / period_mm;
    for (const Value& bit : list(measured, "bits")) {
      if (static_cast<int>(number(bit, "bit")) != iteration.bit) continue;
      iteration.period_px = number(bit, "period_px");
      iteration.jump_px = number(bit, "jump_px");
    }
    if (text(step, "decision") == "turn") iteration.turn_mrad = number(step, "turn_mrad");
    iteration.instruction = text(step, "sentence");
    iteration.verdict = text(step, "decision");
    section.iterations.push_back(iteration);
  }
  const std::size_t last = section.iterations.size() - 1;
  section.before = profile_of(read_capture(session.path("alignment/iteration-0")));
  section.after = profile_of(read_capture(session.path(fmt::format("alignment/iteration-{}", last))));
  const auto map_of = [&](int i) -> std::optional<Image<float>> {
    const std::string name = fmt::format("alignment/iteration-{}-delta.tiff", i);
    return session.has(name) ? std::optional(read_float_tiff(session.path(name))) : std::nullopt;
  };
  section.delta_before_um = map_of(0);
  section.delta_after_um = map_of(last);
  const auto &begin = section.iterations.front(), &end = section.iterations.back();
  section.conclusion = fmt::format(
      "{} after {} adjustments; as found theta = {:+.4f} mrad, delta of bit {} = {:+.1f} um; as left theta = {:+.4f} "
      "mrad (u = {:.4f} mrad), delta of bit {} = {:+.2f} um.",
      end.verdict == "aligned" ? "Aligned" : "Ended '" + end.verdict + "'", last, begin.theta_mrad.value, begin.bit,
      begin.delta_um.value, end.theta_mrad.value, end.theta_mrad.u, end.bit, end.delta_um.value);
  return section;
}

std::string unit_of(const std::string& name, const model::Scanner& scanner) {
  if (name.ends_with("_px")) return "px";
  if (name.ends_with("_rad")) return "rad";
  if (name.ends_with("_mm")) return "mm";
  if (name.ends_with(".f") || name.ends_with(".u0"))
    return scanner.projector.axis(scanner.projector.main_axis())->code.unit;
  return "";
}

/// Value: fitted with eqs. 18 to 20; beside it the geometric one and, fitted, that of eqs. 1 to 17 alone.
std::vector<reports::Parameter> paper_parameters(const model::Scanner& scanner) {
  const auto geometric = model::chen2008_from(scanner);
  const auto& fitted = scanner.paper_model;
  const auto& ideal = scanner.paper_ideal_model;
  const double deg = 180.0 / std::numbers::pi;
  using M = model::Chen2008Model;
  struct Row {
    const char* name;
    double M::*place;
    double factor;
    const char* unit;
    const char* meaning;
  };
  static const Row kRows[] = {
      {"L", &M::L_mm, 1, "mm", "working distance"},
      {"b", &M::b_mm, 1, "mm", "base, camera to projector"},
      {"alpha", &M::alpha_rad, deg, "deg", "angle between the optical axes"},
      {"p_R", &M::p_R_mm, 1, "mm", "fringe period on the reference plane"},
      {"phi_O", &M::phi_O_rad, 1, "rad", "phase on the projector's axis"},
      {"f_C", &M::f_C_mm, 1, "mm", "focal length of the camera"},
      {"i_C", &M::i_C_px, 1, "px", "principal point, row"},
      {"j_C", &M::j_C_px, 1, "px", "principal point, column"},
      {"kc1", &M::kc1_per_mm2, 1, "mm^-2", "camera, 2nd order, eq. 18"},
      {"kc2", &M::kc2_per_mm4, 1, "mm^-4", "camera, 4th order, eq. 18"},
      {"kp1", &M::kp1_per_mm2, 1, "mm^-2", "projector, 2nd order, eq. 19"},
      {"kp2", &M::kp2_per_mm4, 1, "mm^-4", "projector, 4th order, eq. 19"},
  };
  std::vector<reports::Parameter> out;
  for (const Row& row : kRows) {
    const double value = geometric.*row.place * row.factor;
    std::string meaning = row.meaning;
    if (fitted) meaning += fmt::format("; geometric {:.6g}", value);
    if (ideal) meaning += fmt::format("; eqs. 1-17 fitted {:.6g}", ideal->model.*row.place * row.factor);
    out.push_back({row.name, fitted ? fitted->model.*row.place * row.factor : value, {}, row.unit, meaning});
  }
  const auto add_rms = [&](const std::optional<model::FittedChen2008>& set, const std::string& equations) {
    if (!set) return;
    const char* kAxes[] = {"X", "Y", "Z"};
    for (int k = 0; k < 3; ++k) {
      out.push_back(
          {fmt::format("rms {}, eqs. {}", kAxes[k], equations),
           set->rms_xyz_mm[k],
           {},
           "mm",
           fmt::format("fitted closed form against full rays, Z = {:.0f} to {:.0f} mm", set->z_min_mm, set->z_max_mm)});
    }
  };
  add_rms(fitted, "1-20");
  add_rms(ideal, "1-17");
  return out;
}

reports::CalibrationSection calibration_section(const CommissionSession& session, const model::Scanner& scanner,
                                                double& duration_s) {
  reports::CalibrationSection section;
  section.method = scanner.method;
  section.residuals = scanner.residuals;
  section.image_width_px = scanner.camera.width_px;
  section.image_height_px = scanner.camera.height_px;
  for (const auto& name : scanner.uncertainty.names) {
    section.parameters.push_back({.name = name,
                                  .value = scanner.value_of(name),
                                  .u = scanner.uncertainty.u(name),
                                  .unit = unit_of(name, scanner)});
  }
  section.paper_parameters = paper_parameters(scanner);
  const Value poses = session.load("calibration/poses.json");
  duration_s += number(poses, "duration_s");
  for (const Value& pose : list(poses, "poses")) {
    const Value* used = pose.find("used");
    section.poses.push_back({text(pose, "name"), used && used->if_bool() && *used->if_bool(), text(pose, "reason")});
  }
  const CodeAxis axis = scanner.projector.main_axis();
  for (std::size_t i = 0; i < scanner.observations.size(); ++i) {
    for (const auto& corner : scanner.observations[i].corners) {
      if (!corner.used) continue;
      const Eigen::Vector3d in_cam = scanner.cam_from_board[i] * scanner.corner_mm(corner.column, corner.row);
      if (const auto pixel = scanner.camera.project(in_cam)) {
        section.camera_residuals.push_back(
            {corner.pixel.x(), corner.pixel.y(), corner.pixel.x() - pixel->x(), corner.pixel.y() - pixel->y()});
      }
      const auto& measured = axis == CodeAxis::x ? corner.x : corner.y;
      const auto u = scanner.projector.project(axis, scanner.proj_from_cam * in_cam);
      if (measured && u) {
        section.projector_residuals.push_back({corner.pixel.x(), corner.pixel.y(), measured->value - *u});
      }
    }
  }
  return section;
}

struct PaperRow {
  const char* artefact;  // of the virtual scanner
  metrology::ArtefactKind kind;
  const char* title;
  const char* text;
  double error_limit_mm, form_sd_mm;
};
// [Chen2008, section 4]
constexpr PaperRow kPaper[] = {
    {"plane", metrology::ArtefactKind::plane, "Plane", "flat board 800 x 700 mm, 10 times", 0, 0.028},
    {"sphere30", metrology::ArtefactKind::sphere, "Sphere 30 mm", "spheres 30, 38, 50 mm, 10 times each", 0.04, 0.034},
    {"sphere38", metrology::ArtefactKind::sphere, "Sphere 38 mm", "spheres 30, 38, 50 mm, 10 times each", 0.04, 0.034},
    {"sphere50", metrology::ArtefactKind::sphere, "Sphere 50 mm", "spheres 30, 38, 50 mm, 10 times each", 0.04, 0.034},
    {"cylinder", metrology::ArtefactKind::cylinder, "Cylinder 119.85 mm", "cylinder 119.85 mm, 10 times", 0.04, 0.035},
};

reports::ArtefactKind kind_from(metrology::ArtefactKind kind) { return static_cast<reports::ArtefactKind>(kind); }

reports::ArtefactSection artefact_section(const CommissionSession& session, const InstrumentSheet& sheet,
                                          const std::string& scene, const metrology::NominalArtefact& nominal) {
  reports::ArtefactSection section;
  section.kind = kind_from(nominal.kind);
  // Artefacts of one's own: the paper's figure for the kind.
  const auto same_name = [&](const PaperRow& row) { return nominal.name == row.artefact; };
  const auto same_kind = [&](const PaperRow& row) { return nominal.kind == row.kind; };
  const auto named = std::find_if(std::begin(kPaper), std::end(kPaper), same_name);
  const auto& row = named != std::end(kPaper) ? *named : *std::find_if(std::begin(kPaper), std::end(kPaper), same_kind);
  section.name = named != std::end(kPaper) ? row.title : nominal.name;
  section.paper.text = row.text;
  if (row.error_limit_mm > 0) section.paper.error_limit_mm = row.error_limit_mm;
  section.paper.form_sd_mm = row.form_sd_mm;
  double u_calibration = 0, n_grazing = 0, n_gross = 0;
  if (nominal.kind != metrology::ArtefactKind::plane) section.certificate_mm = sheet.diameter_mm.at(nominal.name);
  for (const char* model : {"full", "chen2008", "ideal"}) {
    std::vector<metrology::RepeatValue> repeats;
    for (int r = 0; r < session.choices().repeats; ++r) {
      const Value v = session.load(fmt::format("verification/{}-{:02}.json", scene, r));
      if (r == 0) u_calibration = number(*v.find("u_calibration_mm"), nominal.name.c_str());
      for (const Value& m : list(*v.find("models"), model)) {
        if (text(m, "name") != nominal.name) continue;
        metrology::RepeatValue value{.form_sd_mm = number(m, "form_standard_deviation_mm")};
        if (m.find("diameter_mm")) value.diameter_mm = number(m, "diameter_mm");
        repeats.push_back(value);
        if (std::string(model) != "full") continue;
        section.repeats.push_back({value.diameter_mm, value.form_sd_mm, static_cast<std::size_t>(number(m, "n_points")),
                                   static_cast<std::size_t>(number(m, "n_gross"))});
        n_grazing += number(m, "n_grazing");
        n_gross += number(m, "n_gross");
      }
    }
    const auto statistics = metrology::statistics_of(repeats);
    reports::ModelResult result{.model = model,
                                .mean_diameter_mm = statistics.mean_diameter_mm,
                                .repeatability_sd_mm = statistics.repeatability_sd_mm,
                                .max_form_sd_mm = statistics.max_form_sd_mm,
                                .mean_form_sd_mm = statistics.mean_form_sd_mm};
    if (section.certificate_mm && statistics.mean_diameter_mm) {
      result.error_mm = *statistics.mean_diameter_mm - section.certificate_mm->value;
      result.u_error_mm = metrology::u_of_error_mm(statistics, u_calibration, section.certificate_mm->u);
    }
    section.models.push_back(result);
  }
  const auto& full = section.models.front();
  const bool met = (!full.error_mm || std::abs(*full.error_mm) <= sheet.error_limit_mm) &&
                   full.max_form_sd_mm <= sheet.form_limit_mm;
  section.verdict = met ? reports::Verdict::met : reports::Verdict::not_met;
  section.criterion = full.error_mm
                          ? fmt::format(
                                "|mean - certificate| <= {} mm and form standard deviation <= {} mm, "
                                "simple acceptance",
                                sheet.error_limit_mm, sheet.form_limit_mm)
                          : fmt::format("form standard deviation <= {} mm, simple acceptance", sheet.form_limit_mm);
  const int n = session.choices().repeats;
  section.remarks.push_back(
      fmt::format("Left out per repeat, on average: {:.0f} points at more than 60 degrees of "
                  "incidence, {:.1f} beyond 6 robust standard deviations.",
                  n_grazing / n, n_gross / n));
  if (full.u_error_mm) {
    section.remarks.push_back(
        fmt::format("u of the error: scatter of the mean, calibration ({:.4f} mm) and certificate "
                    "({:.4f} mm); bias by the camera's blur at the silhouette is not in it.",
                    u_calibration, section.certificate_mm->u));
  }
  section.deviation_mm =
      read_float_tiff(session.path(fmt::format("verification/{}-00-{}-deviation.tiff", scene, nominal.name)));
  section.deviation_caption = "First repeat; positive: outside the fitted surface.";
  return section;
}

std::optional<reports::PhaseCorrectionSection> phase_correction_section(const CommissionSession& session,
                                                                        const InstrumentSheet& sheet,
                                                                        const model::Scanner& scanner) {
  if (!scanner.linearisation) return std::nullopt;
  const auto& table = *scanner.linearisation;
  reports::PhaseCorrectionSection out;
  Image<float> ripple(table.columns, table.rows);
  double largest = 0, largest_u = 0;
  for (std::size_t i = 0; i < ripple.size(); ++i) {
    ripple.values()[i] = static_cast<float>(1e3 * std::abs(table.ripple_rad[i]));
    largest = std::max(largest, 1e3 * std::abs(table.ripple_rad[i]));
    largest_u = std::max(largest_u, 1e3 * table.u_ripple_rad[i]);
  }
  out.ripple_mrad = std::move(ripple);
  const auto& choices = session.choices();
  out.sentences.push_back(fmt::format(
      "Fixed: the harmonics of the binary patterns ripple the phase with {} cycles per period, up to {:.1f} mrad over "
      "the field (u at most {:.2f} mrad), measured on {} flat stacks and kept in the Scanner file as its phase "
      "linearisation. {} in the verification.",
      table.phase_steps, largest, largest_u, table.stacks, choices.linearisation ? "Corrected" : "Not corrected"));
  double one = 0, two = 0;
  int n = 0;
  for (const auto& scene : sheet.scenes) {
    for (int r = 0; r < choices.repeats; ++r) {
      const Value v = session.load(fmt::format("verification/{}-{:02}.json", scene.name, r));
      const Value* corrections = v.find("corrections");
      if (!corrections || !corrections->find("one_cycle_mrad")) continue;
      one += std::pow(number(*corrections, "one_cycle_mrad"), 2);
      two += std::pow(number(*corrections, "two_cycles_mrad"), 2);
      ++n;
    }
  }
  const int stacks = static_cast<int>(sheet.scenes.size()) * choices.repeats;
  if (n > 0) {
    out.sentences.push_back(fmt::format(
        "New in every stack: the lamp makes one cycle per period, {:.1f} mrad rms, and the slide's steps two, {:.1f} "
        "mrad rms; estimated from the stack's own pixels and corrected in {} of {} stacks.",
        std::sqrt(one / n), std::sqrt(two / n), n, stacks));
  } else {
    out.sentences.push_back("New in every stack: the errors of the slide's steps and of the lamp were not corrected.");
  }
  out.sentences.push_back("Both corrections are off where delta is measured.");
  return out;
}

}  // namespace

reports::CommissioningReport gather_report(const CommissionSession& session, const CommissionScanner& commissioned) {
  const InstrumentSheet& sheet = commissioned.sheet();
  const auto scanner = model::read_scanner(session.path("scanner.json"));
  reports::CommissioningReport report;
  report.scanner_name = scanner.name;
  report.virtual_instrument = session.choices().sheet_sha256.empty();
  if (report.virtual_instrument) report.seed = session.choices().seed;
  report.instrument_note = sheet.note;
  report.provenance = provenance_now();
  report.provenance.inputs.emplace_back("scanner.json", sha256_of_file(session.path("scanner.json")));
  double align_s = 0, calibrate_s = 0, verify_s = 0;
  report.alignment = alignment_section(session, sheet.plan.x->period, align_s);
  report.phase_corrections = phase_correction_section(session, sheet, scanner);
  report.calibration = calibration_section(session, scanner, calibrate_s);
  for (const auto& scene : sheet.scenes) {
    for (const auto& nominal : scene.artefacts) {
      report.artefacts.push_back(artefact_section(session, sheet, scene.name, nominal));
    }
    for (int r = 0; r < session.choices().repeats; ++r) {
      verify_s += number(session.load(fmt::format("verification/{}-{:02}.json", scene.name, r)), "duration_s");
    }
  }
  const double linearise_s = number(session.load("linearisation.json"), "duration_s");
  report.stages = {
      {"alignment", align_s}, {"linearisation", linearise_s}, {"calibration", calibrate_s}, {"verification", verify_s}};

  // The scene with the most artefacts is the richest picture.
  const auto& shown = *std::max_element(sheet.scenes.begin(), sheet.scenes.end(), [](const auto& a, const auto& b) {
    return a.artefacts.size() < b.artefacts.size();
  });
  const Capture capture = read_capture(session.path(fmt::format("verification/{}-00", shown.name)));
  for (std::size_t i = 0; i < capture.frames.size(); ++i) {
    report.fringes.push_back({describe(capture.info.frames[i].pattern), capture.frames[i], capture.saturation_level()});
  }
  const auto map = decode::decode_phase(capture, scanner.projector.main_axis());
  Image8 valid(map.width(), map.height());
  for (std::size_t i = 0; i < valid.size(); ++i) valid.values()[i] = map.validity.values()[i] == 0 ? 1 : 0;
  report.phase_map =
      reports::PhaseMapPicture{"Absolute phase of the first capture of the " + shown.name, map.phase_rad, valid};

  bool all_met = true;
  double worst_error = 0, worst_form = 0;
  for (const auto& artefact : report.artefacts) {
    all_met = all_met && artefact.verdict == reports::Verdict::met;
    worst_error = std::max(worst_error, std::abs(artefact.models.front().error_mm.value_or(0.0)));
    worst_form = std::max(worst_form, artefact.models.front().max_form_sd_mm);
  }
  const bool aligned = report.alignment->iterations.back().verdict == "aligned";
  const auto line = [](bool met, std::string sentence) {
    return reports::VerdictLine{met ? reports::Verdict::met : reports::Verdict::not_met, std::move(sentence)};
  };
  report.verdicts = {
      line(aligned, report.alignment->conclusion),
      line(worst_error <= sheet.error_limit_mm,
           fmt::format("Largest diameter error {:.4f} mm (limit {} mm).", worst_error, sheet.error_limit_mm)),
      line(worst_form <= sheet.form_limit_mm,
           fmt::format("Largest form standard deviation {:.4f} mm (limit {} mm).", worst_form, sheet.form_limit_mm))};
  report.verdict = aligned && all_met ? reports::Verdict::met : reports::Verdict::not_met;
  report.verdict_text = aligned && all_met
                            ? "The scanner is commissioned: aligned, calibrated, and every artefact within its limits."
                            : "The scanner is not commissioned: see the lines that are not met.";
  return report;
}

std::string summary_table(const reports::CommissioningReport& report) {
  std::string out = fmt::format("{:<20}{:>12}{:>12}{:>10}{:>9}{:>10}{:>12}{:>11}\n", "artefact", "certificate", "mean",
                                "error", "u", "form sd", "paper error", "paper sd");
  const auto mm = [](const std::optional<double>& v, int digits) {
    return v ? fmt::format("{:.{}f}", *v, digits) : std::string("-");
  };
  for (const auto& a : report.artefacts) {
    const auto& m = a.models.front();
    const auto signed_error = m.error_mm ? fmt::format("{:+.4f}", *m.error_mm) : std::string("-");
    out += fmt::format(
        "{:<20}{:>12}{:>12}{:>10}{:>9}{:>10}{:>12}{:>11}\n", a.name,
        a.certificate_mm ? fmt::format("{:.4f}", a.certificate_mm->value) : "-", mm(m.mean_diameter_mm, 4),
        signed_error, mm(m.u_error_mm, 4), fmt::format("{:.4f}", m.max_form_sd_mm),
        a.paper.error_limit_mm ? fmt::format("< {}", *a.paper.error_limit_mm) : "-", mm(a.paper.form_sd_mm, 3));
  }
  out += "All in mm; mean of the repeats; form sd: the largest standard deviation of a repeat.\n\n";
  out += fmt::format("{:<20}{:>24}{:>24}{:>24}\n", "model", "full rays", "paper, eqs. 1-20", "ideal lenses, 1-17");
  for (const auto& a : report.artefacts) {
    out += fmt::format("{:<20}", a.name);
    for (const auto& m : a.models) {
      out += fmt::format("{:>24}", fmt::format("{}form {:.3f}", m.error_mm ? fmt::format("{:+.3f}, ", *m.error_mm) : "",
                                               m.max_form_sd_mm));
    }
    out += "\n";
  }
  out += "\n" + report.verdict_text + "\n";
  return out;
}

}  // namespace fringecal::cli

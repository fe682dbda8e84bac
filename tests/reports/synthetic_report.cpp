#include "tests/reports/synthetic_report.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

namespace fringecal::reports {
namespace {

constexpr double kPi = std::numbers::pi;

/// SplitMix64, and Irwin-Hall's sum of twelve as a normal deviate: the same on every platform.
class Noise {
 public:
  double uniform() {
    state_ += 0x9E3779B97F4A7C15u;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }
  double normal() {
    double sum = -6.0;
    for (int k = 0; k < 12; ++k) sum += uniform();
    return sum;
  }

 private:
  std::uint64_t state_ = 7;
};

double period_px(const SyntheticOptions& o) { return o.width_px / 58.0; }

/// Stripe number at a column: two stripes per period.
double stripe(const SyntheticOptions& o, double x) { return std::floor(2.0 * x / period_px(o)); }

FringeFrame frame(const SyntheticOptions& o, Noise& noise, const Pattern& pattern) {
  Image8 image(o.width_px, o.height_px);
  const int shift = pattern.kind == PatternKind::gray ? 6 - pattern.index : 0;
  for (int y = 0; y < o.height_px; ++y) {
    for (int x = 0; x < o.width_px; ++x) {
      const double rx = 2.0 * x / o.width_px - 1.0, ry = 2.0 * y / o.height_px - 1.0;
      double signal = 0;
      if (pattern.kind == PatternKind::gray) {
        const auto n = static_cast<unsigned>(stripe(o, x));
        signal = (((n ^ (n >> 1)) >> shift) & 1u) != 0 ? 1.0 : -1.0;
      } else {
        signal = std::cos(2.0 * kPi * x / period_px(o) - kPi - pattern.index * kPi / 2);
      }
      const double light = 1.0 - 0.25 * (rx * rx + ry * ry);
      image(x, y) = static_cast<std::uint8_t>(std::lround(light * (105.0 + 80.0 * signal) + 12.0 + noise.normal()));
    }
  }
  return {.caption = describe(pattern), .image = image};
}

PhaseMapPicture phase_map(const SyntheticOptions& o) {
  PhaseMapPicture out{.caption = "Absolute phase of the flat board after alignment.",
                      .phase_rad = Image<float>(o.width_px, o.height_px),
                      .valid = Image8(o.width_px, o.height_px, 1)};
  for (int y = 0; y < o.height_px; ++y) {
    for (int x = 0; x < o.width_px; ++x) {
      out.phase_rad(x, y) = static_cast<float>(2.0 * kPi * x / period_px(o) + 3.0 * std::sin(2.0 * y / o.height_px));
      const double rx = x - 0.78 * o.width_px, ry = y - 0.3 * o.height_px;
      if (std::hypot(rx, ry) < 0.06 * o.height_px || x < 0.03 * o.width_px) out.valid(x, y) = 0;
    }
  }
  return out;
}

/// Gray edges come `jump_px` late: between the edge and the phase's wrap the plain absolute phase is one period off.
ProfileColumns profile(const SyntheticOptions& o, Noise& noise, double jump_px) {
  ProfileColumns out{.row_px = o.height_px / 2, .column_px = {}, .gray_number = {}, .phase_rad = {}};
  for (int x = 10; x < o.width_px - 10; ++x) {
    if (x > o.width_px / 5 && x < o.width_px / 5 + 6) continue;  // a mark on the board: invalid pixels
    const double gray = stripe(o, x - jump_px), u = x / period_px(o);
    const double wrapped = 2.0 * kPi * (u - std::floor(u)) - kPi;
    out.column_px.push_back(x);
    out.gray_number.push_back(gray);
    out.phase_rad.push_back(2.0 * kPi * std::floor(gray / 2.0) + wrapped + 0.009 * noise.normal());
  }
  return out;
}

AlignmentSection alignment(const SyntheticOptions& o, Noise& noise) {
  AlignmentSection out{
      .tolerance_fraction = 0.02,
      .conclusion = "The grating is aligned: after 3 turns of the loop δ is 1.0 µm, 0.4 % of a period.",
      .before = profile(o, noise, 0.28 * period_px(o)),
      .after = profile(o, noise, 0.0)};
  const double period = period_px(o);
  out.iterations = {{.number = 1,
                     .theta_mrad = {0.7968, 0.0061},
                     .bit = 5,
                     .delta_um = {38.41, 0.52},
                     .fraction_of_period = 0.16,
                     .period_px = period,
                     .jump_px = 0.16 * period,
                     .turn_mrad = -0.797,
                     .instruction = "Turn the adjuster clockwise by 0.797 mrad.",
                     .verdict = "turn again"},
                    {.number = 2,
                     .theta_mrad = {0.0742, 0.0058},
                     .bit = 5,
                     .delta_um = {3.57, 0.50},
                     .fraction_of_period = 0.0149,
                     .period_px = period,
                     .jump_px = 0,
                     .turn_mrad = -0.074,
                     .instruction = "Turn the adjuster clockwise by 0.074 mrad.",
                     .verdict = "turn again"},
                    {.number = 3,
                     .theta_mrad = {-0.0021, 0.0059},
                     .bit = 5,
                     .delta_um = {-0.98, 0.51},
                     .fraction_of_period = -0.0041,
                     .period_px = period,
                     .jump_px = 0,
                     .turn_mrad = {},
                     .instruction = "",
                     .verdict = "within tolerance"}};
  return out;
}

void add_residuals(CalibrationSection& c, const SyntheticOptions& o, Noise& noise) {
  Image<float> coverage(16, 12, std::numeric_limits<float>::quiet_NaN());
  for (int pose = 0; pose < o.poses; ++pose) {
    const double cx = (0.3 + 0.4 * noise.uniform()) * o.width_px, cy = (0.3 + 0.4 * noise.uniform()) * o.height_px;
    const double turn = 0.5 * (noise.uniform() - 0.5), step = 0.06 * o.width_px;
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 10; ++column) {
        const double a = (column - 4.5) * step, b = (row - 3) * step;
        const double x = cx + a * std::cos(turn) - b * std::sin(turn), y = cy + a * std::sin(turn) + b * std::cos(turn);
        if (x < 0 || y < 0 || x >= o.width_px || y >= o.height_px) continue;
        c.camera_residuals.push_back({x, y, 0.034 * noise.normal(), 0.031 * noise.normal()});
        c.projector_residuals.push_back({x, y, 0.00021 * noise.normal()});
        float& cell = coverage(static_cast<int>(16 * x / o.width_px), static_cast<int>(12 * y / o.height_px));
        cell = std::isnan(cell) ? 1.0f : cell + 1.0f;
      }
    }
  }
  c.coverage = coverage;
}

CalibrationSection calibration(const SyntheticOptions& o, Noise& noise) {
  CalibrationSection c;
  c.method =
      "Joint solution of camera, projector and poses; camera with k1, k2, p1, p2 (chosen by the Bayesian information "
      "criterion), projector with k1, k2.";
  c.parameters = {{"camera.fx", 3721.43, 0.62, "px", "focal length, columns"},
                  {"camera.fy", 3721.37, 0.61, "px", "focal length, rows"},
                  {"camera.cx", 707.91, 0.84, "px", "principal point, column"},
                  {"camera.cy", 511.88, 0.79, "px", "principal point, row"},
                  {"camera.k1", -0.09984, 0.00052, "", "radial distortion, 2nd order"},
                  {"camera.k2", 0.0571, 0.0093, "", "radial distortion, 4th order"},
                  {"camera.p1", 2.03e-4, 1.1e-5, "", "tangential distortion"},
                  {"camera.p2", -1.52e-4, 1.3e-5, "", "tangential distortion"},
                  {"projector.f", 31.9962, 0.0071, "mm", "focal length on the grating"},
                  {"projector.u0", 7.829, 0.0118, "mm", "principal point on the grating"},
                  {"projector.k1", -0.0807, 0.0013, "", "radial distortion, 2nd order"},
                  {"projector.k2", 0.0321, 0.0062, "", "radial distortion, 4th order"},
                  {"proj_from_cam.base", 400.113, 0.087, "mm", "distance of the pupils"},
                  {"proj_from_cam.y", 3.0, {}, "mm", "held by a prior: one fringe direction leaves it open"}};
  c.paper_parameters = {
      {"L", 1000.21, 0.11, "mm", "working distance"},         {"b", 400.02, 0.09, "mm", "base line"},
      {"α", 0.380512, 0.000041, "rad", "tilt of the camera"}, {"p_R", 7.5003, 0.0014, "mm", "period on R"},
      {"kc1", 1.734e-4, 9.1e-7, "mm^-2", "camera, eq. 18"},   {"kc2", 1.11e-7, 2.8e-8, "mm^-4", "camera, eq. 18"},
      {"kp1", 8.07e-8, 1.3e-9, "mm^-2", "projector, eq. 19"}, {"kp2", -1.9e-14, {}, "mm^-4", "projector, eq. 19"}};
  c.residuals = {.camera_rms_px = 0.0325,
                 .projector_rms = 0.00021,
                 .projector_unit = "mm",
                 .grid_rms_mm = 0.0118,
                 .chi2_per_dof = 1.04,
                 .corners_used = 70 * o.poses - 3,
                 .corners_rejected = 3,
                 .poses = o.poses,
                 .iterations = 14};
  for (int k = 0; k < o.poses; ++k) c.poses.push_back({fmt::format("board-{:02}", k), true, ""});
  c.poses.push_back(
      {fmt::format("board-{:02}", o.poses), false, "37 of 70 corners were found; at least 60 are needed"});
  c.image_width_px = o.width_px;
  c.image_height_px = o.height_px;
  add_residuals(c, o, noise);
  return c;
}

struct ArtefactSize {
  std::string name;
  ArtefactKind kind;
  double nominal_mm, field_share;  // diameter over the width of the field of view
};

Image<float> deviation(const SyntheticOptions& o, Noise& noise, const ArtefactSize& size) {
  Image<float> out(o.width_px, o.height_px, std::numeric_limits<float>::quiet_NaN());
  const double radius = 0.5 * size.field_share * o.width_px;
  for (int y = 2; y < o.height_px - 2; ++y) {
    for (int x = 2; x < o.width_px - 2; ++x) {
      const double rx = (x - 0.5 * o.width_px) / radius, ry = (y - 0.5 * o.height_px) / radius;
      const double r = size.kind == ArtefactKind::sphere     ? std::hypot(rx, ry)
                       : size.kind == ArtefactKind::cylinder ? std::abs(rx)
                                                             : 0.0;
      if (r > 0.85) continue;
      const double bow = 0.012 * (rx * rx - 0.3) * (size.kind == ArtefactKind::plane ? 0.3 : 1.0);
      const double ripple = 0.006 * std::sin(8.0 * kPi * x / period_px(o) / 4.0);
      out(x, y) = static_cast<float>(bow + ripple + 0.026 * noise.normal());
    }
  }
  return out;
}

ArtefactSection artefact(const SyntheticOptions& o, Noise& noise, const ArtefactSize& size) {
  const bool round = size.kind != ArtefactKind::plane;
  ArtefactSection a;
  a.name = size.name;
  a.kind = size.kind;
  a.paper = {.text = round ? "10 times, diameter error < 0.04 mm" : "flat board 800 x 700 mm, 10 times",
             .error_limit_mm = {},
             .form_sd_mm = round ? (size.kind == ArtefactKind::cylinder ? 0.035 : 0.034) : 0.028};
  a.verdict = round ? Verdict::met : Verdict::not_met;
  a.criterion =
      round ? "|error| < 0.06 mm and form standard deviation < 0.06 mm" : "form standard deviation < 0.028 mm";
  ModelResult full{.model = "full", .max_form_sd_mm = 0.0312, .mean_form_sd_mm = 0.0289};
  for (int k = 0; k < 10; ++k) {
    Repeat r{.form_sd_mm = 0.029 + 0.0009 * noise.normal(), .n_points = 5000, .n_rejected = 12};
    r.n_points += static_cast<std::size_t>(200 * noise.uniform());
    if (round) r.diameter_mm = size.nominal_mm - 0.0041 + 0.004 * noise.normal();
    a.repeats.push_back(r);
  }
  if (round) {
    a.paper.error_limit_mm = 0.04;
    a.certificate_mm = Uncertain{size.nominal_mm + 0.0012, 0.0006};
    full.mean_diameter_mm = size.nominal_mm - 0.0041;
    full.error_mm = -0.0053;
    full.u_error_mm = 0.0016;
    full.repeatability_sd_mm = 0.0043;
  }
  ModelResult chen = full, ideal = full;
  chen.model = "chen2008";
  ideal.model = "ideal";
  chen.max_form_sd_mm = 0.0461;
  ideal.max_form_sd_mm = 0.2107;
  if (round) {
    chen.error_mm = 0.0231;
    ideal.error_mm = -0.3121;
  }
  a.models = {full, chen, ideal};
  a.deviation_mm = deviation(o, noise, size);
  a.deviation_caption = "Repeat 1: points minus fitted " + word_for(size.kind) + ", positive outside.";
  return a;
}

}  // namespace

CommissioningReport synthetic_report(const SyntheticOptions& options) {
  Noise noise;
  CommissioningReport r;
  r.scanner_name = "chen2008";
  r.virtual_instrument = true;
  r.seed = 7;
  r.instrument_note =
      "Every frame of this report was rendered by the preset chen2008; the program was told the certificates, never "
      "the truth.";
  r.provenance = {.version = "0.1.0",
                  .date = "2026-11-22T00:00:00Z",
                  .inputs = {{"chen2008.toml", std::string(64, 'a')}, {"board.toml", std::string(64, 'b')}}};
  r.stages = {{"alignment", 9.4}, {"calibration", 31.0}, {"artefacts", 78.2}, {"report", 2.1}};
  r.verdict = Verdict::not_met;
  r.verdict_text =
      "Four of five artefacts are within the paper’s figures; the flat board’s form standard deviation is not.";
  r.verdicts = {{Verdict::met, "The grating is aligned to 0.4 % of a period (tolerance 2 %)."},
                {Verdict::met, "The board’s grid is reproduced to 12 µm rms."},
                {Verdict::met, "All diameter errors are below 0.04 mm."},
                {Verdict::not_met, "The flat board’s form standard deviation is 0.031 mm; the paper has 0.028 mm."},
                {Verdict::not_judged, "The plaster model was not measured."}};
  for (int k = 0; k < 7; ++k) r.fringes.push_back(frame(options, noise, {.kind = PatternKind::gray, .index = k}));
  for (int k = 0; k < 4; ++k) r.fringes.push_back(frame(options, noise, {.kind = PatternKind::phase, .index = k}));
  r.phase_map = phase_map(options);
  r.alignment = alignment(options, noise);
  r.calibration = calibration(options, noise);
  for (const auto& size : {ArtefactSize{"Flat board", ArtefactKind::plane, 0, 1.0},
                           ArtefactSize{"Sphere 30 mm", ArtefactKind::sphere, 30, 0.07},
                           ArtefactSize{"Sphere 38 mm", ArtefactKind::sphere, 38, 0.09},
                           ArtefactSize{"Sphere 50 mm", ArtefactKind::sphere, 50, 0.115},
                           ArtefactSize{"Cylinder 119.85 mm", ArtefactKind::cylinder, 119.85, 0.27}}) {
    r.artefacts.push_back(artefact(options, noise, size));
  }
  return r;
}

}  // namespace fringecal::reports

// A verification plan: which artefact stands where how often, what is evaluated, against which limit. TOML
// ("fringecal.plan", version 1); the shipped ones are files in metrology/plans and part of the program, and
// `fringecal plan NAME --print` writes one to start from. A plan names its source, and what in it could not be checked
// against the standard's own text.
//
//   diagnose = true                # at the top; only where the plan is a single capture
//   [[series]]
//   scene = "ball_bar"             # name of the place list; captures are called SCENE-00, SCENE-01, ...
//   artefacts = ["bar150"]         # of artefacts.toml; all in the field at once
//   captures = 7                   # positions, or repeats at one place (`repeats = true`)
//   captures_per_position = 3      # optional, 1: so many captures in a row of the artefact left where it is; `captures` is then all
//                                  # of them, 21 of 7 positions, called SCENE-00a, SCENE-00b, SCENE-00c, SCENE-01a, ...; a length at
//                                  # a position is the mean of its captures, a form the largest of them
//   places = [[0, 0, 0, 0, 0, 90], ...]  # optional, for prediction and drawing: where the artefact stands at each position,
//                                  # x, y, z in mm and a rotation vector in degrees, frame `world`; of repeats, and of
//                                  # several artefacts, one place per artefact. A bar lies along x, a cylinder along z, a
//                                  # flat's normal is z; a plate's middle is the mean of its centres; a step's lower
//                                  # plane lies in z = 0 at x < 0.
//   [series.views]                 # optional: every capture is several views, brought together (multi_view.h); they are called
//                                  # SCENE-00-0, SCENE-00-1, ...
//   turns_deg = [[0, 0, 0], [0, 30, 0], ...]  # how the carrier with the artefact is turned for each, 2 to 36; rotation vectors
//   reference_diameter_mm = 20     # of the spheres on the carrier that bring the views together
//   references_mm = [[-140, -70, 0], ...]  # where they stand, for prediction only; not needed and not used to evaluate
//   [[series.quantity]]
//   measurand = "distance_error"   # see below
//   symbol = "SD"                  # as the source has it
//   name = "sphere-spacing error"
//   upper_mm = 0.03                # limits; both may be absent
//   lower_mm = -0.03
//
// Measurands (d diameter, l(t) certified length at temperature, n captures)
//   diameter_error       d - d(t) at each position                                                       (1)
//   mean_diameter_error  mean of d over the n captures - d(t)                                            (2) [Chen2008, section 4]
//   distance_error       distance of a ball bar's centres, of any two of a plate's, or height of a step, - l(t), each position (3)
//   form_range           range of the deviations from the Gaussian feature, each position               (4)
//   form_95              width of the shell that holds 95 % of the points (2.5 % left out on each side)  (5)
//   form_sd              standard deviation of the deviations, the largest of the n captures             (6) [Chen2008, section 4]
#pragma once

#include "fitting/fit.h"
#include "metrology/decision.h"

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

enum class Measurand { diameter_error, mean_diameter_error, distance_error, form_range, form_95, form_sd };
const char* name_of(Measurand measurand);

struct PlannedQuantity {
  Measurand measurand = Measurand::diameter_error;
  std::string symbol, name;
  std::optional<Limits> limits;  // mm
};

/// Several views of one thing on a carrier with reference spheres.
struct SeriesViews {
  std::vector<std::array<double, 3>> turns_deg;
  double reference_diameter_mm = 20;
  std::vector<std::array<double, 3>> references_mm;
};

struct Series {
  std::string scene;
  std::vector<std::string> artefacts;
  int captures = 1;
  int captures_per_position = 1;  // 2 or more: averaged
  bool repeats = false;           // the same place again, instead of another position
  std::vector<PlannedQuantity> quantities;
  std::vector<std::array<double, 6>> places;
  std::optional<SeriesViews> views;

  int positions() const { return captures / captures_per_position; }
  int position_of(int capture) const { return capture / captures_per_position; }
  int views_of_a_capture() const { return views ? static_cast<int>(views->turns_deg.size()) : 1; }
  /// One place per artefact for that capture; empty where the plan has none.
  std::vector<std::array<double, 6>> places_of(int capture) const;
};

struct Plan {
  std::string name, title, source;
  std::vector<std::string> unchecked;
  DecisionRule decision_rule = DecisionRule::iso_14253_1;
  fitting::Rejection rejection = fitting::Rejection::none;  // before form and size are evaluated: none or vdi_2634
  std::vector<Series> series;
  bool diagnose = false;  // one series of one capture, with a flat: the likeliest cause of its deviations (diagnosis.h)
};

/// name: a shipped plan ("paper", "vdi2634-2", "vdi2634-3", "iso10360-13", "plate-step", "quick"), or a file. Throws InputError.
Plan read_plan(const std::string& name);
/// The text of a shipped plan. Throws InputError with the names that there are.
std::string plan_text(const std::string& name);
std::vector<std::string> shipped_plans();

/// "ball_bar-03": the capture of that series; "ball_bar-03b" where a position has several.
std::string capture_name(const Series& series, int capture);
/// "turned_bar-03-1": one view of it; the capture's name where it has one view only.
std::string view_name(const Series& series, int capture, int view);

}  // namespace fringecal::metrology

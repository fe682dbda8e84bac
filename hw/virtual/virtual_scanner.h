// The virtual scanner: renders what the physics of a sliding-grating fringe projector gives, including what our models
// leave out. Shares nothing with the estimators but the lens formulas of calib/model.
//
// Per pixel: ray through the camera's lens (eqs. 1 to 4 of camera.h, inverted), first surface it meets, Lambert shading
// and shadow towards the projector's pupil, place on the grating through the projector's lens, and for each pattern the
// binary grating blurred by the projector's lens, shifted by lithography, slide and fringe angle; then the camera's
// blur, fixed-pattern gain, shot and read noise, quantisation, saturation. All values come from a TOML preset.
//
// Pattern s stands in slot s of the slide, at s pitches d along it. With the fringes at the angle theta to the slide,
// it arrives displaced on the grating by
//   offset_s = (s_ref - s) d sin(theta) + lithography + straightness + slide's error across              (1) [paper.md]
// where s_ref is the slot at which the phase's wrap stands (step N/2: PS2 of four), so that the true u0 holds for it: a
// Gray edge of bit b arrives (n + 2 - b) d sin(theta) beyond its phase edge, in growing u for theta > 0. The slide's
// error along adds to s d. Warm-up: base and alpha grow by their drift times 1 - exp(-t / tau). A warm room makes the base
// longer by the frame's expansion (a frame of one metal keeps its angles) and every artefact by its own.
//
// Frames. The preset's `world` has O on R below the projector's pupil and Z along the normal of R. The projector's axis
// is tilted against it, so this is *not* the `world` of a Scanner file (calib/model/scanner.h), which the projector's
// axis defines; truth() has both and the transformation between them.
//
// Not rendered: the camera's own fall-off, light that surfaces throw at each other, gloss, defocus away from R.
//
// Determinism: the frames depend on preset, scene, state and seeds only, not on the number of threads.
#pragma once

#include "calib/model/camera.h"
#include "calib/model/scanner.h"
#include "core/capture.h"
#include "core/uncertain.h"
#include "hw/virtual/scene.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::virt {

/// What can befall an instrument between two checks; none of it is known to the operator.
struct Faults {
  double base_mm = 0;  // the camera shifted along the base line, its direction kept
  Eigen::Vector3d camera_turn_rad = Eigen::Vector3d::Zero();  // rotation vector in cam: knocked in its mount
  double projector_transmission = 1;                          // of a dirty window
  double projector_veil = 0;  // share of the light that this dirt scatters evenly over the field
};

/// What an operator can change, and what time does.
struct InstrumentState {
  double adjuster_mrad = 0;       // sum of the adjuster's turns so far, as its scale shows them
  double adjuster_play_mrad = 0;  // hidden from the operator: how much of the backlash is open; kept by turn_adjuster()
  double minutes_since_start = 1e6;  // warm-up drift; large = settled
  double room_degC = 20.0;
  double exposure = 1.0;  // factor on the light
  Faults faults = {};
};

/// What may differ from the preset without another file.
struct PresetOverrides {
  std::optional<double> theta_mrad;  // fringe angle before any adjustment
  std::optional<int> bits;           // 8 or 12
};

/// What is in the light path when a frame is taken.
struct Lighting {
  std::optional<std::size_t> pattern;  // of the plan; absent: none (parked, between two patterns), the light is blocked
  double lamp = 1;                     // factor on its light; 0: off, only the ambient light is left
};

/// What the camera sees of a scene, apart from the patterns. It depends on the scene and on the drift.
struct SeenScene;

/// Data sheet of the camera.
struct CameraData {
  int width_px = 0, height_px = 0, bits = 8;
  double exposure_ms = 0;  // at which `exposure` is 1
};

class VirtualScanner {
 public:
  /// preset: "chen2008" (built in) or a TOML file. instrument_seed: draws what is fixed for one instrument (lithography
  /// errors, fixed-pattern gain, straightness, printing errors of boards, artefacts' true values against certificates).
  VirtualScanner(const std::string& preset, std::uint64_t instrument_seed, const PresetOverrides& overrides = {});
  ~VirtualScanner();
  VirtualScanner(VirtualScanner&&) noexcept;

  /// One stack of all patterns of the plan. stack_seed: noise, step errors, flicker of this stack.
  Capture capture(const Scene& scene, const InstrumentState& state, std::uint64_t stack_seed) const;

  /// The same frames, one at a time and in any order: the frame of a pattern depends on scene, state, seed and pattern
  /// only, so a frame taken again is the same frame, and the frames of a stack are those of capture().
  std::shared_ptr<const SeenScene> see(const Scene& scene, const InstrumentState& state) const;
  GrayImage frame(const SeenScene& seen, const InstrumentState& state, std::uint64_t stack_seed,
                  const Lighting& lighting) const;

  /// Turns the adjuster, +x for +x in theta, with its resolution, scale error and backlash (turning on after a reversal
  /// does nothing at first; a new instrument is engaged for negative turns). The operator sees the effect in the next
  /// stack.
  void turn_adjuster(double turn_mrad, InstrumentState& state) const;

  const PatternPlan& plan() const;
  /// The pitch of the patterns along the slide (on the grating's data sheet).
  double pattern_pitch_mm() const;
  CameraData camera_data() const;
  /// Sensor data sheet: side of a pixel.
  double pixel_mm() const;
  /// Of the flat board, as its certificate has it.
  double certified_flatness_mm() const;
  double design_working_distance_mm() const;

  /// A calibration board of this instance: printing errors drawn once, the certified pitch what its certificate says.
  /// kind: "chessboard" or "circles".
  model::Board certified_board(const std::string& kind) const;
  /// The certificate of an artefact: value and standard uncertainty, mm. name: "sphere30", "sphere38", "sphere50",
  /// "cylinder", "bar_a", "bar_b" (the ball bar's spheres), "bar" (the distance of their centres), "step" (its height),
  /// "plate_2" (a diameter), "plate_2_x" (a coordinate of its centre).
  Uncertain certificate_mm(const std::string& artefact) const;

  /// How many spheres the preset's plate has; 0: there is none.
  int plate_spheres() const;

  /// Scenes of the standard commissioning, by name: "alignment", "calibration 0" .. "calibration 14", "plane R" (R:
  /// repeat, a slightly different place each), "spheres R", "cylinder R"; of the acceptance plans "probing P",
  /// "ball_bar P", "flat P", "sphere_plate P", "step P" (P: place), "turned_sphere P.V", "turned_bar P.V" (V: view); of the daily check "morning R"; "plaster V" (V: view, an eighth of a turn each). Throws std::logic_error on another name.
  /// Artefacts are as large as the room's temperature makes them. placing: a hand never puts a thing back exactly; another
  /// number is another draw of its scatter.
  Scene standard_scene(const std::string& name, double room_degC = 20.0, std::uint64_t placing = 1) const;
  bool has_standard_scene(const std::string& name) const;
  /// How many calibration scenes the preset has.
  int calibration_scenes() const;

  /// The true instrument as JSON: lenses, poses, theta, artefacts. For tests and truth files only.
  Value truth(const InstrumentState& state) const;
  /// The true instrument as a Scanner, and its camera in the preset's `world`. For tests and truth files only.
  model::Scanner true_scanner(const InstrumentState& state) const;
  Rigid3 preset_from_cam(const InstrumentState& state) const;
  /// The true fringe angle. For tests and truth files only.
  double true_theta_rad(const InstrumentState& state) const;
  /// Where each pattern of a stack really stands across the fringes on the grating, eq. 1, mm. For tests only.
  std::vector<double> true_offsets_mm(const InstrumentState& state, std::uint64_t stack_seed) const;
  /// Where the corners of a board really are, row after row, in its part's frame. For tests and truth files only.
  std::vector<Eigen::Vector3d> true_corners_mm(const PatternBoard& board) const;

 private:
  struct Instance;
  std::unique_ptr<Instance> instance_;
};

}  // namespace fringecal::virt

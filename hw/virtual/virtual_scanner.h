// The virtual scanner: renders what the physics of a sliding-grating fringe projector gives, including what our models
// leave out. Shares nothing with the estimators but the lens formulas of calib/model.
//
// Per pixel: ray through the camera's lens (eqs. 1 to 4 of camera.h, inverted), first surface it meets, Lambert shading
// and shadow towards the projector's pupil, place on the grating through the projector's lens, and for each pattern the
// binary grating blurred by the projector's lens, shifted by lithography, slide and fringe angle; then the camera's
// blur, fixed-pattern gain, shot and read noise, quantisation, saturation. All values come from a TOML preset.
//
// Determinism: the frames depend on preset, scene, state and seeds only, not on the number of threads.
#pragma once

#include "calib/model/camera.h"
#include "core/capture.h"
#include "core/uncertain.h"
#include "hw/virtual/scene.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

namespace fringecal::virt {

/// What an operator can change, and what time does.
struct InstrumentState {
  double adjuster_mrad = 0;          // sum of the turns asked of the adjuster so far
  double minutes_since_start = 1e6;  // warm-up drift; large = settled
  double room_degC = 20.0;
  double exposure = 1.0;  // factor on the light
};

class VirtualScanner {
 public:
  /// preset: "chen2008" (built in) or a TOML file. instrument_seed: draws what is fixed for one instrument (lithography
  /// errors, fixed-pattern gain, straightness, printing errors of boards, artefacts' true values against certificates).
  VirtualScanner(const std::string& preset, std::uint64_t instrument_seed);
  ~VirtualScanner();
  VirtualScanner(VirtualScanner&&) noexcept;

  /// One stack of all patterns of the plan. stack_seed: noise, step errors, flicker of this stack.
  Capture capture(const Scene& scene, const InstrumentState& state, std::uint64_t stack_seed) const;

  /// Turns the adjuster with its scale error and backlash; returns nothing: the operator sees the effect in the next
  /// stack.
  void turn_adjuster(double turn_mrad, InstrumentState& state);

  const PatternPlan& plan() const;
  /// The pitch of the patterns along the slide (on the grating's data sheet).
  double pattern_pitch_mm() const;
  /// Sensor data sheet: side of a pixel.
  double pixel_mm() const;
  double design_working_distance_mm() const;

  /// A calibration board of this instance: printing errors drawn once, the certified pitch what its certificate says.
  /// kind: "chessboard" or "circles".
  model::Board certified_board(const std::string& kind) const;
  /// The certificate of an artefact: value and standard uncertainty, mm. name: "sphere30", "sphere38", "sphere50",
  /// "cylinder".
  Uncertain certificate_mm(const std::string& artefact) const;

  /// Scenes of the standard commissioning, by name: "alignment", "calibration 0" .. "calibration 14", "plane R" (R:
  /// repeat, a slightly different place each), "spheres R", "cylinder R". Throws std::logic_error on another name.
  Scene standard_scene(const std::string& name) const;

  /// The true instrument as JSON: lenses, poses, theta, artefacts. For tests and truth files only.
  Value truth(const InstrumentState& state) const;

 private:
  struct Instance;
  std::unique_ptr<Instance> instance_;
};

}  // namespace fringecal::virt

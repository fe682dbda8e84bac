// The preset: every value of a virtual instrument, read strictly from TOML (presets/*.toml say what each means).
#pragma once

#include "core/fields.h"
#include "core/pattern_plan.h"

#include <Eigen/Core>

#include <array>
#include <map>
#include <string>
#include <vector>

namespace fringecal::virt {

/// x, y, z in mm, and a rotation vector in degrees.
using Place = std::array<double, 6>;

struct Preset {
  std::string name;

  struct {
    int width_px, height_px, bits;
    double pixel_mm, focal_length_mm, blur_px, noise_rms, noise_shot_fraction, fixed_pattern_gain, exposure_ms;
    Eigen::Vector2d principal_point_mm;
    std::array<double, 4> distortion;  // k1, k2, p1, p2
  } camera;
  struct {
    double working_distance_mm, base_mm, pupil_offset_y_mm, projector_tilt_rad, projector_tilt_towards_rad,
        camera_roll_rad;
  } geometry;
  struct {
    double focal_length_mm, principal_point_across_mm, modulation;
    std::array<double, 2> distortion;  // k1, k2
  } projector;
  struct {
    FringeCode code;
    double pattern_pitch_mm, lithography_mm, contrast, third_harmonic_centre, third_harmonic_edge;
    bool gray_first;
  } grating;
  struct {
    double across_mm, along_mm, straightness_mm;
  } slide;
  struct {
    double theta_mrad, adjuster_scale_error, adjuster_backlash_mrad, adjuster_resolution_mrad;
  } assembly;
  struct {
    double base_mm, alpha_rad, time_constant_min, frame_expansion_per_K;
  } drift;
  struct {
    double ambient, flicker;
  } light;
  struct BoardSize {
    int columns, rows;
    double pitch_mm;
  };
  struct {
    double white_margin_pitches, black_albedo, dot_diameter_pitches, u_print_mm, bow_mm, u_pitch_relative;
    BoardSize chessboard, circles;
  } boards;
  double flat_board_width_mm, flat_board_height_mm, flat_board_flatness_mm;
  struct Artefact {
    double nominal_mm, making_mm, u_mm, expansion_per_K;
  };
  // "sphere30", "sphere38", "sphere50", "cylinder"; with a ball bar "bar_a", "bar_b" (its spheres), "bar" (their distance);
  // with a step "step" (its height); with a plate of n spheres "plate_1" .. "plate_n" (diameters) and "plate_1_x", "plate_1_y",
  // "plate_1_z", ... (coordinates of their centres)
  std::map<std::string, Artefact> artefacts;

  struct Placing {
    double shift_mm, turn_deg;
    std::map<std::string, Place> places;  // by object, or "0", "1", ... for calibration
  };
  Placing alignment, calibration, plane, spheres, cylinder;
  // Places of the acceptance plans, by "0", "1", ...; without any where the preset has none.
  Placing probing, ball_bar, flat;
  Placing sphere_plate, step;
  int plate_spheres = 0;
  // Things on a carrier that is turned for each view.
  Placing turned_sphere, turned_bar;
  struct {
    double reference_diameter_mm = 0, shift_mm = 0, turn_deg = 0;
    std::vector<std::array<double, 3>> references_mm, turns_deg;
  } carrier;
  Placing morning;  // "bar", "sphere38", "sphere50", "flat": all at once, for the daily check
  double flat_width_mm = 0, flat_height_mm = 0;  // of the flat, which is smaller than the board
  double cylinder_length_mm;

  /// Width of the coded part of the grating: stripes times stripe width.
  double grating_width_mm() const { return grating.code.stripes() * grating.code.stripe_width(); }
};

/// name: a preset of this program, or a file. Throws InputError naming the key that is wrong.
Preset read_preset(const std::string& name);
/// The text of a built-in preset, to start one's own from.
std::string built_in_preset_text();

}  // namespace fringecal::virt

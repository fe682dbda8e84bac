// The paper's parameters estimated the paper's way: a reference board moved by known steps along its normal. [Chen2008]
//
// R is the board's face in the reference capture, Z = 0; in capture k it stands at Z_k. A corner is read as pixel p, phase
// phi_obj, and phi_ref, what the reference capture's phase map has at p. With P(q; p, phi_obj, phi_ref) the closed form
// (model/chen2008.h, eqs. 1 to 20), minimised is the sum of whitened squares of
//   r = P(q; T p, phi_obj - o_k, phi_ref - o_0 - phi_h) - (D (1 + s) (x + ex, y + ey) + (x0, y0) + Z a, Z + h(x, y)),
//   Z = Z_k + z_k                                                                                              (1)
// over q = L, b, alpha, p_R, phi_O, kc1, kc2, kp1, kp2 and, as nuisance: the image's turn T about its centre (the paper's
// camera has none), the board's place D, x0, y0, and with their standard uncertainties as priors the stage's squareness
// a = (ax, ay), the steps' errors z_k, the phase offsets o_k of the captures, the board's scale s, bow h (bundle.h, eq. 1)
// and printing errors e, and the errors of the reference phase map, which readings have in common. phi_h takes the bow off the reference phase, 2 pi b h_R / (p_R (L - h_R)), h_R the bow where p
// meets R.
// Held, as known from the camera's own calibration (Tsai's, in the paper): f_C, i_C, j_C and the pixel's side s.
// Whitened with the uncertainties of p (in the board's plane: phases are read at p, wherever p is), phi_obj and phi_ref.
// Gauss-Newton, derivatives numeric. The covariance is that of (1); what the closed form cannot follow in a geometry that is
// not the paper's is not in it: rms_xyz_mm shows that.
// The same parameters computed from a full model: (1) fitted to what that model says the same captures hold, without noise.
// Both have the closed form's misfit in common, so that their difference is explained by the two covariances.
// mm, rad, px; frame world of chen2008.h. No result: fewer than three steps, fewer than 40 readings, no convergence.
#pragma once

#include "calib/board_detection.h"
#include "calib/model/chen2008.h"

#include <array>

namespace fringecal::calib {

/// One corner at one step. Phases absolute.
struct SteppedReading {
  int step = 0, column = 0, row = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double phi_obj = 0, phi_ref = 0;
  // What phi_ref errs in common with the other readings': times numbers of standard deviation 1, the same for all
  // (reference_phase.h). Empty: its error is its own, phase_rad.
  Eigen::VectorXd ref_error_rad = {};
};

/// Standard uncertainties of what enters (1).
struct SteppedUncertainty {
  double pixel_px = 0.03, phase_rad = 0.01;  // of each reading; phi_obj, and phi_ref where its error is its own
  double phase_offset_rad = 0.008;           // of o_k, all corners of a capture
  double step_mm = 0.002;                    // of z_k
  double square_rad = 2e-4;                  // of ax and ay: a stage set up with a square
  double bow_relative = 1e-3;                // of h's terms, of the field's diagonal (calibrate.h)
};

struct SteppedBoard {
  std::vector<double> z_mm;  // Z_k, towards the scanner; one of them 0: the reference
  std::vector<SteppedReading> readings;
  model::Board board;
  SteppedUncertainty u;
};

/// Captures of one board at known steps; the one at z = 0 is the reference. Corners outside the reference's phase are left
/// out. No result: no or several references, a capture without the board.
Result<SteppedBoard> observe_stepped_board(std::span<const std::filesystem::path> folders, std::span<const double> z_mm,
                                           const model::Board& board, const model::PhaseLinearisation* table = nullptr);

/// The uncertainties of a calibration's own readings.
SteppedUncertainty uncertainty_from(const model::Scanner& scanner);

inline constexpr std::array<const char*, 9> kSteppedNames = {
    "L_mm", "b_mm", "alpha_rad", "p_R_mm", "phi_O_rad", "kc1_per_mm2", "kc2_per_mm4", "kp1_per_mm2", "kp2_per_mm4"};

struct SteppedFit {
  model::Chen2008Model model;
  Eigen::Matrix<double, 9, 1> values;      // as kSteppedNames
  Eigen::Matrix<double, 9, 9> covariance;  // of them
  Eigen::Vector3d rms_xyz_mm = Eigen::Vector3d::Zero();
  // World places of the readings at the nominal steps: on the board as fitted, and on a flat one without errors.
  std::vector<Eigen::Vector3d> places_mm, nominal_places_mm;
  int iterations = 0;
};

/// start: f_C, i_C, j_C and s are held at its values.
Result<SteppedFit> fit_stepped_board(const SteppedBoard& stepped, const model::Chen2008Model& start);

/// Estimated directly, computed from the full model, and what the difference is uncertain by (both covariances).
struct SteppedComparison {
  SteppedFit direct, computed;
  Eigen::Matrix<double, 9, 1> difference, u_difference;
};
Result<SteppedComparison> compare_stepped_board(const SteppedBoard& stepped, const model::Scanner& scanner);

}  // namespace fringecal::calib

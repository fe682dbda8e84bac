// The paper's closed form: height and coordinates from phase, with ideal lenses (eqs. 1 to 17) and with the distortion
// of both (eqs. 18 to 20). For comparison with the full ray model, and for printing the paper's own parameters.
//
// Frame `world` (scanner.h). i is the row, j the column, s the pixel's side. phi_ref(i, j): the absolute phase that the
// pixel sees on R. With X_A(phi) = p_R (phi - phi_O) / 2 pi (6):
//   S = p_R (phi_obj - phi_ref) / 2 pi (5);  Z = L S / (b + S) (1, 2)
//   beta = atan((j_C - j) s / f_C) (14);  d_Y = L s cos(beta) / (f_C cos(alpha + beta)) (13)
//   Y_E = d_Y (i_C - i) (16);  X = X_A (1 - Z/L) (8);  Y = Y_E (1 - Z/L) (17)
// Distortion: (i', j') from (18) replaces (i, j) in 14 and 16; X_A' = X_A + dX_A (19, 20) replaces X_A.
// Reading: as printed, (19) corrects X_A in (8) only. The shift S on R is a difference of two such X; with a distorted
// projector eq. 5 holds only for the corrected positions, so here S = X_A'(phi_obj) - X_A'(phi_ref). As printed, Z
// would keep the whole error that it has without (18) to (20): in the paper's geometry with the default instrument's
// lenses, parameters fitted, 0.20 mm rms over 160 mm of depth, against 0.0004 mm here. Our Y_A in (19) is the Y of the
// lit ray on R, which for Z = 0 is Y_E (16). Valid where the paper's assumptions are: projector axis and base line as
// in its Fig. 1; what the real geometry departs from that is not in the formulas, and the comparison shows what it
// costs. Two sets of parameters: geometric (chen2008_from), and fitted over a working volume (calib/fit_chen2008.h),
// which the Scanner file keeps: the closed form at its best on a geometry that is not quite the paper's. [Chen2008]
#pragma once

#include "core/fields.h"
#include "core/image.h"
#include "core/pattern_plan.h"
#include "core/value.h"

#include <Eigen/Core>

#include <optional>

namespace fringecal::model {

struct Scanner;

struct Chen2008Model {
  CodeAxis axis = CodeAxis::x;
  double L_mm = 0, b_mm = 0, alpha_rad = 0;
  double p_R_mm = 0, phi_O_rad = 0;
  double f_C_mm = 0, s_mm = 0, i_C_px = 0, j_C_px = 0;
  double kc1_per_mm2 = 0, kc2_per_mm4 = 0;  // eq. 18, r in mm on the sensor, measured -> ideal
  double kp1_per_mm2 = 0, kp2_per_mm4 = 0;  // eq. 19, on R, measured -> ideal

  /// World coordinates of pixel (x = column j, y = row i) with absolute phase phi_obj, given phi_ref there.
  /// with_distortion false: eqs. 1 to 17 alone. Empty where b and b + S differ in sign (the rays do not meet in front
  /// of the base line); a camera at -X has b < 0.
  std::optional<Eigen::Vector3d> point_mm(const Eigen::Vector2d& pixel, double phi_obj, double phi_ref,
                                          bool with_distortion) const;
};

/// The paper's parameters of a full model. The polynomial coefficients of eqs. 18 and 19 act in the other direction
/// than ours; they are least-squares fits of the two-term polynomial over the field (image for the camera, R for the
/// projector), because an exact inverse of a two-term polynomial is not one. Needs Camera::pixel_mm (else 1 px is taken
/// as unit of s).
Chen2008Model chen2008_from(const Scanner& scanner);

/// Parameters found by least squares over a working volume, and how well the closed form then reproduces it.
struct FittedChen2008 {
  Chen2008Model model;
  double z_min_mm = 0, z_max_mm = 0;  // the volume: what camera and grating both see between these heights
  Eigen::Vector3d rms_xyz_mm = Eigen::Vector3d::Zero();  // closed form minus full model, in world
  double max_mm = 0;                                     // largest distance between the two
  int samples = 0;

  double rms_mm() const { return rms_xyz_mm.norm(); }
};
Value to_value(const FittedChen2008& fitted);
/// The code axis is not in the table: it is the scanner's main axis.
FittedChen2008 fitted_chen2008_from(Fields fields, CodeAxis axis);

/// phi_ref(i, j): the absolute phase that each pixel sees on the plane Z = 0 of `world`, from the full model. Pixels
/// that do not see R hold NaN.
Image<double> reference_phase(const Scanner& scanner);

}  // namespace fringecal::model

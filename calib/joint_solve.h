// The least-squares problem of calibrate.h on plain data (bundle.h). Camera alone, or camera and projector together.
//
// Minimised is
//   sum |camera residual|^2 / (s_c u_pixel)^2 + sum (projector residual)^2 / (s_p u)^2
//     + |(ex, ey)|^2 / s_e^2 + ez^2 / s_z^2 + |o|^2 / s_o^2 + |c|^2 / s_b^2 + priors                           (1)
// Readings of one capture err together: the mean error of its phase steps (slide, flicker, drift) shifts every u of it by
// the same o_j, and a board that is held differently is bent differently (c_j). Taken for independent noise of the corners
// they would be averaged away over the corners, and the covariance would promise what only more captures can give. So they
// are unknowns of each capture, with a standard deviation common to all captures; so are the printing errors
// and heights e of the corners, one place for all poses. The scales and standard deviations are not known beforehand; they are estimated with
// the rest as variance components,
//   s^2 <- s^2 chi2_group / r_group,   r = n - sum of leverages (readings), n - sum posterior / prior variance   (2)
// until they stay. [Foerstner1979] The covariance of the result is that of eq. 1 with these components, those of captures
// and corners times r / (r - 2), because what is estimated from r degrees of freedom is known no better [JCGM101, 6.4.9.2].
// A Cauchy loss first; corners beyond 4 standard deviations in a component (each judged by its own: the scatter times
// sqrt(1 - leverage)) are left out; then the clean problem. The solution is taken only if what is left of a Newton step
// is below 1e-3 standard uncertainties:
//   g^T N^-1 g < 1e-6                                                                                          (3)
// Errors that the model lacks (a board that creases when it is moved, a camera that shifts in its mount) show as parameters
// that scatter more from pose to pose than the covariance C allows. With C_J the jackknife over poses,
//   F = mean of C_J,kk / C_kk over the parameters                                                              (4)
// Beyond what a model that is true gives in one case of a thousand (its expectation and its degrees of freedom:
// bundle_system.h, eqs. 4 and 5) C is multiplied by F (n - 1) / (n - 3): the second factor because n poses know their own
// scatter badly [JCGM101, 6.4.9.2].
// The place t of a one-axis projector along the fringes enters through its distortion only, as products of t with k1 and
// k2, which are hardly known better: along t the solution curves by a good part of the others' standard deviations, and
// off the level there is information on k2 that is absent on it. So C is not taken linear along t. With the solutions at
// t_i = t + z_i u(t), z = 0, +-sqrt(3), all else free, d_i how far they are from the solution, C(t_i) their covariance with
// t held, and Q_i their eq. 1,
//   C = C(t*) + sum w_i d_i d_i^T / sum w_i,   w_i = (2/3, 1/6, 1/6) exp((z_i^2 - (Q_i - Q_0)) / 2) |C(t_i)|^(1/2)   (6)
// a Gauss-Hermite sum over t, the others integrated out. C(t*) is the largest of the C(t_i): what is known only if the projector stood off the level
// is not counted. Without curvature (6) is the linear C.
#pragma once

#include "calib/bundle_system.h"

namespace fringecal::calib {

/// What happens to sights that do not fit.
enum class Outliers { reject, keep };
/// Whether the covariance is held against the scatter from pose to pose, eq. 4.
enum class PoseCheck { no, yes };

struct SolveSettings {
  FreeTerms free = {};
  Outliers outliers = Outliers::reject;
  PoseCheck pose_check = PoseCheck::no;
  // Starts of the standard deviations of eq. 1 and values of the priors; 0 leaves a quantity at its nominal value.
  Components components = {};
  // The components are as they stand, and no sight is rejected (comparing models on the same footing).
  bool fixed_components = false;
};

struct SolveReport {
  model::ParameterCovariance covariance;        // camera, projector, proj_from_cam
  Components components;                        // as estimated
  double chi2 = 0;                              // eq. 1 at the solution, priors included
  double chi2_per_dof = 0;                      // of the readings, with the components as estimated
  int parameters = 0, residuals = 0;            // without what priors or components hold
  double camera_rms_px = 0, projector_rms = 0;  // over the corners used; per coordinate; main axis
  double flat_rms = 0;                          // of the readings on flats
  int n_rejected = 0, iterations = 0;
  double newton_decrement = 0;                      // square root of eq. 3
  double pose_scatter = 0, pose_scatter_limit = 0;  // F of eq. 4 and what it may be; 0: not asked for, too few poses
  double widened = 1;                               // factor on all standard uncertainties, eq. 4
};

/// No result where the problem is singular, does not converge, or gives anything that is not finite.
Result<SolveReport> solve_bundle(Bundle& bundle, const SolveSettings& settings);

/// Number of distortion coefficients of a set: 0, 2, 4, 5.
int term_count(DistortionTerms terms);
/// "none", "radial", "radial+tangential", "full", "auto": as the command line has it.
const char* name_of(DistortionTerms terms);

}  // namespace fringecal::calib

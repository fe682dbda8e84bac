// The paper's closed form at its best: its parameters estimated so that it reproduces known points over a working
// volume, as its user would with a reference board moved by known steps.
//
// Samples: a grid of pixels over the image times planes of constant Z; where the grating covers the point, the full
// model gives (pixel, phi_obj, phi_ref; P), phi_ref being the phase that the pixel sees on Z = 0. Minimised is
//   1/n sum |P_closed(q; pixel, phi_obj, phi_ref) - P|^2 + lambda^2 sum ((q_k - q_k0) / s_k)^2,  lambda = 1e-4 mm (1)
// over q = L, b, alpha, p_R, phi_O, f_C, i_C, j_C and, with eqs. 18 to 20, kc1, kc2, kp1, kp2; q_0 is the geometric set
// (chen2008_from), s_k about what a real geometry departs from the paper's: 1 % of a length, 10 mrad, 1 rad of phi_O,
// 10 px; 1 % of displacement at the field's edge for each k.
// Identifiability: without distortion eq. 13 is d_Y = L s / (A + B j), A = f_C cos(alpha) - j_C s sin(alpha),
// B = s sin(alpha): f_C, alpha, j_C are three for two, and only the damping term holds them, near the geometric set.
// With distortion its centre determines j_C. Elsewhere the damping costs next to nothing: by (1) the rms is at most
// lambda |(q* - q_0) / s| above that of the undamped minimum q*.
// What no parameter takes up stays in the residual: a roll of the camera about its axis (Y sheared by roll times X) and
// a pupil off along the fringes. Frame `world`, mm. Why geometric parameters are not enough: on a projector axis tilted
// by 0.4 deg the camera's pupil is 2 mm off the height L that the closed form takes for both pupils: 0.2 % of scale.
// [Chen2008]
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"

namespace fringecal::calib {

enum class PaperEquations {
  to_17,  // ideal lenses: kc1 = kc2 = kp1 = kp2 = 0
  to_20,  // distortion of both lenses
};

struct WorkingVolume {
  double z_min_mm = -80, z_max_mm = 80;  // the paper's instrument: about a sixth of L
};

/// Heights between which the scanner's boards were seen.
WorkingVolume board_extent(const model::Scanner& scanner);

/// No result where fewer than 100 samples are seen and lit, the volume is thinner than 1 % of L, or the closed form
/// does not describe such a geometry (no base line across the fringes, no convergence).
Result<model::FittedChen2008> fit_chen2008(const model::Scanner& full, const WorkingVolume& volume,
                                           PaperEquations equations);

/// The scanner with paper_model and paper_ideal_model fitted over board_extent().
Result<model::Scanner> with_paper_models(model::Scanner scanner);

}  // namespace fringecal::calib

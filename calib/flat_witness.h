// The flat witness: a flat plate that fills the field, beside the board, in the joint solve.
//
// Corners of a board tell lengths, but each by a few pixels, with its printing error, and hundreds of them must share the
// lenses' distortion. A plate tells no length; that its points lie in one plane (bundle.h, eq. 2) is told by every pixel:
// a bend of the measured space, which corners leave open by some ten micrometres, shows against it to less than one. A
// view is the fringes' coordinate u at a grid of pixels,
//   u at pixels (i step, j step), each from a local fit over one period (board_detection.h),                       (1)
// and has the plate's attitude and distance, and its own phase offset, as unknowns. How flat the plate is has a standard
// uncertainty: of each term of its bow over h, the same in all views. At least two views at different heights or tilts
// say more than many of one. px, the code's unit, mm, frame cam. The plate must fill the field: what lies beside it is
// left out as an outlier only where it is small.
#pragma once

#include "calib/bundle.h"
#include "calib/model/phase_linearisation.h"
#include "calib/model/scanner.h"
#include "core/capture.h"
#include "core/result.h"

#include <span>
#include <string>

namespace fringecal::calib {

/// u of a term of the bow where the flat's certified flatness F is its largest possible size: F / sqrt 3.     [GUM, 4.3.7]
double u_flatness_mm(double certified_flatness_mm);

/// Eq. 1. The cells' column and row count the grid's places; they have no u_pixel. No result: too few pixels can be read.
Result<model::BoardObservation> observe_flat(const Capture& capture, const std::string& name,
                                             const model::PhaseLinearisation* table = nullptr);

/// Appends the views to a bundle whose camera and projector have a start, each where a plane through its points lies.
/// No result: points that are no plane, with the view's name.
Result<void> add_flats(Bundle& bundle, std::span<const model::BoardObservation> flats);

}  // namespace fringecal::calib

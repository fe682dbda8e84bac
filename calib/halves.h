// Cross-validation: the calibration again on each half of its poses.
//
// Poses 1, 3, 5 .. and 2, 4, 6 .. of the Scanner's own observations (all corners, rejected ones too), and so the views of its
// flat, the same terms, each solved as calibrate() does. What the halves disagree about in the volume, beside what their covariances allow, is
// metrology/compare_scanners.h: the found and the predicted difference. Bias that all poses share (a wrong pitch) is in both
// halves and does not show. No result: a Scanner without observations, fewer than six poses, a half that cannot be solved.
#pragma once

#include "calib/calibrate.h"

#include <utility>

namespace fringecal::calib {

Result<std::pair<model::Scanner, model::Scanner>> solve_halves(const model::Scanner& scanner);

/// The set of terms that a distortion has values of.
DistortionTerms terms_of(const model::Distortion& distortion);

}  // namespace fringecal::calib

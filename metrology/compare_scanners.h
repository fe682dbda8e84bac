// What two calibrations of one scanner disagree about in the working volume, beside what their uncertainties allow: the
// drift check of a periodic verification.
//
// Samples: a grid of pixels times heights Z of A's world. With (pixel, u) what scanner A measures at its point P_A there,
// and P_B what scanner B makes of the same pixel and u,
//   d_i = T P_B,i - P_A,i                                                                                       (1)
// T the rigid motion that brings all P_B closest to the P_A (least squares): each calibration defines its own world, and
// the place of a world is no property of the measuring. What is left is what lengths and forms would differ by.
//   U_i = J_A,i C_A J_A,i^T + J_B,i C_B J_B,i^T,  J = dd/d(parameters), the motion T adapted                     (2)
// C the scanners' covariances, taken as independent (two calibrations that share a board share its pitch: what they have
// in common makes (2) too large, never too small). Numeric central differences at one standard uncertainty. mm.
// The mean square of all d_i beside what (2) expects is a quadratic form of some normal errors. With U of all points at
// once its distribution is near that of chi^2 over nu degrees of freedom, the number of independent ways to differ, of
// equal first two moments [Box1954, theorem 3.1]:
//   nu = (tr U)^2 / tr U^2                                                                                      (3)
//   limit of rms / expected rms = sqrt(chi^2_0.99(nu) / nu)                                                     (4)
// One or two ways far outweigh the others: halves of a dozen poses have nu of 1.3, and 2.4 for the limit.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"
#include "core/value.h"
#include "metrology/volume.h"

#include <vector>

namespace fringecal::metrology {

using CompareOptions = VolumeGrid;  // heights in A's world

struct ComparedPoint {
  Eigen::Vector3d point_mm, difference_mm;  // P_A, eq. 1
  Eigen::Vector3d u_mm;                     // square roots of the diagonal of eq. 2
};

struct ScannerComparison {
  std::vector<ComparedPoint> points;
  double rms_mm = 0, max_mm = 0;  // of |d|
  double allowed_rms_mm = 0;      // what eq. 2 expects rms_mm to be
  double ratio = 0;               // rms_mm / allowed_rms_mm
  double ways = 0;                // nu, eq. 3
  double limit = 0;               // of the ratio, eq. 4
};

/// The points of one height of A's world, mm.
struct ComparedHeight {
  double z_mm = 0;
  int points = 0;
  double rms_mm = 0, allowed_rms_mm = 0;  // as in ScannerComparison, of these points
  ComparedPoint worst;                    // the largest |d|
};

/// No result: different codes or image sizes, no covariance, fewer than 20 points that both see.
Result<ScannerComparison> compare_scanners(const model::Scanner& a, const model::Scanner& b,
                                           const CompareOptions& options = {});

/// Lowest height first.
std::vector<ComparedHeight> by_height(const ScannerComparison& comparison);

/// One sentence: whether the two agree within their uncertainties. A ratio above the limit is called a disagreement: of
/// calibrations that differ by chance alone one pair in a hundred.
std::string verdict_of(const ScannerComparison& comparison);
Value to_value(const ScannerComparison& comparison);

}  // namespace fringecal::metrology

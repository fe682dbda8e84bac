// What the calibration's uncertainty does to a quantity computed from points (a diameter, a distance, a flatness).
//
// The calibration is one shared error of all points: it does not average out, and must not be treated as noise of each
// point. With y(theta) the quantity as a function of the Scanner's parameters and C their covariance,
//   u_cal^2(y) = g^T C g,   g_i = [y(theta + s_i e_i) - y(theta - s_i e_i)] / (2 s_i),  s_i = u(theta_i)      (1)
//   [GUM, 5.2.2]
// where every point keeps what was measured (its pixel and its projector coordinate) and is triangulated anew through
// the changed scanner. Central differences at one standard uncertainty: the curvature over that range is what the
// first-order GUM formula neglects anyway. Points in `world`, mm. Where the Scanner has no covariance, or y cannot be
// computed for a changed scanner: no result.
#pragma once

#include "calib/model/scanner.h"
#include "core/result.h"

#include <functional>
#include <span>
#include <vector>

namespace fringecal::metrology {

using PointFunction = std::function<Result<double>(std::span<const Eigen::Vector3d> points_mm)>;

/// The points as a scanner with changed parameters would have given them from the same pixels and phases. Points that
/// the changed model cannot reach are left out.
std::vector<Eigen::Vector3d> retriangulate(std::span<const Eigen::Vector3d> points_mm, const model::Scanner& scanner,
                                           const model::Scanner& changed);

/// Eq. 1 for several quantities at once, of points in groups that they must tell apart: features, views. Points that are left out
/// leave their own group.
using PointGroups = std::vector<std::vector<Eigen::Vector3d>>;
using GroupsFunction = std::function<Result<std::vector<double>>(const PointGroups& groups_mm)>;
Result<std::vector<double>> u_from_calibration_of_groups(const PointGroups& groups_mm, const model::Scanner& scanner,
                                                         const GroupsFunction& quantities);

/// What the mean error of one capture's phase steps makes of them: a shift o of u, the same for all points of the capture and new in
/// the next, with the standard deviation that the calibration's own captures had (the Scanner's prior capture.phase_offset):
///   u_capture^2(y) = sum_c ([y(u0 + o in c) - y(u0 - o in c)] / 2)^2,   u0 of the projector, which shifts u as well   (2)
/// over the captures c that y is made from: the shift of one says nothing of the next one's, so that their parts are independent.
/// capture_of_group: which capture each group is of, 0, 1, ...; empty: all of one. Zeros where the Scanner states no such prior.
Result<std::vector<double>> u_from_phase_offset(const PointGroups& groups_mm, const model::Scanner& scanner,
                                                const GroupsFunction& quantities,
                                                std::span<const int> capture_of_group = {});

/// Eq. 1, in the unit of the quantity.
Result<double> u_from_calibration(std::span<const Eigen::Vector3d> points_mm, const model::Scanner& scanner,
                                  const PointFunction& quantity);

}  // namespace fringecal::metrology

// Which measured sphere is which of a plate: the order of the measured centres whose mutual distances are nearest to the
// certified ones.
//   min over orders P of  sum over i < j of  (|m_P(i) - m_P(j)| - |c_i - c_j|)^2,  every difference within match_mm      (1)
// Found by trying one sphere after the other and giving up where a difference is beyond match_mm. Distances do not change with a
// mirror image or where the plate is congruent to itself; then the best of the equal orders is as good as any other.
// No order within match_mm, or fewer centres than certified: no result. mm.
#pragma once

#include "core/result.h"

#include <Eigen/Core>

#include <span>
#include <vector>

namespace fringecal::metrology {

/// Of each certified centre the index of its measured one.
Result<std::vector<std::size_t>> match_centres(std::span<const Eigen::Vector3d> measured_mm,
                                               std::span<const Eigen::Vector3d> certified_mm, double match_mm = 0.5);

}  // namespace fringecal::metrology

// Segments of a point cloud: the connected pieces that the camera saw. Two points belong together when their pixels
// touch (four neighbours) and they are closer than max_gap_mm. Deterministic: segments by falling size, points
// row-major.
#pragma once

#include "metrology/point_cloud.h"

#include <cstddef>
#include <vector>

namespace fringecal::metrology {

/// Indices into cloud.points; segments with fewer than min_points are left out.
std::vector<std::vector<std::size_t>> segments_of(const PointCloud& cloud, double max_gap_mm, std::size_t min_points);

}  // namespace fringecal::metrology

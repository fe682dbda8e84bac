#include "metrology/segment.h"

#include "core/image.h"

#include <algorithm>
#include <cstdint>
#include <numeric>

namespace fringecal::metrology {

std::vector<std::vector<std::size_t>> segments_of(const PointCloud& cloud, double max_gap_mm, std::size_t min_points) {
  int width = 0, height = 0;
  for (const auto& p : cloud.points) {
    width = std::max(width, p.pixel_x + 1);
    height = std::max(height, p.pixel_y + 1);
  }
  constexpr std::int64_t kNone = -1;
  Image<std::int64_t> at(width, height, kNone);
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    at(cloud.points[i].pixel_x, cloud.points[i].pixel_y) = static_cast<std::int64_t>(i);
  }
  // Union-find over the pixel grid; the root is the smallest index, so the result does not depend on the order of
  // unions.
  std::vector<std::size_t> parent(cloud.points.size());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto root = [&](std::size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  const auto join = [&](std::int64_t a, std::int64_t b) {
    if (a == kNone || b == kNone) return;
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    const double gap2 = (cloud.points[i].position_mm - cloud.points[j].position_mm).squaredNorm();
    if (!(gap2 <= max_gap_mm * max_gap_mm)) return;
    const std::size_t ri = root(i), rj = root(j);
    if (ri != rj) parent[std::max(ri, rj)] = std::min(ri, rj);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (x + 1 < width) join(at(x, y), at(x + 1, y));
      if (y + 1 < height) join(at(x, y), at(x, y + 1));
    }
  }
  std::vector<std::vector<std::size_t>> by_root(cloud.points.size());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (at(x, y) != kNone)
        by_root[root(static_cast<std::size_t>(at(x, y)))].push_back(static_cast<std::size_t>(at(x, y)));
    }
  }
  std::vector<std::vector<std::size_t>> out;
  for (auto& segment : by_root) {
    if (segment.size() >= min_points) out.push_back(std::move(segment));
  }
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return a.size() > b.size(); });
  return out;
}

}  // namespace fringecal::metrology

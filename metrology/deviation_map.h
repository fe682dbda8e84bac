// A cloud against the surface that it should be: every point's signed distance, and the map of it as seen from four sides.
//
// The surface is a function d of a point of its own frame `body`: its distance from the surface, positive outside. Where the
// cloud's frame `part` lies in `body` is found from a start by
//   min over T of  sum w d(T p)^2,  w Tukey's weight of d / s, s the robust standard deviation of d              (1)
// over at most `samples` of the points, Gauss-Newton with the gradient of d by central differences over 10 um. The start must
// be right within the surface's own features (some mm). The deviation of a point is then d(T p).
// A cell of a map is the mean of the points that fall into it and whose normals stand within 75 degrees of the viewer; cells
// of fewer than three such points have no value (NaN).
// mm. Fewer than 100 points within max_distance_mm of the surface: no result.
#pragma once

#include "core/image.h"
#include "core/result.h"
#include "core/rigid.h"
#include "metrology/point_cloud.h"

#include <functional>
#include <string>
#include <vector>

namespace fringecal::metrology {

using SignedDistance = std::function<double(const Eigen::Vector3d& in_body_mm)>;

struct DeviationOptions {
  std::size_t samples = 20'000;
  double max_distance_mm = 5;  // points farther off belong to something else: posts, a table
  int max_iterations = 30;
};

struct DeviationMap {
  Rigid3 body_from_part;
  std::vector<float> deviation_mm;  // of each point, in the cloud's order
  // Of the points within max_distance_mm: how many, and their figures; the widths hold 95 and 99.7 % of them about zero.
  std::size_t n_points = 0, n_beyond = 0;
  double mean_mm = 0, sd_mm = 0, width_95_mm = 0, width_997_mm = 0;
  int iterations = 0;
};

Result<DeviationMap> deviation_map(const PointCloud& cloud, const SignedDistance& surface, const Rigid3& start,
                                   const DeviationOptions& options = {});

/// One side of the body: columns along the viewer's right, rows downwards (body y is up), cells of cell_mm.
struct DeviationView {
  std::string name;  // "from the front (+z)"
  Image<float> mean_mm;
  double left_mm = 0, top_mm = 0, cell_mm = 0;  // of the middle of the first cell; rightwards grows, downwards falls
  double sd_mm = 0;                             // of the cells' values: what averaging does not remove
};
/// From +z, +x, -z and -x of `body`.
std::vector<DeviationView> views_of(const PointCloud& cloud, const DeviationMap& map, double cell_mm);

}  // namespace fringecal::metrology

#include "fitting/hypotheses.h"

#include "core/error.h"
#include "core/statistics.h"
#include "fitting/least_squares.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Orthogonal_k_neighbor_search.h>
#include <CGAL/Random.h>
#include <CGAL/Search_traits_3.h>
#include <CGAL/Search_traits_adapter.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/property_map.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

namespace fringecal::fitting {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Indexed = std::pair<Kernel::Point_3, std::size_t>;
using SearchTraits =
    CGAL::Search_traits_adapter<Indexed, CGAL::First_of_pair_property_map<Indexed>, CGAL::Search_traits_3<Kernel>>;
using Search = CGAL::Orthogonal_k_neighbor_search<SearchTraits>;

// With its index: the search reorders its input, and its indices are those of the new order.
using WithNormal = std::tuple<Kernel::Point_3, Kernel::Vector_3, std::size_t>;
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, std::vector<WithNormal>,
                                                              CGAL::Nth_of_tuple_property_map<0, WithNormal>,
                                                              CGAL::Nth_of_tuple_property_map<1, WithNormal>>;
using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;

/// The plane of least median distance from the neighbours: that median, and the distance of the point itself.
struct LocalPlane {
  double median = std::numeric_limits<double>::infinity(), own = 0;
};
LocalPlane least_median_plane(const Eigen::Vector3d& point, std::span<const Eigen::Vector3d> neighbours) {
  constexpr std::size_t kTriples =
      16;  // with half of the neighbours off the surface, one is on it with 1 - (7/8)^16 = 88 %
  const std::size_t n = neighbours.size();
  LocalPlane best;
  std::array<double, Neighbourhood::kCount> sizes;
  for (std::size_t t = 0; t < kTriples; ++t) {
    // each turns through the order of distances: near, middle and far ones
    const Eigen::Vector3d &a = neighbours[t % n], &b = neighbours[(t + 5) % n], &c = neighbours[(t + 11) % n];
    const Eigen::Vector3d across = (b - a).cross(c - a);
    const double size = across.norm();
    if (!(size > 1e-6 * (b - a).norm() * (c - a).norm())) continue;
    const Eigen::Vector3d normal = across / size;
    for (std::size_t i = 0; i < n; ++i) sizes[i] = std::abs(normal.dot(neighbours[i] - a));
    std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(n / 2),
                     sizes.begin() + static_cast<std::ptrdiff_t>(n));
    if (sizes[n / 2] < best.median) best = {sizes[n / 2], std::abs(normal.dot(point - a))};
  }
  return best;
}

/// Neighbourhood::on_surface.
std::vector<bool> on_surfaces(Points points_mm, const Neighbourhood& hood) {
  constexpr std::size_t kCount = Neighbourhood::kCount;
  const std::size_t n = points_mm.size();
  std::vector<bool> flat(n), out(n);
  std::vector<Eigen::Vector3d> neighbours(kCount);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < kCount; ++k) neighbours[k] = points_mm[hood.neighbours[i * kCount + k]];
    const double reach_mm = (neighbours.back() - points_mm[i]).norm();
    const LocalPlane plane = least_median_plane(points_mm[i], neighbours);
    const double s = 1.4826 * plane.median;
    flat[i] = s <= std::max(0.1 * reach_mm, 3.0 * hood.noise_mm) && plane.own <= 3.5 * std::max(s, hood.noise_mm);
  }
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < kCount; ++k) count += flat[hood.neighbours[i * kCount + k]] ? 1u : 0u;
    out[i] = flat[i] && 2 * count >= kCount;
  }
  return out;
}

}  // namespace

Neighbourhood neighbourhood_of(Points points_mm) {
  constexpr std::size_t kSpacing = 4;  // the median of the nearest alone is small where points come in lines
  require(points_mm.size() > Neighbourhood::kCount, "neighbourhood_of() is given more points than a neighbourhood has");
  std::vector<Indexed> points;
  points.reserve(points_mm.size());
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    points.emplace_back(Kernel::Point_3(points_mm[i].x(), points_mm[i].y(), points_mm[i].z()), i);
  }
  Search::Tree tree(points.begin(), points.end());
  Neighbourhood out;
  std::vector<double> spacings, scatters;
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    Search search(tree, Kernel::Point_3(points_mm[i].x(), points_mm[i].y(), points_mm[i].z()),
                  Neighbourhood::kCount + 1);
    std::vector<std::pair<double, std::size_t>> near;
    for (const auto& found : search) {
      if (found.first.second != i) near.emplace_back(found.second, found.first.second);
    }
    std::sort(near.begin(), near.end());
    near.resize(Neighbourhood::kCount);  // a point that coincides with kCount others is not among its neighbours
    std::vector<Eigen::Vector3d> local = {points_mm[i]};
    for (const auto& [distance2, index] : near) {
      out.neighbours.push_back(index);
      local.push_back(points_mm[index]);
    }
    spacings.push_back(std::sqrt(near[kSpacing - 1].first));
    const CentredPoints centre = centred(local, {}, local.size());
    out.normals.push_back(centre.axes.vectors.col(0));
    scatters.push_back(std::sqrt(centre.plane_f() / static_cast<double>(local.size() - 3)));
  }
  out.spacing_mm = median(spacings);
  // The lower fifth: stray points among the neighbours spoil many. Of a chi distribution with 14 degrees of freedom it is
  // 0.83 of the standard deviation.
  std::sort(scatters.begin(), scatters.end());
  out.noise_mm = scatters[scatters.size() / 5] / 0.83;
  out.on_surface = on_surfaces(points_mm, out);
  return out;
}

std::vector<Hypothesis> hypotheses_of(Points points_mm, const Neighbourhood& neighbourhood,
                                      const HypothesisOptions& options) {
  std::vector<WithNormal> points;
  points.reserve(points_mm.size());
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    const Eigen::Vector3d &p = points_mm[i], &n = neighbourhood.normals[i];
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), Kernel::Vector_3(n.x(), n.y(), n.z()), i);
  }
  CGAL::get_default_random() = CGAL::Random(2634);
  Ransac ransac;
  ransac.set_input(points);
  ransac.add_shape_factory<CGAL::Shape_detection::Plane<Traits>>();
  ransac.add_shape_factory<CGAL::Shape_detection::Sphere<Traits>>();
  ransac.add_shape_factory<CGAL::Shape_detection::Cylinder<Traits>>();
  Ransac::Parameters parameters;
  parameters.probability = 0.001;
  parameters.min_points = options.min_points;
  parameters.epsilon = options.tolerance_mm;
  parameters.cluster_epsilon = options.gap_mm;
  parameters.normal_threshold = 0.85;
  ransac.detect(parameters);
  std::vector<Hypothesis> out;
  for (const auto& shape : ransac.shapes()) {
    Hypothesis hypothesis;
    if (dynamic_cast<CGAL::Shape_detection::Sphere<Traits>*>(shape.get())) {
      hypothesis.kind = ShapeKind::sphere;
    } else if (dynamic_cast<CGAL::Shape_detection::Cylinder<Traits>*>(shape.get())) {
      hypothesis.kind = ShapeKind::cylinder;
    }
    for (const std::size_t i : shape->indices_of_assigned_points()) hypothesis.points.push_back(std::get<2>(points[i]));
    std::sort(hypothesis.points.begin(), hypothesis.points.end());
    out.push_back(std::move(hypothesis));
  }
  return out;
}

}  // namespace fringecal::fitting

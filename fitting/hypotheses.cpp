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

#include <algorithm>
#include <utility>

namespace fringecal::fitting {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Indexed = std::pair<Kernel::Point_3, std::size_t>;
using SearchTraits =
    CGAL::Search_traits_adapter<Indexed, CGAL::First_of_pair_property_map<Indexed>, CGAL::Search_traits_3<Kernel>>;
using Search = CGAL::Orthogonal_k_neighbor_search<SearchTraits>;

using WithNormal = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, std::vector<WithNormal>,
                                                              CGAL::First_of_pair_property_map<WithNormal>,
                                                              CGAL::Second_of_pair_property_map<WithNormal>>;
using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;

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
  return out;
}

std::vector<Hypothesis> hypotheses_of(Points points_mm, const Neighbourhood& neighbourhood,
                                      const HypothesisOptions& options) {
  std::vector<WithNormal> points;
  points.reserve(points_mm.size());
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    const Eigen::Vector3d &p = points_mm[i], &n = neighbourhood.normals[i];
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), Kernel::Vector_3(n.x(), n.y(), n.z()));
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
    hypothesis.points = shape->indices_of_assigned_points();
    std::sort(hypothesis.points.begin(), hypothesis.points.end());
    out.push_back(std::move(hypothesis));
  }
  return out;
}

}  // namespace fringecal::fitting

// Where spheres, cylinders and planes may be in a raw cloud: CGAL's efficient RANSAC [Schnabel2007] over normals from
// neighbours. It gives the points of each hypothesis; the answer is a fit of ours (find.h). Fixed seed: the same points
// give the same hypotheses.
#pragma once

#include "fitting/any_shape.h"

#include <vector>

namespace fringecal::fitting {

struct Hypothesis {
  ShapeKind kind = ShapeKind::plane;
  std::vector<std::size_t> points;  // increasing
};

/// The neighbours of every point of a cloud, nearest first; the normal from them, and what the points scatter about it.
///
/// A point is on a surface where the plane of least median distance from its neighbours (through triples of them,
/// [Rousseeuw1984]) has s = 1.4826 median <= max(r / 10, 3 noise), r the distance of the farthest neighbour, is not
/// farther than 3.5 max(s, noise) from it, and half of its neighbours are so too: stray points are not, nor do they
/// make the points beside them so while more than half of the neighbours are the surface's.
struct Neighbourhood {
  static constexpr std::size_t kCount = 16;
  std::vector<std::size_t> neighbours;  // kCount per point, without itself
  std::vector<Eigen::Vector3d> normals;
  std::vector<bool> on_surface;
  double spacing_mm = 0;  // median distance of the nearest neighbour but three
  double noise_mm = 0;    // robust standard deviation from the local planes
};
/// More than kCount points.
Neighbourhood neighbourhood_of(Points points_mm);

struct HypothesisOptions {
  std::size_t min_points = 200;
  double tolerance_mm = 0;  // of a point from its shape
  double gap_mm = 0;        // points of a shape that are farther apart are two shapes
};
std::vector<Hypothesis> hypotheses_of(Points points_mm, const Neighbourhood& neighbourhood,
                                      const HypothesisOptions& options);

}  // namespace fringecal::fitting

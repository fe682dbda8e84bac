// What the benchmark compares with: the usual ways of others to fit a plane, sphere or cylinder to points.
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::bench {

using Cloud = std::vector<Eigen::Vector3d>;
enum class Shape { plane, sphere, cylinder };
inline const char* name_of(Shape shape) {
  return shape == Shape::plane ? "plane" : shape == Shape::sphere ? "sphere" : "cylinder";
}

/// Plane: a point, the normal. Sphere: the centre, the radius. Cylinder: a point of the axis, its direction, the radius.
struct Answer {
  Eigen::Vector3d place = Eigen::Vector3d::Zero(), direction = Eigen::Vector3d::UnitZ();
  double radius = 0;
};

/// Points with a noise of 0.03 mm on a plate of 400 x 300 mm, on the quarter of a sphere of 50 mm, on a sector of 115
/// degrees of a cylinder of 120 mm; 1 m from the origin.
Cloud points_of(Shape shape, std::size_t n);
/// The truth behind points_of(), off by 1 % of its size.
Answer disturbed(Shape shape);

struct Peer {
  std::string name;
  std::function<Answer(const Cloud&, const Answer& start)> fit;
  /// The time that a peer in a process of its own reports; then the time around the call means nothing.
  double* reported_ms = nullptr;
};
std::vector<Peer> peers(Shape shape, bool has_outliers);

/// Sentences about peers that are not installed here.
std::string peers_left_out();

}  // namespace fringecal::bench

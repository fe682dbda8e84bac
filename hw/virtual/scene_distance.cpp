#include "hw/virtual/scene_distance.h"

#include "hw/virtual/free_form.h"

#include <cmath>
#include <vector>

namespace fringecal::virt {
namespace {

constexpr double kNowhere = 1e6;  // mm: beside no object

using Distance = std::function<double(const Eigen::Vector3d&)>;

struct DistanceOf {
  Distance operator()(const FlatBoard& s) const {
    return [s](const Eigen::Vector3d& p) {
      return std::abs(p.x()) <= s.width_mm / 2 && std::abs(p.y()) <= s.height_mm / 2 ? p.z() : kNowhere;
    };
  }
  Distance operator()(const PatternBoard&) const {
    return [](const Eigen::Vector3d&) { return kNowhere; };
  }
  Distance operator()(const Sphere& s) const {
    return [r = s.diameter_mm / 2](const Eigen::Vector3d& p) { return p.norm() - r; };
  }
  Distance operator()(const Cylinder& s) const {
    return [s](const Eigen::Vector3d& p) {
      return std::abs(p.z()) <= s.length_mm / 2 ? std::hypot(p.x(), p.y()) - s.diameter_mm / 2 : kNowhere;
    };
  }
  Distance operator()(const FreeForm& s) const {
    const FreeFormSurface surface({s.length_mm / 2, s.height_mm / 2, s.depth_mm / 2}, s.relief,
                                  static_cast<std::uint64_t>(s.seed));
    return [surface](const Eigen::Vector3d& p) { return surface.distance_mm(p); };
  }
};

}  // namespace

std::function<double(const Eigen::Vector3d&)> distance_from(const Scene& scene) {
  struct One {
    Rigid3 part_from_world;
    Distance distance;
  };
  std::vector<One> all;
  for (const auto& object : scene.objects) {
    all.push_back({object.world_from_part.inverse(), std::visit(DistanceOf{}, object.shape)});
  }
  return [all](const Eigen::Vector3d& p) {
    double nearest = kNowhere;
    for (const auto& one : all) {
      const double d = one.distance(one.part_from_world * p);
      if (std::abs(d) < std::abs(nearest)) nearest = d;
    }
    return nearest;
  };
}

}  // namespace fringecal::virt

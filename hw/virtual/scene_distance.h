// How far a point is from the nearest surface of a scene: the truth that a measured cloud is held against.
//   sphere  |p| - r      cylinder  hypot(x, y) - r within its length      board  z within its rectangle
//   free form  f / |grad f|, f of free_form.h, eq. 1: exact to first order, d^2 / 2R off on a surface of radius R     (1)
// Positive outside; of a board on the side of its pose's z. Of several objects the nearest counts. Points that no object is
// beside: 1e6 mm. Printed boards are not part of it. mm, in the scene's frame.
#pragma once

#include "hw/virtual/scene.h"

#include <functional>

namespace fringecal::virt {

std::function<double(const Eigen::Vector3d&)> distance_from(const Scene& scene);

}  // namespace fringecal::virt

// Rays against the shapes of a scene.
//
// A ray is o + t d in the shape's frame `part`; the first t > t_min counts. Board: z = c (x^2 + y^2) within its
// rectangle (c = 0: flat); sphere x^2 + y^2 + z^2 = r^2; cylinder x^2 + y^2 = r^2, |z| < l / 2, closed by flat ends; free form: free_form.h.
#pragma once

#include "hw/virtual/free_form.h"
#include "hw/virtual/printed_board.h"

#include <optional>

namespace fringecal::virt {

struct Ray {
  Eigen::Vector3d origin, direction;
};

/// An object of a scene, made ready for rays.
class Solid {
 public:
  Solid(const SceneObject& object, const Preset& preset, std::uint64_t instrument_seed);

  /// t of the first hit with t > t_min.
  std::optional<double> hit(const Ray& ray_in_part, double t_min) const;
  /// Unit normal at a point of the surface: outwards; of a board, towards +z.
  Eigen::Vector3d normal(const Eigen::Vector3d& point) const;
  /// A sheet shows the viewer whichever face is turned to him.
  bool is_sheet() const { return kind_ == Kind::sheet; }
  /// A body that is not convex can stand in its own light.
  bool can_shade_itself() const { return kind_ == Kind::free_form; }
  /// Relative albedo of a point, texture included, print included.
  double albedo(const Eigen::Vector3d& point) const;
  double albedo_without_print(const Eigen::Vector3d& point) const;
  const std::optional<PrintedBoard>& print() const { return print_; }
  const Rigid3& world_from_part() const { return world_from_part_; }

 private:
  enum class Kind { sheet, sphere, cylinder, free_form };
  struct Wave {
    Eigen::Vector3d k;
    double phase;
  };

  Kind kind_ = Kind::sheet;
  Eigen::Vector2d half_ = Eigen::Vector2d::Zero();
  double curvature_ = 0, radius_ = 0, half_length_ = 0, albedo_ = 1, texture_ = 0;
  std::optional<PrintedBoard> print_;
  std::optional<FreeFormSurface> free_form_;
  std::vector<Wave> waves_;
  Rigid3 world_from_part_;
};

}  // namespace fringecal::virt

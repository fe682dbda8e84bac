// Scenes of the virtual scanner: shapes in the frame `world` of the preset (O on the reference plane R, X across the
// fringes, Y along them, Z towards the base line; mm).
#pragma once

#include "calib/model/board.h"
#include "core/fields.h"
#include "core/rigid.h"

#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace fringecal::virt {

/// A flat, white board, rectangular, its middle at the pose's origin, its normal the pose's z.
struct FlatBoard {
  double width_mm = 800, height_mm = 700;
};
/// A calibration board; the pose places the *middle* of its corner field; z of the pose points away from the face's
/// viewer or towards it, the face is printed on both sides. Printing errors and bow come from the instance's seed.
struct PatternBoard {
  model::Board board;
  double u_print_mm = 0.010;        // rms of each corner's error, x and y each
  double bow_mm = 0.15;             // height of the paraboloid at the corners of the field
  double pitch_error_relative = 0;  // true pitch = certified pitch (1 + this)
};
struct Sphere {
  double diameter_mm = 38;  // the true one
};
/// Axis along the pose's z, the middle at its origin, closed by flat ends.
struct Cylinder {
  double diameter_mm = 119.85, length_mm = 200;
};

/// A plaster model: hw/virtual/free_form.h. Height along the pose's y.
struct FreeForm {
  double length_mm = 320, height_mm = 250, depth_mm = 200;
  double relief = 0.12;
  int seed = 1;  // of its waves: the same body in every view
};

using Shape = std::variant<FlatBoard, PatternBoard, Sphere, Cylinder, FreeForm>;

struct SceneObject {
  std::string name;
  Shape shape;
  Rigid3 world_from_part;
  double albedo = 1.0;   // of the white board at the grating's calibration level
  double texture = 0.0;  // rms of a smooth albedo texture, relative
};

struct Scene {
  std::vector<SceneObject> objects;
};

/// TOML: [[objects]] name, kind = "flat" | "board" | "sphere" | "cylinder" | "free form", position_mm, rotation_deg (rotation
/// vector), and the shape's own keys.
Scene read_scene(const std::filesystem::path& file);
/// The same table out of another document: the key `scene` of a truth file.
Scene scene_from(Fields fields);
Value to_value(const Scene& scene);

}  // namespace fringecal::virt

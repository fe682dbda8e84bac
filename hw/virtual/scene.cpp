#include "hw/virtual/scene.h"

#include <fmt/format.h>

#include <numbers>

namespace fringecal::virt {
namespace {

double positive(Fields& f, const char* key) {
  const double value = f.number(key);
  if (!(value > 0)) f.complain(fmt::format("'{}' is {}; it must be positive", key, value));
  return value;
}

Shape shape_from(Fields& f) {
  const std::string kind = f.text("kind");
  if (kind == "flat") return FlatBoard{positive(f, "width_mm"), positive(f, "height_mm")};
  if (kind == "sphere") return Sphere{positive(f, "diameter_mm")};
  if (kind == "cylinder") return Cylinder{positive(f, "diameter_mm"), positive(f, "length_mm")};
  if (kind == "free form") {
    FreeForm form{positive(f, "length_mm"), positive(f, "height_mm"), positive(f, "depth_mm")};
    form.relief = f.optional_number("relief").value_or(form.relief);
    form.seed = f.optional_integer("seed").value_or(form.seed);
    if (!(form.relief >= 0 && form.relief < 0.25)) f.complain("'relief' lies between 0 and 0.25");
    return form;
  }
  if (kind != "board") {
    f.complain(fmt::format("kind is '{}'; it is \"flat\", \"board\", \"sphere\", \"cylinder\" or \"free form\"", kind));
  }
  PatternBoard board;
  board.board = model::board_from(f.table("board"));
  board.u_print_mm = f.optional_number("u_print_mm").value_or(board.u_print_mm);
  board.bow_mm = f.optional_number("bow_mm").value_or(board.bow_mm);
  board.pitch_error_relative = f.optional_number("pitch_error_relative").value_or(board.pitch_error_relative);
  if (!(board.u_print_mm >= 0)) f.complain("'u_print_mm' must not be negative");
  return board;
}

struct ShapeToValue {
  Value& out;
  void operator()(const FlatBoard& s) const {
    out.set("kind", "flat").set("width_mm", s.width_mm).set("height_mm", s.height_mm);
  }
  void operator()(const PatternBoard& s) const {
    out.set("kind", "board").set("board", model::to_value(s.board)).set("u_print_mm", s.u_print_mm);
    out.set("bow_mm", s.bow_mm).set("pitch_error_relative", s.pitch_error_relative);
  }
  void operator()(const Sphere& s) const { out.set("kind", "sphere").set("diameter_mm", s.diameter_mm); }
  void operator()(const Cylinder& s) const {
    out.set("kind", "cylinder").set("diameter_mm", s.diameter_mm).set("length_mm", s.length_mm);
  }
  void operator()(const FreeForm& s) const {
    out.set("kind", "free form").set("length_mm", s.length_mm).set("height_mm", s.height_mm);
    out.set("depth_mm", s.depth_mm).set("relief", s.relief).set("seed", s.seed);
  }
};

}  // namespace

Scene read_scene(const std::filesystem::path& file) { return scene_from(Fields(read_toml(file), file.string())); }

Scene scene_from(Fields f) {
  Scene scene;
  for (Fields& one : f.tables("objects")) {
    SceneObject object;
    object.name = one.text("name");
    object.shape = shape_from(one);
    const auto p = one.numbers("position_mm", 3), w = one.numbers("rotation_deg", 3);
    object.world_from_part = {rotation_from_vector(std::numbers::pi / 180.0 * Eigen::Vector3d(w[0], w[1], w[2])),
                              {p[0], p[1], p[2]}};
    object.albedo = one.optional_number("albedo").value_or(object.albedo);
    object.texture = one.optional_number("texture").value_or(object.texture);
    if (!(object.albedo >= 0 && object.texture >= 0)) one.complain("'albedo' and 'texture' must not be negative");
    one.finish();
    scene.objects.push_back(std::move(object));
  }
  f.finish();
  if (scene.objects.empty()) f.complain("the scene has no [[objects]]; add at least one");
  if (scene.objects.size() > 120) f.complain("the scene has more than 120 objects; take some out");
  return scene;
}

Value to_value(const Scene& scene) {
  Value objects = Value::array();
  for (const SceneObject& o : scene.objects) {
    Value one = Value::object().set("name", o.name);
    std::visit(ShapeToValue{one}, o.shape);
    const Eigen::Vector3d w = 180.0 / std::numbers::pi * vector_from_rotation(o.world_from_part.rotation);
    one.set("position_mm", Value::numbers(o.world_from_part.translation_mm)).set("rotation_deg", Value::numbers(w));
    objects.append(one.set("albedo", o.albedo).set("texture", o.texture));
  }
  return Value::object().set("objects", objects);
}

}  // namespace fringecal::virt

#include "hw/virtual/preset.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

namespace fringecal::virt {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

double positive(Fields& f, const char* key) {
  const double value = f.number(key);
  if (!(value > 0)) f.complain(fmt::format("'{}' is {}; it must be positive", key, value));
  return value;
}

double not_negative(Fields& f, const char* key) {
  const double value = f.number(key);
  if (!(value >= 0)) f.complain(fmt::format("'{}' is {}; it must not be negative", key, value));
  return value;
}

template <std::size_t N>
std::array<double, N> fixed(Fields& f, const char* key) {
  const auto numbers = f.numbers(key, N);
  std::array<double, N> out{};
  std::copy(numbers.begin(), numbers.end(), out.begin());
  return out;
}

void read_camera(Fields f, Preset& p) {
  auto& c = p.camera;
  c.width_px = f.integer("width_px");
  c.height_px = f.integer("height_px");
  if (c.width_px < 16 || c.height_px < 16) f.complain("the sensor needs at least 16 x 16 pixels");
  c.pixel_mm = positive(f, "pixel_mm");
  c.focal_length_mm = positive(f, "focal_length_mm");
  const auto principal = fixed<2>(f, "principal_point_mm");
  c.principal_point_mm = {principal[0], principal[1]};
  c.distortion = fixed<4>(f, "distortion_k1_k2_p1_p2");
  c.blur_px = not_negative(f, "blur_px");
  if (!(c.blur_px <= 3)) f.complain(fmt::format("'blur_px' is {}; at most 3 is rendered", c.blur_px));
  c.bits = f.integer("bits");
  if (c.bits != 8 && c.bits != 12) f.complain(fmt::format("'bits' is {}; it is 8 or 12", c.bits));
  c.noise_rms = not_negative(f, "noise_rms");
  c.noise_shot_fraction = not_negative(f, "noise_shot_fraction");
  if (!(c.noise_shot_fraction <= 1)) f.complain("'noise_shot_fraction' lies between 0 and 1");
  c.fixed_pattern_gain = not_negative(f, "fixed_pattern_gain");
  c.exposure_ms = positive(f, "exposure_ms");
  f.finish();
}

void read_geometry(Fields f, Preset& p) {
  auto& g = p.geometry;
  g.working_distance_mm = positive(f, "working_distance_mm");
  g.base_mm = positive(f, "base_mm");
  g.pupil_offset_y_mm = f.number("pupil_offset_y_mm");
  g.projector_tilt_rad = f.number("projector_tilt_deg") * kRadPerDeg;
  g.projector_tilt_towards_rad = f.number("projector_tilt_towards_deg") * kRadPerDeg;
  g.camera_roll_rad = f.number("camera_roll_deg") * kRadPerDeg;
  f.finish();
}

void read_projector(Fields f, Preset& p) {
  p.projector.focal_length_mm = positive(f, "focal_length_mm");
  p.projector.distortion = fixed<2>(f, "distortion_k1_k2");
  p.projector.principal_point_across_mm = f.number("principal_point_across_mm");
  p.projector.modulation = positive(f, "modulation");
  f.finish();
}

void read_grating(Fields f, Preset& p) {
  auto& g = p.grating;
  g.code.gray_bits = f.integer("gray_bits");
  g.code.phase_steps = f.integer("phase_steps");
  g.code.stripes_per_period = f.integer("stripes_per_period");
  g.code.period = positive(f, "period_mm");
  g.code.unit = "mm";
  if (g.code.gray_bits < 1 || g.code.gray_bits > 12) f.complain("'gray_bits' lies between 1 and 12");
  if (g.code.phase_steps < 3 || g.code.phase_steps > 64) f.complain("'phase_steps' lies between 3 and 64");
  if (g.code.stripes_per_period != 1 && g.code.stripes_per_period != 2) f.complain("'stripes_per_period' is 1 or 2");
  g.pattern_pitch_mm = positive(f, "pattern_pitch_mm");
  const std::string order = f.text("order");
  if (order != "gray first" && order != "phase first") {
    f.complain(fmt::format("'order' is \"{}\"; it is \"gray first\" or \"phase first\"", order));
  }
  g.gray_first = order == "gray first";
  g.lithography_mm = not_negative(f, "lithography_mm");
  g.contrast = positive(f, "contrast");
  g.third_harmonic_centre = positive(f, "third_harmonic_centre");
  g.third_harmonic_edge = positive(f, "third_harmonic_edge");
  // 1/3 is the square wave itself. From 0.2 on, the 7th harmonic, which is not rendered, would pass 0.1 %.
  if (!(std::max(g.third_harmonic_centre, g.third_harmonic_edge) <= 0.1)) {
    f.complain("the third harmonic after the lens is at most 0.1 of the first");
  }
  f.finish();
}

Place place_from(Fields& f, const char* key) { return fixed<6>(f, key); }

Preset::Placing placing_from(Fields& f, std::initializer_list<const char*> objects) {
  Preset::Placing out{not_negative(f, "shift_mm"), not_negative(f, "turn_deg"), {}};
  for (const char* object : objects) out.places[object] = place_from(f, object);
  return out;
}

Preset::Placing numbered_places(Fields& f) {
  Preset::Placing out = placing_from(f, {});
  const Value places = f.raw("places");
  if (!places.if_array() || places.if_array()->empty()) f.complain("'places' must be a list of places");
  for (std::size_t k = 0; k < places.if_array()->size(); ++k) {
    const std::string index = std::to_string(k);
    Fields one(Value::object().set(index, (*places.if_array())[k]), f.file(), "places");
    out.places[index] = place_from(one, index.c_str());
  }
  return out;
}

std::vector<std::array<double, 3>> triples(Fields& f, const char* key) {
  const Value list = f.raw(key);
  if (!list.if_array() || list.if_array()->empty()) f.complain(fmt::format("'{}' must be a list of [x, y, z]", key));
  std::vector<std::array<double, 3>> out;
  for (const Value& entry : *list.if_array()) {
    Fields one(Value::object().set(key, entry), f.file(), key);
    out.push_back(fixed<3>(one, key));
  }
  return out;
}

/// A plate is as many artefacts as its spheres have diameters and coordinates.
void read_plate(Fields f, Preset& p) {
  const auto centres = triples(f, "centres_mm");
  const Preset::Artefact one{positive(f, "diameter_mm"), not_negative(f, "making_mm"), not_negative(f, "U_mm") / 2.0,
                             f.optional_number("expansion_per_K").value_or(0)};
  f.finish();
  for (const auto& centre : centres) {
    const std::string name = fmt::format("plate_{}", ++p.plate_spheres);
    p.artefacts[name] = one;
    for (const std::size_t k : {0, 1, 2}) {
      p.artefacts[fmt::format("{}_{}", name, "xyz"[k])] = {centre[k], one.making_mm, one.u_mm, one.expansion_per_K};
    }
  }
}

void read_scenes(Fields f, Preset& p) {
  const auto simple = [&](const char* name, std::initializer_list<const char*> objects) {
    Fields scene = f.table(name);
    auto out = placing_from(scene, objects);
    scene.finish();
    return out;
  };
  p.alignment = simple("alignment", {"place"});
  p.plane = simple("plane", {"place"});
  p.spheres = simple("spheres", {"sphere30", "sphere38", "sphere50"});
  Fields cylinder = f.table("cylinder");
  p.cylinder = placing_from(cylinder, {"place"});
  p.cylinder_length_mm = positive(cylinder, "length_mm");
  cylinder.finish();
  Fields calibration = f.table("calibration");
  p.calibration = numbered_places(calibration);
  calibration.finish();
  if (auto probing = f.optional_table("probing")) {
    p.probing = numbered_places(*probing);
    probing->finish();
  }
  if (auto ball_bar = f.optional_table("ball_bar")) {
    p.ball_bar = numbered_places(*ball_bar);
    ball_bar->finish();
  }
  if (auto plate = f.optional_table("flat")) {
    p.flat = numbered_places(*plate);
    p.flat_width_mm = positive(*plate, "width_mm");
    p.flat_height_mm = positive(*plate, "height_mm");
    plate->finish();
  }
  for (const auto& [name, placing] :
       {std::pair("sphere_plate", &p.sphere_plate), std::pair("step", &p.step),
        std::pair("turned_sphere", &p.turned_sphere), std::pair("turned_bar", &p.turned_bar)}) {
    auto scene = f.optional_table(name);
    if (!scene) continue;
    *placing = numbered_places(*scene);
    scene->finish();
  }
  if (auto carrier = f.optional_table("carrier")) {
    p.carrier.reference_diameter_mm = positive(*carrier, "reference_diameter_mm");
    p.carrier.shift_mm = not_negative(*carrier, "shift_mm");
    p.carrier.turn_deg = not_negative(*carrier, "turn_deg");
    p.carrier.references_mm = triples(*carrier, "references_mm");
    p.carrier.turns_deg = triples(*carrier, "turns_deg");
    carrier->finish();
  }
  if (auto morning = f.optional_table("morning")) {
    p.morning = placing_from(*morning, {"bar", "sphere38", "sphere50", "flat"});
    morning->finish();
  }
  f.finish();
}

void read_boards(Fields f, Preset& p) {
  auto& b = p.boards;
  b.white_margin_pitches = not_negative(f, "white_margin_pitches");
  b.black_albedo = not_negative(f, "black_albedo");
  b.dot_diameter_pitches = positive(f, "dot_diameter_pitches");
  b.u_print_mm = not_negative(f, "u_print_mm");
  b.bow_mm = f.number("bow_mm");
  const double expanded = not_negative(f, "pitch_U_mm");
  b.u_pitch_relative = expanded / 2.0 / positive(f, "pitch_U_length_mm");
  for (const auto& [key, size] : {std::pair("chessboard", &b.chessboard), std::pair("circles", &b.circles)}) {
    Fields one = f.table(key);
    *size = {one.integer("columns"), one.integer("rows"), positive(one, "pitch_mm")};
    if (size->columns < 3 || size->rows < 3) one.complain("a board has at least 3 x 3 corners");
    one.finish();
  }
  f.finish();
}

void read_small_tables(Fields& f, Preset& p) {
  Fields slide = f.table("slide");
  p.slide = {not_negative(slide, "across_mm"), not_negative(slide, "along_mm"), not_negative(slide, "straightness_mm")};
  slide.finish();
  Fields assembly = f.table("assembly");
  p.assembly = {assembly.number("theta_mrad"), not_negative(assembly, "adjuster_scale_error"),
                not_negative(assembly, "adjuster_backlash_mrad"), positive(assembly, "adjuster_resolution_mrad")};
  assembly.finish();
  Fields drift = f.table("drift");
  p.drift = {drift.number("base_mm"), drift.number("alpha_rad"), positive(drift, "time_constant_min"),
             drift.optional_number("frame_expansion_per_K").value_or(0)};
  drift.finish();
  Fields light = f.table("light");
  p.light = {not_negative(light, "ambient"), not_negative(light, "flicker")};
  light.finish();
  Fields flat = f.table("flat_board");
  p.flat_board_width_mm = positive(flat, "width_mm");
  p.flat_board_height_mm = positive(flat, "height_mm");
  p.flat_board_flatness_mm = positive(flat, "flatness_mm");
  flat.finish();
  Fields artefacts = f.table("artefacts");
  const bool with_bar = artefacts.has("bar");
  for (const char* name : {"sphere30", "sphere38", "sphere50", "cylinder", "bar", "bar_a", "bar_b"}) {
    if (!with_bar && std::string_view(name).starts_with("bar")) continue;
    Fields one = artefacts.table(name);
    p.artefacts[name] = {positive(one, "nominal_mm"), not_negative(one, "making_mm"), not_negative(one, "U_mm") / 2.0,
                         one.optional_number("expansion_per_K").value_or(0)};
    one.finish();
  }
  if (auto step = artefacts.optional_table("step")) {
    p.artefacts["step"] = {positive(*step, "nominal_mm"), not_negative(*step, "making_mm"),
                           not_negative(*step, "U_mm") / 2.0, step->optional_number("expansion_per_K").value_or(0)};
    step->finish();
  }
  if (auto plate = artefacts.optional_table("plate")) read_plate(*plate, p);
  artefacts.finish();
}

}  // namespace

Preset read_preset(const std::string& name) {
  const bool built_in = name == "chen2008";
  if (!built_in && !std::filesystem::exists(name)) {
    throw InputError(fmt::format("{}: there is no such preset; it is \"chen2008\" or a TOML file", name));
  }
  Fields f(built_in ? parse_toml(built_in_preset_text(), "preset chen2008") : read_toml(name),
           built_in ? "preset chen2008" : name);
  f.expect_schema("fringecal.virtual-instrument", 1);
  Preset p;
  p.name = f.text("name");
  read_camera(f.table("camera"), p);
  read_geometry(f.table("geometry"), p);
  read_projector(f.table("projector"), p);
  read_grating(f.table("grating"), p);
  read_small_tables(f, p);
  read_boards(f.table("boards"), p);
  read_scenes(f.table("scenes"), p);
  f.finish();
  return p;
}

}  // namespace fringecal::virt

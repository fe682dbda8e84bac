#include "hw/virtual/standard_scenes.h"

#include "core/error.h"
#include "hw/virtual/free_form.h"
#include "hw/virtual/random.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace fringecal::virt {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

const Preset::Artefact& artefact_of(const Preset& preset, const std::string& name) {
  const auto it = preset.artefacts.find(name);
  if (it == preset.artefacts.end()) throw std::logic_error("broken contract: there is no artefact named " + name);
  return it->second;
}

// Where a hand puts the thing: the preset's place, scattered.
Rigid3 put(const Preset::Placing& placing, const Place& p, Stream& random) {
  const Eigen::Vector3d shift = placing.shift_mm * random.normal3(), turn = placing.turn_deg * random.normal3();
  const Eigen::Quaterniond scatter = rotation_from_vector(kRadPerDeg * turn);
  const Eigen::Quaterniond nominal = rotation_from_vector(kRadPerDeg * Eigen::Vector3d(p[3], p[4], p[5]));
  return {(scatter * nominal).normalized(), Eigen::Vector3d(p[0], p[1], p[2]) + shift};
}

SceneObject object(std::string name, Shape shape, const Rigid3& pose) {
  SceneObject out;
  out.name = std::move(name);
  out.shape = std::move(shape);
  out.world_from_part = pose;
  return out;
}

// The true size of an artefact, as warm as the room is.
using SizeOf = std::function<double(const std::string&)>;

// Two white spheres along the pose's x, held by a black rod of carbon fibre.
Scene ball_bar_scene(const SizeOf& size, const Rigid3& pose) {
  const double distance = size("bar"), a = size("bar_a"), b = size("bar_b");
  const auto along = [&](double x) { return pose * Rigid3{Eigen::Quaterniond::Identity(), Eigen::Vector3d(x, 0, 0)}; };
  Scene scene{{object("bar_a", Sphere{a}, along(-distance / 2)), object("bar_b", Sphere{b}, along(distance / 2))}};
  constexpr double kRodDiameter = 8, kRodAlbedo = 0.03;
  const Rigid3 rod_from_bar{rotation_from_vector({0, std::numbers::pi / 2, 0}), Eigen::Vector3d::Zero()};
  SceneObject rod = object("rod", Cylinder{kRodDiameter, distance - a / 2 - b / 2 + 2}, pose * rod_from_bar);
  rod.albedo = kRodAlbedo;
  scene.objects.push_back(rod);
  return scene;
}

Rigid3 at(const Eigen::Vector3d& place) { return {Eigen::Quaterniond::Identity(), place}; }

// The spheres of the plate about the pose, the mean of their certified places at its origin.
Scene sphere_plate_scene(const Preset& preset, const SizeOf& size, const Rigid3& pose) {
  std::vector<Eigen::Vector3d> centres;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (int k = 1; k <= preset.plate_spheres; ++k) {
    const std::string name = fmt::format("plate_{}", k);
    centres.emplace_back(size(name + "_x"), size(name + "_y"), size(name + "_z"));
    middle += centres.back() / preset.plate_spheres;
  }
  Scene scene;
  for (int k = 1; k <= preset.plate_spheres; ++k) {
    const std::string name = fmt::format("plate_{}", k);
    const Eigen::Vector3d centre = centres[static_cast<std::size_t>(k - 1)] - middle;
    scene.objects.push_back(object(name, Sphere{size(name)}, pose * at(centre)));
  }
  return scene;
}

// Two planes side by side, the upper one at x > 0.
Scene step_scene(const SizeOf& size, const Rigid3& pose) {
  constexpr double kWidth = 60, kHeight = 80;
  const FlatBoard plane{kWidth, kHeight};
  return Scene{{object("lower", plane, pose * at({-kWidth / 2, 0, 0})),
                object("upper", plane, pose * at({kWidth / 2, 0, size("step")}))}};
}

// What stands on the carrier, turned with it: the references' own places are fixed, as the carrier is one piece.
Scene on_carrier(const Preset& preset, Scene scene, const Rigid3& turn) {
  int number = 0;
  for (const auto& p : preset.carrier.references_mm) {
    scene.objects.push_back(object(fmt::format("reference {}", ++number), Sphere{preset.carrier.reference_diameter_mm},
                                   at({p[0], p[1], p[2]})));
  }
  for (auto& one : scene.objects) one.world_from_part = turn * one.world_from_part;
  return scene;
}

// A plaster model on a turntable, an eighth of a turn further in each view; twelve spheres of 20 mm stand 12 mm off its
// surface on pins that nobody sees. The table's axis is vertical, 100 mm behind R.
Scene plaster_scene(int view) {
  const FreeForm form;
  const Rigid3 axis{Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -100)};
  const Rigid3 turned =
      axis * Rigid3{rotation_from_vector({0, view * std::numbers::pi / 4, 0}), Eigen::Vector3d::Zero()};
  Scene scene{{object("plaster", form, turned)}};
  const FreeFormSurface surface({form.length_mm / 2, form.height_mm / 2, form.depth_mm / 2}, form.relief,
                                static_cast<std::uint64_t>(form.seed));
  for (int k = 0; k < 12; ++k) {
    const double turn = k * std::numbers::pi / 6 + 0.05 * (k % 3);
    const Eigen::Vector3d outwards =
        Eigen::Vector3d(std::cos(turn), 0.5 * std::sin(2.1 * k), std::sin(turn)).normalized();
    const auto way = surface.hit(1000 * outwards, -outwards, 0);
    require(way.has_value(), "a ray to the middle of a free form meets it");
    const Eigen::Vector3d foot = (1000 - *way) * outwards;
    constexpr double kOff = 12, kDiameter = 20;
    scene.objects.push_back(
        object(fmt::format("sphere {}", k), Sphere{kDiameter},
               turned * Rigid3{Eigen::Quaterniond::Identity(), foot + kOff * surface.normal(foot)}));
  }
  return scene;
}

// "turned_bar 3.1": the bar at its fourth place, the carrier in its second turn. The bar's place on the carrier is the same in
// each turn; the turn is a hand's.
struct TurnedName {
  std::string kind, number;
};
struct Hand {
  std::uint64_t instrument_seed, how_many_th;
};
std::optional<Scene> turned_scene(const Preset& preset, const SizeOf& size, const TurnedName& name, const Hand& hand) {
  const auto dot = name.number.find('.');
  if (dot == std::string::npos || dot == 0 || dot + 1 == name.number.size()) return std::nullopt;
  if (name.number.find_first_not_of("0123456789.") != std::string::npos || name.number.size() > 8) return std::nullopt;
  const std::string place = name.number.substr(0, dot), view = name.number.substr(dot + 1);
  if (view.find('.') != std::string::npos) return std::nullopt;
  const auto turn = static_cast<std::size_t>(std::stoi(view));
  const Preset::Placing& placing = name.kind == "turned_bar" ? preset.turned_bar : preset.turned_sphere;
  if (!placing.places.contains(place) || turn >= preset.carrier.turns_deg.size()) return std::nullopt;
  if (name.kind == "turned_bar" && !preset.artefacts.contains("bar")) return std::nullopt;
  const auto stream = [&](const std::string& what) {
    return Stream(
        hand.instrument_seed,
        fmt::format("scene {}{}", what, hand.how_many_th > 1 ? fmt::format(", placing {}", hand.how_many_th) : ""));
  };
  Stream of_place = stream(name.kind + " " + place), of_turn = stream(name.kind + " " + name.number);
  const Rigid3 pose = put(placing, placing.places.at(place), of_place);
  Scene scene = name.kind == "turned_bar" ? ball_bar_scene(size, pose)
                                          : Scene{{object("sphere30", Sphere{size("sphere30")}, pose)}};
  const auto& t = preset.carrier.turns_deg[turn];
  const Preset::Placing turns{preset.carrier.shift_mm, preset.carrier.turn_deg, {}};
  return on_carrier(preset, std::move(scene), put(turns, {0, 0, 0, t[0], t[1], t[2]}, of_turn));
}

}  // namespace

Uncertain certificate_mm(const Preset& preset, std::uint64_t instrument_seed, const std::string& artefact) {
  const auto& a = artefact_of(preset, artefact);
  const double made = a.nominal_mm + a.making_mm * Stream(instrument_seed, "making of " + artefact).normal();
  return {std::round(made * 1e4) / 1e4, a.u_mm};  // a certificate is printed to 0.1 um; divided: the nearest double
}

double true_size_mm(const Preset& preset, std::uint64_t instrument_seed, const std::string& artefact,
                    double room_degC) {
  const Uncertain certificate = certificate_mm(preset, instrument_seed, artefact);
  const double at_20 = certificate.value + certificate.u * Stream(instrument_seed, "truth of " + artefact).normal();
  return at_20 * (1 + artefact_of(preset, artefact).expansion_per_K * (room_degC - 20.0));
}

model::Board certified_board(const Preset& preset, const std::string& kind) {
  require(kind == "chessboard" || kind == "circles", "a certified board is a \"chessboard\" or \"circles\"");
  const auto& size = kind == "chessboard" ? preset.boards.chessboard : preset.boards.circles;
  model::Board b;
  b.kind = kind == "chessboard" ? model::BoardKind::chessboard : model::BoardKind::circles;
  b.columns = size.columns;
  b.rows = size.rows;
  b.pitch_x_mm = b.pitch_y_mm = size.pitch_mm;
  b.u_print_mm = preset.boards.u_print_mm;
  b.u_pitch_relative = preset.boards.u_pitch_relative;
  b.certificate = fmt::format("virtual certificate of the {} of {}", kind, preset.name);
  return b;
}

PatternBoard true_board(const Preset& preset, std::uint64_t instrument_seed, const std::string& kind) {
  PatternBoard out;
  out.board = certified_board(preset, kind);
  out.u_print_mm = preset.boards.u_print_mm;
  out.bow_mm = preset.boards.bow_mm;
  out.pitch_error_relative = preset.boards.u_pitch_relative * Stream(instrument_seed, "pitch of " + kind).normal();
  return out;
}

std::optional<Scene> standard_scene(const Preset& preset, std::uint64_t instrument_seed, const std::string& name,
                                    double room_degC, std::uint64_t how_many_th) {
  const SizeOf size = [&](const std::string& artefact) {
    return true_size_mm(preset, instrument_seed, artefact, room_degC);
  };
  const auto space = name.find(' ');
  const std::string kind = name.substr(0, space), number = space == std::string::npos ? "" : name.substr(space + 1);
  const bool numbered = !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  Stream random(instrument_seed, "scene " + name + (how_many_th > 1 ? fmt::format(", placing {}", how_many_th) : ""));
  const FlatBoard flat{preset.flat_board_width_mm, preset.flat_board_height_mm};
  if (name == "alignment") {
    return Scene{{object("board", flat, put(preset.alignment, preset.alignment.places.at("place"), random))}};
  }
  if (kind == "plane" && numbered) {
    return Scene{{object("board", flat, put(preset.plane, preset.plane.places.at("place"), random))}};
  }
  if (kind == "calibration" && numbered && preset.calibration.places.contains(number)) {
    // Half a turn about X first: the board's rows then run downwards, as the image's.
    const Rigid3 facing{rotation_from_vector({std::numbers::pi, 0, 0}), Eigen::Vector3d::Zero()};
    const Rigid3 pose = put(preset.calibration, preset.calibration.places.at(number), random) * facing;
    return Scene{{object("chessboard", true_board(preset, instrument_seed, "chessboard"), pose)}};
  }
  if (kind == "spheres" && numbered) {
    Scene scene;
    for (const auto& [sphere, place] : preset.spheres.places) {
      scene.objects.push_back(object(sphere, Sphere{size(sphere)}, put(preset.spheres, place, random)));
    }
    return scene;
  }
  if (kind == "cylinder" && numbered) {
    const Cylinder cylinder{size("cylinder"), preset.cylinder_length_mm};
    return Scene{{object("cylinder", cylinder, put(preset.cylinder, preset.cylinder.places.at("place"), random))}};
  }
  const auto place_of = [&](const Preset::Placing& placing) -> std::optional<Rigid3> {
    if (!numbered || !placing.places.contains(number)) return std::nullopt;
    return put(placing, placing.places.at(number), random);
  };
  if (kind == "probing") {
    const auto pose = place_of(preset.probing);
    if (!pose) return std::nullopt;
    return Scene{{object("sphere30", Sphere{size("sphere30")}, *pose)}};
  }
  if (kind == "flat") {
    const auto pose = place_of(preset.flat);
    if (!pose) return std::nullopt;
    return Scene{{object("flat", FlatBoard{preset.flat_width_mm, preset.flat_height_mm}, *pose)}};
  }
  if (kind == "sphere_plate" && preset.plate_spheres > 0) {
    const auto pose = place_of(preset.sphere_plate);
    if (!pose) return std::nullopt;
    return sphere_plate_scene(preset, size, *pose);
  }
  if (kind == "step" && preset.artefacts.contains("step")) {
    const auto pose = place_of(preset.step);
    if (!pose) return std::nullopt;
    return step_scene(size, *pose);
  }
  if (kind == "turned_sphere" || kind == "turned_bar") {
    return turned_scene(preset, size, {kind, number}, {instrument_seed, how_many_th});
  }
  if (kind == "plaster" && numbered) return plaster_scene(std::stoi(number));
  if (kind == "morning" && numbered && !preset.morning.places.empty() && preset.artefacts.contains("bar")) {
    const auto pose = [&](const char* artefact) {
      return put(preset.morning, preset.morning.places.at(artefact), random);
    };
    Scene scene = ball_bar_scene(size, pose("bar"));
    for (const char* sphere : {"sphere38", "sphere50"}) {
      scene.objects.push_back(object(sphere, Sphere{size(sphere)}, pose(sphere)));
    }
    scene.objects.push_back(object("flat", FlatBoard{preset.flat_width_mm, preset.flat_height_mm}, pose("flat")));
    return scene;
  }
  if (kind == "ball_bar" && preset.artefacts.contains("bar")) {
    const auto pose = place_of(preset.ball_bar);
    if (!pose) return std::nullopt;
    return ball_bar_scene(size, *pose);
  }
  return std::nullopt;
}

}  // namespace fringecal::virt

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

}  // namespace

Uncertain certificate_mm(const Preset& preset, std::uint64_t instrument_seed, const std::string& artefact) {
  const auto& a = artefact_of(preset, artefact);
  const double made = a.nominal_mm + a.making_mm * Stream(instrument_seed, "making of " + artefact).normal();
  return {std::round(made * 1e4) * 1e-4, a.u_mm};  // a certificate is printed to 0.1 um
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
                                    double room_degC) {
  const SizeOf size = [&](const std::string& artefact) {
    return true_size_mm(preset, instrument_seed, artefact, room_degC);
  };
  const auto space = name.find(' ');
  const std::string kind = name.substr(0, space), number = space == std::string::npos ? "" : name.substr(space + 1);
  const bool numbered = !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
  Stream random(instrument_seed, "scene " + name);
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

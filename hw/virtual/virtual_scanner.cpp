#include "hw/virtual/virtual_scanner.h"

#include "core/error.h"
#include "hw/virtual/light_field.h"
#include "hw/virtual/random.h"
#include "hw/virtual/sensor.h"
#include "hw/virtual/standard_scenes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace fringecal::virt {
namespace {

Preset with(Preset preset, const PresetOverrides& overrides) {
  if (overrides.theta_mrad) preset.assembly.theta_mrad = *overrides.theta_mrad;
  if (overrides.bits) preset.camera.bits = *overrides.bits;
  if (preset.camera.bits != 8 && preset.camera.bits != 12) {
    throw InputError(fmt::format("bits is {}; a virtual camera has 8 or 12", preset.camera.bits));
  }
  return preset;
}

PatternPlan plan_of(const Preset& preset) {
  PatternPlan plan;
  plan.x = preset.grating.code;
  const auto add = [&](PatternKind kind, int count) {
    for (int k = 0; k < count; ++k) plan.patterns.push_back({kind, CodeAxis::x, k, false});
  };
  if (preset.grating.gray_first) add(PatternKind::gray, plan.x->gray_bits);
  add(PatternKind::phase, plan.x->phase_steps);
  if (!preset.grating.gray_first) add(PatternKind::gray, plan.x->gray_bits);
  return plan;
}

model::Camera camera_of(const Preset& preset) {
  const auto& c = preset.camera;
  model::Camera out;
  out.width_px = c.width_px;
  out.height_px = c.height_px;
  out.fx_px = out.fy_px = c.focal_length_mm / c.pixel_mm;
  out.cx_px = 0.5 * (c.width_px - 1) + c.principal_point_mm.x() / c.pixel_mm;
  out.cy_px = 0.5 * (c.height_px - 1) + c.principal_point_mm.y() / c.pixel_mm;
  std::copy(c.distortion.begin(), c.distortion.end(), out.distortion.begin());
  out.pixel_mm = c.pixel_mm;
  return out;
}

model::Projector projector_of(const Preset& preset) {
  model::Projector out;
  out.x = model::ProjectorAxis{preset.grating.code, preset.projector.focal_length_mm,
                               0.5 * preset.grating_width_mm() + preset.projector.principal_point_across_mm};
  out.distortion = {preset.projector.distortion[0], preset.projector.distortion[1], 0, 0, 0};
  return out;
}

// Looks down from (0, 0, L): x = X, y = -Y, z = -Z, then the axis turned towards the preset's direction.
Rigid3 preset_from_proj(const Preset& preset) {
  const auto& g = preset.geometry;
  const Eigen::Quaterniond down = rotation_from_vector({std::numbers::pi, 0, 0});
  const Eigen::Vector3d towards(std::cos(g.projector_tilt_towards_rad), std::sin(g.projector_tilt_towards_rad), 0);
  // The axis -Z moves towards `towards` by a turn about (-Z) x towards.
  const Eigen::Vector3d about = (-Eigen::Vector3d::UnitZ()).cross(towards);
  return {(rotation_from_vector(g.projector_tilt_rad * about) * down).normalized(),
          Eigen::Vector3d(0, 0, g.working_distance_mm)};
}

// A smooth path of the slide's straightness, peak to peak 1 over [0, 1]: three waves of random phase, normalised.
std::vector<double> straightness(std::uint64_t seed, std::size_t patterns) {
  Stream random(seed, "straightness");
  std::array<double, 3> phase, amplitude;
  for (std::size_t k = 0; k < 3; ++k) {
    phase[k] = 2.0 * std::numbers::pi * random.uniform();
    amplitude[k] = random.normal() / static_cast<double>(k + 1);
  }
  const auto path = [&](double s) {
    double y = 0;
    for (std::size_t k = 0; k < 3; ++k)
      y += amplitude[k] * std::sin(std::numbers::pi * static_cast<double>(k + 1) * s + phase[k]);
    return y;
  };
  double low = path(0), high = low;
  for (int i = 1; i <= 200; ++i) {
    low = std::min(low, path(i / 200.0));
    high = std::max(high, path(i / 200.0));
  }
  std::vector<double> out;
  for (std::size_t s = 0; s < patterns; ++s) {
    const double place = patterns > 1 ? static_cast<double>(s) / static_cast<double>(patterns - 1) : 0.0;
    out.push_back((path(place) - 0.5 * (low + high)) / std::max(high - low, 1e-12));
  }
  return out;
}

}  // namespace

struct VirtualScanner::Instance {
  Instance(Preset p, std::uint64_t instrument_seed)
      : preset(std::move(p)),
        seed(instrument_seed),
        plan(plan_of(preset)),
        camera(camera_of(preset)),
        projector(projector_of(preset)),
        grating(preset),
        sensor(preset, seed),
        rays(camera) {
    Stream lithography(seed, "lithography");
    for (const double path : straightness(seed, plan.patterns.size())) {
      fixed_offset_mm.push_back(preset.grating.lithography_mm * lithography.normal() +
                                preset.slide.straightness_mm * path);
    }
    adjuster_scale = 1.0 + preset.assembly.adjuster_scale_error * Stream(seed, "adjuster").normal();
  }

  Preset preset;
  std::uint64_t seed;
  PatternPlan plan;
  model::Camera camera;
  model::Projector projector;
  Grating grating;
  Sensor sensor;
  RayField rays;
  std::vector<double> fixed_offset_mm;  // lithography and straightness, by slot
  double adjuster_scale = 1.0;

  double drift(const InstrumentState& state) const {
    return 1.0 - std::exp(-std::max(state.minutes_since_start, 0.0) / preset.drift.time_constant_min);
  }
  std::vector<Exposure> exposures(const InstrumentState& state, double theta_rad, std::uint64_t stack_seed) const;
  // The slot at which the phase's wrap stands.
  double reference_slot() const {
    return (preset.grating.gray_first ? plan.x->gray_bits : 0) + 0.5 * plan.x->phase_steps;
  }
};

VirtualScanner::VirtualScanner(const std::string& preset, std::uint64_t instrument_seed,
                               const PresetOverrides& overrides)
    : instance_(std::make_unique<Instance>(with(read_preset(preset), overrides), instrument_seed)) {}
VirtualScanner::~VirtualScanner() = default;
VirtualScanner::VirtualScanner(VirtualScanner&&) noexcept = default;

struct SeenScene {
  LightField field;
};

std::shared_ptr<const SeenScene> VirtualScanner::see(const Scene& scene, const InstrumentState& state) const {
  const Instance& in = *instance_;
  std::vector<Solid> solids;
  for (const SceneObject& object : scene.objects) solids.emplace_back(object, in.preset, in.seed);
  const model::Scanner scanner = true_scanner(state);
  return std::make_shared<const SeenScene>(
      SeenScene{light_field(solids, in.rays, {scanner, preset_from_cam(state)}, in.preset)});
}

std::vector<Exposure> VirtualScanner::Instance::exposures(const InstrumentState& state, double theta_rad,
                                                          std::uint64_t stack_seed) const {
  const double sine = std::sin(theta_rad);
  Stream slide_draws(stack_seed, "slide"), flicker(stack_seed, "flicker");
  std::vector<Exposure> out;
  for (std::size_t s = 0; s < plan.patterns.size(); ++s) {
    const double across_mm = preset.slide.across_mm * slide_draws.normal();
    const double along_mm =
        static_cast<double>(s) * preset.grating.pattern_pitch_mm + preset.slide.along_mm * slide_draws.normal();
    Exposure e;
    e.pattern = plan.patterns[s];
    e.offset_mm = (reference_slot() * preset.grating.pattern_pitch_mm - along_mm) * sine + fixed_offset_mm[s] +
                  across_mm;  // eq. 1
    e.ambient = state.exposure * preset.light.ambient;
    e.light_factor =
        state.exposure * state.faults.projector_transmission * (1.0 + preset.light.flicker * flicker.normal());
    e.veil = state.faults.projector_veil;
    e.noise_key = key_of(stack_seed, fmt::format("noise of frame {}", s));
    out.push_back(e);
  }
  return out;
}

GrayImage VirtualScanner::frame(const SeenScene& seen, const InstrumentState& state, std::uint64_t stack_seed,
                                const Lighting& lighting) const {
  const Instance& in = *instance_;
  Exposure e;
  if (lighting.pattern) {
    require(*lighting.pattern < in.plan.patterns.size(), "the plan has this pattern");
    e = in.exposures(state, true_theta_rad(state), stack_seed)[*lighting.pattern];
    e.light_factor *= lighting.lamp;
  } else {
    e.pattern = in.plan.patterns.front();
    e.light_factor = 0;
    e.ambient = state.exposure * in.preset.light.ambient;
    e.noise_key = key_of(stack_seed, "noise without a pattern");
  }
  return in.sensor.take(seen.field, in.grating, {e}).front();
}

Capture VirtualScanner::capture(const Scene& scene, const InstrumentState& state, std::uint64_t stack_seed) const {
  const Instance& in = *instance_;
  Capture out;
  out.info.plan = in.plan;
  for (const Pattern& pattern : in.plan.patterns) out.info.frames.push_back({"", pattern, "", ""});
  out.info.width_px = in.camera.width_px;
  out.info.height_px = in.camera.height_px;
  out.info.bits = in.preset.camera.bits;
  out.info.exposure_ms = in.preset.camera.exposure_ms * state.exposure;
  out.info.temperatures_degC["room"] = state.room_degC;
  out.info.devices["camera"] = fmt::format("virtual {} {}", in.preset.name, in.seed);
  out.info.devices["projector"] = out.info.devices["camera"];
  out.info.source = fmt::format("virtual {}, instrument seed {}, stack seed {}", in.preset.name, in.seed, stack_seed);
  out.frames =
      in.sensor.take(see(scene, state)->field, in.grating, in.exposures(state, true_theta_rad(state), stack_seed));
  return out;
}

void VirtualScanner::turn_adjuster(double turn_mrad, InstrumentState& state) const {
  const auto& a = instance_->preset.assembly;
  const double turn = std::round(turn_mrad / a.adjuster_resolution_mrad) * a.adjuster_resolution_mrad;
  state.adjuster_mrad += turn;
  // The screw moves in the play of its nut: at one end it pushes one way, at the other end the other way.
  state.adjuster_play_mrad = std::clamp(state.adjuster_play_mrad + turn, 0.0, a.adjuster_backlash_mrad);
}

const PatternPlan& VirtualScanner::plan() const { return instance_->plan; }
double VirtualScanner::pattern_pitch_mm() const { return instance_->preset.grating.pattern_pitch_mm; }
CameraData VirtualScanner::camera_data() const {
  const auto& c = instance_->preset.camera;
  return {c.width_px, c.height_px, c.bits, c.exposure_ms};
}
double VirtualScanner::pixel_mm() const { return instance_->preset.camera.pixel_mm; }

double VirtualScanner::certified_flatness_mm() const { return instance_->preset.flat_board_flatness_mm; }
double VirtualScanner::design_working_distance_mm() const { return instance_->preset.geometry.working_distance_mm; }
int VirtualScanner::calibration_scenes() const { return static_cast<int>(instance_->preset.calibration.places.size()); }

model::Board VirtualScanner::certified_board(const std::string& kind) const {
  return virt::certified_board(instance_->preset, kind);
}
Uncertain VirtualScanner::certificate_mm(const std::string& artefact) const {
  return virt::certificate_mm(instance_->preset, instance_->seed, artefact);
}
bool VirtualScanner::has_standard_scene(const std::string& name) const {
  return virt::standard_scene(instance_->preset, instance_->seed, name).has_value();
}
Scene VirtualScanner::standard_scene(const std::string& name, double room_degC, std::uint64_t placing) const {
  auto scene = virt::standard_scene(instance_->preset, instance_->seed, name, room_degC, placing);
  require(scene.has_value(), "a standard scene is asked for by one of its names");
  return *std::move(scene);
}

double VirtualScanner::true_theta_rad(const InstrumentState& state) const {
  const double moved = state.adjuster_mrad - state.adjuster_play_mrad;
  return 1e-3 * (instance_->preset.assembly.theta_mrad + instance_->adjuster_scale * moved);
}

std::vector<double> VirtualScanner::true_offsets_mm(const InstrumentState& state, std::uint64_t stack_seed) const {
  std::vector<double> out;
  for (const Exposure& e : instance_->exposures(state, true_theta_rad(state), stack_seed)) out.push_back(e.offset_mm);
  return out;
}

Rigid3 VirtualScanner::preset_from_cam(const InstrumentState& state) const {
  const auto& g = instance_->preset.geometry;
  const double drift = instance_->drift(state);
  const double expansion = instance_->preset.drift.frame_expansion_per_K * (state.room_degC - 20.0);
  const double base_mm = (g.base_mm + drift * instance_->preset.drift.base_mm) * (1 + expansion) + state.faults.base_mm;
  const double alpha = std::atan2(g.base_mm, g.working_distance_mm) + drift * instance_->preset.drift.alpha_rad;
  // Looks down (x = X, y = -Y, z = -Z), turned about Y by alpha so that the view goes towards -X, rolled about the
  // view.
  const Eigen::Quaterniond down = rotation_from_vector({std::numbers::pi, 0, 0});
  const Eigen::Quaterniond tilt = rotation_from_vector({0, alpha, 0});
  const Eigen::Quaterniond roll = rotation_from_vector({0, 0, g.camera_roll_rad});
  const Eigen::Quaterniond knock = rotation_from_vector(state.faults.camera_turn_rad);
  return {(tilt * down * roll * knock).normalized(),
          Eigen::Vector3d(base_mm, g.pupil_offset_y_mm, g.working_distance_mm)};
}

model::Scanner VirtualScanner::true_scanner(const InstrumentState& state) const {
  const Instance& in = *instance_;
  model::Scanner scanner;
  scanner.name = "true " + in.preset.name;
  scanner.camera = in.camera;
  scanner.projector = in.projector;
  scanner.proj_from_cam = preset_from_proj(in.preset).inverse() * preset_from_cam(state);
  scanner.working_distance_mm = in.preset.geometry.working_distance_mm;
  scanner.method = "truth";
  return scanner;
}

std::vector<Eigen::Vector3d> VirtualScanner::true_corners_mm(const PatternBoard& board) const {
  const PrintedBoard print(board, instance_->preset, instance_->seed);
  std::vector<Eigen::Vector3d> out;
  for (int j = 0; j < board.board.rows; ++j) {
    for (int i = 0; i < board.board.columns; ++i) out.push_back(print.corner_mm(i, j));
  }
  return out;
}

int VirtualScanner::plate_spheres() const { return instance_->preset.plate_spheres; }

namespace {

/// What an artefact's size is.
const char* key_of(const std::string& artefact) {
  if (artefact == "bar") return "distance_mm";
  if (artefact == "step") return "height_mm";
  return artefact.starts_with("plate_") && std::string_view("xyz").find(artefact.back()) != std::string_view::npos
             ? "coordinate_mm"
             : "diameter_mm";
}

}  // namespace

Value VirtualScanner::truth(const InstrumentState& state) const {
  const Instance& in = *instance_;
  const model::Scanner scanner = true_scanner(state);
  const Rigid3 preset_from_proj_now = preset_from_proj(in.preset);
  Value artefacts = Value::object();
  for (const auto& [name, artefact] : in.preset.artefacts) {
    const Uncertain certificate = certificate_mm(name);
    artefacts.set(name, Value::object()
                            .set(key_of(name), true_size_mm(in.preset, in.seed, name))
                            .set("certificate_mm", certificate.value)
                            .set("u_certificate_mm", certificate.u));
  }
  Value boards = Value::object();
  for (const char* kind : {"chessboard", "circles"}) {
    boards.set(kind,
               Value::object().set("pitch_error_relative", true_board(in.preset, in.seed, kind).pitch_error_relative));
  }
  return Value::object()
      .set("schema", "fringecal.virtual-truth")
      .set("schema_version", 1)
      .set("preset", in.preset.name)
      .set("instrument_seed", std::to_string(in.seed))
      .set("camera", model::to_value(scanner.camera))
      .set("projector", model::to_value(scanner.projector))
      .set("proj_from_cam", model::to_value(scanner.proj_from_cam))
      .set("working_distance_mm", scanner.working_distance_mm)
      .set("world_from_cam", model::to_value(scanner.world_from_cam()))
      .set("preset_from_cam", model::to_value(preset_from_cam(state)))
      .set("preset_from_proj", model::to_value(preset_from_proj_now))
      .set("world_from_preset", model::to_value(scanner.world_from_proj() * preset_from_proj_now.inverse()))
      .set("theta_mrad", 1e3 * true_theta_rad(state))
      .set("adjuster_scale", in.adjuster_scale)
      .set("fixed_pattern_offsets_mm", Value::numbers(in.fixed_offset_mm))
      .set("artefacts", artefacts)
      .set("boards", boards);
}

}  // namespace fringecal::virt

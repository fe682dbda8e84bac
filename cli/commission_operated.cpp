// A commissioning with an operator: what to place, what to turn, and the captures.
#include "calib/align_loop.h"
#include "cli/commission_scanner.h"
#include "cli/commission_steps.h"
#include "hw/capture_sequence.h"
#include "hw/open_plc.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>

namespace fringecal::cli {
namespace {

/// Tilts about both axes, both ends of the volume, its corners, and the board turned: what determines camera and
/// projector apart from each other (`calibrate --next-pose` and the report tell what a set of poses leaves open).
constexpr std::array<const char*, kBoardPoses> kPoses = {
    "in the middle of the volume, square to the camera",
    "in the middle, its upper edge tilted some 25 degrees away from the camera",
    "in the middle, its lower edge tilted some 25 degrees away",
    "in the middle, its left edge tilted some 25 degrees away",
    "in the middle, its right edge tilted some 25 degrees away",
    "at the near end of the volume, square to the camera",
    "at the far end of the volume, square to the camera",
    "in the upper left corner of the field, its upper edge tilted away",
    "in the upper right corner of the field, its right edge tilted away",
    "in the lower left corner of the field, its left edge tilted away",
    "in the lower right corner of the field, its lower edge tilted away",
    "near, turned 90 degrees in its plane, its upper edge tilted away",
    "far, turned 90 degrees in its plane, its right edge tilted away",
    "near, turned 45 degrees in its plane, its left edge tilted away",
    "far, turned 45 degrees in its plane, its lower edge tilted away"};

/// What belongs before the scanner for a scene, and as what it stays there.
struct Placement {
  std::string place, what;
};

Placement placement_of(const std::string& scene, const InstrumentSheet& sheet, int repeats) {
  const std::string name = scene.substr(0, scene.find(' '));
  if (name == "alignment") return {name, "Put the flat board where it fills the field, and leave it there"};
  if (name == "calibration") {
    const auto pose = static_cast<std::size_t>(std::stoi(scene.substr(name.size() + 1)));
    return {scene, fmt::format("Put the calibration board {} (pose {} of {})", kPoses.at(pose), pose + 1, kBoardPoses)};
  }
  std::vector<std::string> names;
  for (const auto& s : sheet.scenes) {
    if (s.name != name) continue;
    for (const auto& a : s.artefacts) names.push_back(a.name);
  }
  return {name, fmt::format("Put into the volume: {} (scene {}, measured {} untouched)", fmt::join(names, ", "), name,
                            times(repeats))};
}

}  // namespace

struct OperatedCommission::Devices {
  explicit Devices(const hw::ScannerFile& wiring) : camera(wiring.camera), plc(hw::open_plc(wiring.plc_address)) {}
  hw::AravisCamera camera;
  std::unique_ptr<hw::RegisterPlc> plc;
};

OperatedCommission::OperatedCommission(const CommissionSession& session, InstrumentSheet sheet, hw::ScannerFile wiring,
                                       std::stop_token stop)
    : CommissionScanner(session, std::move(sheet), stop), operator_(std::move(stop)), wiring_(std::move(wiring)) {}

OperatedCommission::~OperatedCommission() = default;

Capture OperatedCommission::capture(const std::string& name, const std::string& scene) {
  check_stop();
  const auto folder = session_.path(name);
  hw::discard_partial_capture(folder);
  if (session_.has(name)) return read_capture(folder);
  if (!devices_) devices_ = std::make_unique<Devices>(wiring_);
  const Placement placement = placement_of(scene, sheet(), session_.choices().repeats);
  if (placement.place != in_place_) operator_.ask(placement.what);
  in_place_ = placement.place;
  if (!turn_.empty()) operator_.ask(turn_);
  turn_.clear();
  hw::CaptureOptions options;
  options.folder = folder;
  options.plan = wiring_.plan;
  options.exposure_ms = wiring_.exposure_ms;
  options.lamp_level = wiring_.lamp_level;
  options.source = fmt::format("commissioning of {}: {}", sheet().name, name);
  hw::SystemClock clock;
  hw::CaptureSequence sequence(devices_->camera, *devices_->plc, clock, options);
  for (const std::string& event : sequence.run(stop_).events) fmt::print(stderr, "{}: {}\n", name, event);
  return read_capture(folder);
}

void OperatedCommission::turn_adjuster(double turn_mrad, Turned turned) {
  if (turned == Turned::before) return;
  calib::AlignmentLoopOptions loop;
  if (sheet().mrad_per_division) loop.rad_per_division = 1e-3 * *sheet().mrad_per_division;
  turn_ = calib::turn_words(1e-3 * turn_mrad, loop);
  turn_.front() = 'T';
  if (turned == Turned::perhaps) turn_ += ", unless that was done before the stop";
}

}  // namespace fringecal::cli

#include "cli/commission_scanner.h"

#include "cli/scene_selection.h"
#include "cli/virtual_child.h"
#include "core/error.h"
#include "core/file.h"
#include "hw/capture_sequence.h"
#include "hw/open_plc.h"
#include "hw/plc_map.h"
#include "hw/scanner_file.h"
#include "hw/virtual/direct_scanner.h"

#include <fmt/format.h>

#include <cstdio>
#include <optional>

namespace fringecal::cli {

struct VirtualCommission::Devices {
  std::optional<VirtualChild> child;  // destroyed last, when nobody talks to it any more
  std::unique_ptr<virt::DirectScanner> direct;
  std::unique_ptr<hw::AravisCamera> aravis;
  std::unique_ptr<hw::RegisterPlc> link;
  hw::CaptureOptions capture_options;  // of the scanner: plan, exposure, lamp

  hw::Camera& camera() { return direct ? direct->camera() : *aravis; }
  hw::RegisterPlc& plc() { return direct ? direct->plc() : *link; }
};

VirtualCommission::VirtualCommission(const CommissionSession& session, CommissionScannerOptions options,
                                     std::stop_token stop)
    : VirtualCommission(session, std::move(options), std::move(stop),
                        virt::VirtualScanner(session.choices().preset, session.choices().seed,
                                             {.theta_mrad = session.choices().theta_mrad})) {}

VirtualCommission::VirtualCommission(const CommissionSession& session, CommissionScannerOptions options,
                                     std::stop_token stop, virt::VirtualScanner instrument)
    : CommissionScanner(session, sheet_of(instrument, session.choices()), std::move(stop)),
      options_(std::move(options)),
      instrument_(std::move(instrument)) {}

VirtualCommission::~VirtualCommission() = default;

VirtualCommission::Devices& VirtualCommission::devices() {
  if (devices_) return *devices_;
  const CommissionChoices& choices = session_.choices();
  auto d = std::make_unique<Devices>();
  hw::ScannerFile file;
  file.exposure_ms = instrument_.camera_data().exposure_ms;
  file.plan = instrument_.plan();
  if (options_.in_process) {
    d->direct = std::make_unique<virt::DirectScanner>(instrument_, choices.seed);
  } else {
    std::vector<std::string> arguments = {"--preset", choices.preset, "--seed", std::to_string(choices.seed)};
    if (choices.theta_mrad) arguments.insert(arguments.end(), {"--theta", fmt::format("{}", *choices.theta_mrad)});
    if (!options_.frame_log.empty()) arguments.insert(arguments.end(), {"--frame-log", options_.frame_log});
    d->child.emplace(arguments);
    file.camera.address = d->child->camera();
    file.camera.pixel_format = d->child->pixel_format();
    file.plc_address = d->child->plc();
    write_atomically(session_.path("scanner.toml"), to_toml(file));
    file = hw::read_scanner_file(session_.path("scanner.toml"));
    d->aravis = std::make_unique<hw::AravisCamera>(file.camera);
    d->link = hw::open_plc(file.plc_address);
  }
  d->capture_options.plan = file.plan;
  d->capture_options.exposure_ms = file.exposure_ms;
  d->capture_options.lamp_level = file.lamp_level;
  devices_ = std::move(d);
  turns_made_ = 0;
  return *devices_;
}

void CommissionScanner::check_stop() const {
  if (!stop_.stop_requested()) return;
  throw hw::CaptureStopped(
      fmt::format("the commissioning was stopped; what is finished is kept in {}, the same command continues there",
                  session_.folder().string()));
}

Capture VirtualCommission::capture(const std::string& name, const std::string& scene) {
  check_stop();
  const auto folder = session_.path(name);
  if (session_.has(name)) {
    hw::discard_partial_capture(folder);
    return read_capture(folder);
  }
  Devices& d = devices();
  while (turns_made_ < turns_mrad_.size()) d.plc().turn_mrad(turns_mrad_[turns_made_++]);
  hw::VirtualSelection selection = scene_selection(scene);
  selection.stack_seed = session_.stack_seed(name);
  d.plc().select(selection);
  hw::CaptureOptions options = d.capture_options;
  options.folder = folder;
  if (options_.in_process)
    options.motion_limit = std::chrono::minutes(30);  // a scene is rendered while its stage "moves"
  options.source = fmt::format("commissioning of the virtual scanner {}, seed {}: {}", session_.choices().preset,
                               session_.choices().seed, name);
  hw::SystemClock clock;
  hw::CaptureSequence sequence(d.camera(), d.plc(), clock, options);
  for (const std::string& event : sequence.run(stop_).events) fmt::print(stderr, "{}: {}\n", name, event);
  return read_capture(folder);
}

void VirtualCommission::turn_adjuster(double turn_mrad, Turned) {
  turns_mrad_.push_back(hw::register_turn_mrad(turn_mrad));
}

std::optional<Value> VirtualCommission::truth() const {
  virt::InstrumentState state;
  for (const double turn : turns_mrad_) instrument_.turn_adjuster(turn, state);
  return instrument_.truth(state);
}

}  // namespace fringecal::cli

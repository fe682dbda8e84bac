#include "hw/virtual/scanner_view.h"

#include "hw/plc_map.h"

#include <chrono>
#include <string_view>
#include <utility>

namespace fringecal::virt {

ScannerView::ScannerView(const VirtualScanner& scanner, PlcCore& plc)
    : scanner_(scanner),
      plc_(plc),
      dark_(scanner.see({}, {})),
      ahead_([this](const std::stop_token& stop) { work_ahead(stop); }) {
  plc_.wait_for_scene([this](const hw::VirtualSelection& selection) {
    const std::string name = scene_name(selection);
    const std::lock_guard lock(mutex_);
    return seen_.second && seen_.first == SceneKey{name, selection.warm_up_min};
  });
}

ScannerView::~ScannerView() {
  plc_.wait_for_scene({});
  ahead_.request_stop();
  changed_.notify_all();
}

ScannerView::Request ScannerView::request(double exposure_ms) {
  const ScannerSnapshot now = plc_.snapshot();
  Request r;
  r.scene = now.scene_name;
  r.warm_up_min = now.selection.warm_up_min;
  r.turns_mrad = now.adjuster_turns_mrad;
  r.stack_seed = now.selection.stack_seed;
  r.exposure = exposure_ms / scanner_.camera_data().exposure_ms;
  const bool lit = now.lamp_on && now.lamp_level > 0 && now.settled && now.pattern;
  if (lit && static_cast<std::size_t>(*now.pattern) < scanner_.plan().patterns.size()) {
    r.pattern = static_cast<std::size_t>(*now.pattern);
    r.lamp = now.lamp_level;
  }
  return r;
}

InstrumentState ScannerView::state_of(const Request& r) const {
  InstrumentState state;
  for (const double turn : r.turns_mrad) scanner_.turn_adjuster(turn, state);
  if (r.warm_up_min != hw::kWarmedUp) state.minutes_since_start = r.warm_up_min;
  state.exposure = r.exposure;
  return state;
}

InstrumentState ScannerView::state() { return state_of(request(scanner_.camera_data().exposure_ms)); }

Scene ScannerView::scene_of(const std::string& name) const {
  constexpr std::string_view kCalibration = "calibration ";
  const bool missing = name.empty() || (name.starts_with(kCalibration) &&
                                        std::stoi(name.substr(kCalibration.size())) >= scanner_.calibration_scenes());
  return missing ? Scene{} : scanner_.standard_scene(name);
}

std::shared_ptr<const SeenScene> ScannerView::seen(const Request& r) {
  if (!r.pattern) return dark_;
  const std::lock_guard one(seeing_);
  {
    const std::lock_guard lock(mutex_);
    if (seen_.second && seen_.first == key_of(r)) return seen_.second;
  }
  auto fresh = scanner_.see(scene_of(r.scene), state_of(r));
  const std::lock_guard lock(mutex_);
  seen_ = {key_of(r), fresh};
  return fresh;
}

GrayImage ScannerView::render(const Request& r) {
  return scanner_.frame(*seen(r), state_of(r), r.stack_seed, {.pattern = r.pattern, .lamp = r.lamp});
}

GrayImage ScannerView::picture(double exposure_ms) {
  const Request r = request(exposure_ms);
  std::optional<GrayImage> image;
  {
    std::unique_lock lock(mutex_);
    wanted_.reset();
    changed_.wait(lock, [&] { return under_way_ != r; });
    if (last_ && last_->first == r) return last_->second;  // the same bytes; whoever looks on wants no other pattern
    if (ready_ && ready_->first == r) image = std::move(ready_->second);
    ready_.reset();
  }
  if (!image) image = render(r);
  const std::lock_guard lock(mutex_);
  last_.emplace(r, *image);
  if (r.pattern && *r.pattern + 1 < scanner_.plan().patterns.size()) {
    wanted_ = r;
    ++*wanted_->pattern;
    changed_.notify_all();
  }
  return std::move(*image);
}

void ScannerView::work_ahead(const std::stop_token& stop) {
  constexpr std::chrono::milliseconds kLook{5};
  while (!stop.stop_requested()) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, kLook, [&] { return wanted_.has_value(); });
    if (wanted_) {
      under_way_ = std::exchange(wanted_, std::nullopt);
      lock.unlock();
      GrayImage image = render(*under_way_);
      lock.lock();
      ready_.emplace(*under_way_, std::move(image));
      under_way_.reset();
      changed_.notify_all();
      continue;
    }
    lock.unlock();
    Request r = request(scanner_.camera_data().exposure_ms);
    r.pattern = 0;  // any; the geometry does not depend on it
    seen(r);
  }
}

}  // namespace fringecal::virt

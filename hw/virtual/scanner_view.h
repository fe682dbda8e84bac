// ScannerView: what the virtual camera sees at a trigger: the scene that the PLC's registers select, lit by the pattern
// in the light path, at the camera's exposure.
//
//   state    adjuster: all turns made so far, in their order; warm-up from its register; light factor =
//            exposure / exposure of the data sheet
//   light    lamp off, or no pattern at rest in the light path: ambient light only
// A picture is a function of (scene, pose, warm-up, turns, stack seed, pattern, exposure, lamp): taken again it has the
// same bytes, and at the data sheet's exposure those of VirtualScanner::capture().
//
// The geometry of a scene takes longer than a picture. A thread of its own looks at the registers and computes it as
// soon as a scene is selected, and the picture of the next pattern while the last one is under way; the stage does not
// arrive before the scene is there. A picture that is asked for again at once (a live view) is the one of before. That
// changes when things are computed, not what.
// A scene that the instrument does not have (calibration 99) is an empty one.
#pragma once

#include "core/image.h"
#include "hw/virtual/plc_core.h"
#include "hw/virtual/virtual_scanner.h"

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace fringecal::virt {

class ScannerView {
 public:
  /// Both must outlive it.
  ScannerView(const VirtualScanner& scanner, PlcCore& plc);
  ~ScannerView();

  GrayImage picture(double exposure_ms);
  /// The instrument as the registers have it now, for truth files.
  InstrumentState state();

 private:
  struct Request {
    std::string scene;
    std::uint16_t warm_up_min = 0;
    std::vector<double> turns_mrad;
    std::uint64_t stack_seed = 0;
    std::optional<std::size_t> pattern;  // absent: only the ambient light
    double lamp = 0, exposure = 1;

    friend bool operator==(const Request&, const Request&) = default;
  };

  Request request(double exposure_ms);
  InstrumentState state_of(const Request& r) const;
  std::shared_ptr<const SeenScene> seen(const Request& r);
  Scene scene_of(const std::string& name) const;
  GrayImage render(const Request& r);
  void work_ahead(const std::stop_token& stop);

  const VirtualScanner& scanner_;
  PlcCore& plc_;

  /// What a scene's geometry depends on.
  using SceneKey = std::pair<std::string, std::uint16_t>;
  static SceneKey key_of(const Request& r) { return {r.scene, r.warm_up_min}; }

  const std::shared_ptr<const SeenScene> dark_;  // without light every scene looks the same
  std::mutex seeing_;                            // one scene is computed at a time

  std::mutex mutex_;
  std::pair<SceneKey, std::shared_ptr<const SeenScene>> seen_;
  std::condition_variable_any changed_;
  std::optional<Request> wanted_, under_way_;                  // the next picture, by the thread
  std::optional<std::pair<Request, GrayImage>> ready_, last_;  // computed ahead; handed out last
  std::jthread ahead_;
};

}  // namespace fringecal::virt

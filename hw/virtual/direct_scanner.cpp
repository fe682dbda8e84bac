#include "hw/virtual/direct_scanner.h"

#include <fmt/format.h>

namespace fringecal::virt {

PlcCoreOptions plc_options_of(const VirtualScanner& scanner) {
  PlcCoreOptions options;
  options.patterns = static_cast<int>(scanner.plan().patterns.size());
  options.pitch_mm = scanner.pattern_pitch_mm();
  options.watchdog = std::chrono::seconds(10);  // a client that writes large frames to a slow disk
  return options;
}

FakeCameraOptions camera_options_of(const VirtualScanner& scanner, std::uint64_t instrument_seed) {
  const CameraData data = scanner.camera_data();
  FakeCameraOptions options;
  options.serial = fmt::format("V{}", instrument_seed % 100'000'000'000);
  options.width_px = data.width_px;
  options.height_px = data.height_px;
  options.bits = data.bits;
  options.exposure_ms = data.exposure_ms;
  return options;
}

class DirectScanner::DirectCamera final : public hw::Camera {
 public:
  DirectCamera(FakeCameraOptions options, ScannerView& view)
      : options_(std::move(options)), view_(view), exposure_ms_(options_.exposure_ms) {}

  hw::CameraIdentity identity() override {
    return {FakeCamera::kVendor, FakeCamera::kModel, options_.serial, "",
            options_.width_px,   options_.height_px, options_.bits};
  }
  void set_exposure_ms(double exposure_ms) override { exposure_ms_ = exposure_ms; }
  double exposure_ms() override { return exposure_ms_; }
  hw::CameraFrame take_frame(std::chrono::milliseconds) override { return {view_.picture(exposure_ms_), ++frame_id_}; }
  void reopen() override {}

 private:
  FakeCameraOptions options_;
  ScannerView& view_;
  double exposure_ms_;
  std::uint64_t frame_id_ = 0;
};

class DirectScanner::DirectPlc final : public hw::RegisterPlc {
 public:
  explicit DirectPlc(PlcCore& core) : RegisterPlc("virtual PLC", {}), core_(core) {}
  void reopen() override {}

 protected:
  void read_words(std::uint16_t first, std::span<std::uint16_t> words) override {
    if (!core_.read(first, words)) throw hw::PlcFault("no such register");
  }
  void write_words(std::uint16_t first, std::span<const std::uint16_t> words) override {
    if (!core_.write(first, words)) throw hw::PlcFault("not to be written");
  }

 private:
  PlcCore& core_;
};

namespace {

/// Nobody supervises a stage of no mass: a scene is rendered while it "moves", for as long as a busy machine takes.
PlcCoreOptions patient(PlcCoreOptions options) {
  options.motion_limit = options.watchdog = std::chrono::minutes(30);
  return options;
}

}  // namespace

DirectScanner::DirectScanner(const VirtualScanner& scanner, std::uint64_t instrument_seed)
    : core_(patient(plc_options_of(scanner))),
      view_(scanner, core_),
      camera_(std::make_unique<DirectCamera>(camera_options_of(scanner, instrument_seed), view_)),
      plc_(std::make_unique<DirectPlc>(core_)) {}

DirectScanner::~DirectScanner() = default;

hw::Camera& DirectScanner::camera() { return *camera_; }
hw::RegisterPlc& DirectScanner::plc() { return *plc_; }

}  // namespace fringecal::virt

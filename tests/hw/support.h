// What the tests of the hardware code share: a clock that jumps, a camera without a sensor, a PLC without a wire.
#pragma once

#include "hw/camera.h"
#include "hw/clock.h"
#include "hw/register_plc.h"
#include "hw/virtual/plc_core.h"
#include "tests/support/temporary_folder.h"

#include <atomic>
#include <functional>
#include <string>
#include <vector>

namespace fringecal::hw::test {

/// Time passes only while somebody sleeps.
class FakeClock : public Clock {
 public:
  TimePoint now() const override { return TimePoint(std::chrono::microseconds(us_.load())); }
  void sleep_for(std::chrono::microseconds duration) override { us_ += duration.count(); }

 private:
  std::atomic<std::int64_t> us_{1'000'000'000};
};

/// The register map directly on the virtual PLC's core.
class CorePlc : public RegisterPlc {
 public:
  explicit CorePlc(virt::PlcCore& core) : RegisterPlc("PLC under test", {}), core_(&core) {}

  void reopen() override {
    ++reopened;
    if (on_reopen) on_reopen();
  }
  void use(virt::PlcCore& core) { core_ = &core; }

  int reopened = 0;
  std::function<void()> on_reopen;
  std::function<void(std::uint16_t first, std::span<const std::uint16_t> words)> on_write;
  std::function<void()> on_read;

 protected:
  void read_words(std::uint16_t first, std::span<std::uint16_t> words) override {
    if (on_read) on_read();
    if (!core_->read(first, words)) throw PlcFault("no such register");
  }
  void write_words(std::uint16_t first, std::span<const std::uint16_t> words) override {
    if (on_write) on_write(first, words);
    if (!core_->write(first, words)) throw PlcFault("not to be written");
  }

 private:
  virt::PlcCore* core_;
};

/// Sees what stands in the light path: grey level = number of the pattern + 100 (lit) per ms of exposure in the left
/// half; in the right half a tenth of that, halved in every second pair of patterns.
class FakeCamera : public Camera {
 public:
  explicit FakeCamera(virt::PlcCore& core) : core_(&core) {}

  CameraIdentity identity() override { return {"Acme", "Eye", "7", "1.0", kWidth, kHeight, 8}; }
  void set_exposure_ms(double exposure_ms) override { exposure_ms_ = exposure_ms; }
  double exposure_ms() override { return exposure_ms_; }
  CameraFrame take_frame(std::chrono::milliseconds) override {
    ++triggers;
    if (on_trigger) on_trigger(triggers);
    const auto seen = core_->snapshot();
    taken.push_back(seen.pattern.value_or(-1));
    const double light = seen.lamp_on && seen.settled ? exposure_ms_ * 100 : 0;
    Image8 image(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const int k = seen.pattern.value_or(0);
        const double level = k + (x < kWidth / 2 ? light : k % 4 < 2 ? light / 10 : light / 20);
        image(x, y) = static_cast<std::uint8_t>(std::min(255.0, level));
      }
    }
    return {std::move(image), repeat_id ? last_id_ : ++last_id_};
  }
  void reopen() override {
    ++reopened;
    if (on_reopen) on_reopen();
  }

  void use(virt::PlcCore& core) { core_ = &core; }

  static constexpr int kWidth = 8, kHeight = 4;
  int triggers = 0, reopened = 0;
  bool repeat_id = false;
  std::vector<int> taken;  // the pattern of every frame handed over
  std::function<void(int trigger)> on_trigger;
  std::function<void()> on_reopen;

 private:
  virt::PlcCore* core_;
  double exposure_ms_ = 1.0;
  std::uint64_t last_id_ = 0;
};

using fringecal::test::memory_folder;
using fringecal::test::TemporaryFolder;

}  // namespace fringecal::hw::test

// Tests of the virtual scanner as a process and of the commands against it, over the real protocols. The instrument is
// chen2008 with a sixteenth of its pixels, each four times as large.
#pragma once

#include "core/capture.h"
#include "tests/hw/virtual_support.h"
#include "tests/support/program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <type_traits>
#include <vector>

namespace fringecal::test {

inline bool same_bytes(const std::vector<GrayImage>& a, const std::vector<GrayImage>& b) {
  const auto same = [](const GrayImage& one, const GrayImage& other) {
    return std::visit(
        [&](const auto& image) {
          const auto* partner = std::get_if<std::decay_t<decltype(image)>>(&other);
          return partner && partner->width() == image.width() && partner->values() == image.values();
        },
        one);
  };
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
}

class VirtualProcess : public testing::Test {
 protected:
  std::string preset() const { return small_.file(); }
  std::string scanner_file() const { return (scratch / "scanner.toml").string(); }
  std::vector<std::string> serve(const std::string& address, std::vector<std::string> more = {}) const {
    std::vector<std::string> out = {"virtual",   "--preset", preset(),         "--seed",      "7",
                                    "--address", address,    "--scanner-file", scanner_file()};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  std::vector<std::string> capture(const std::string& name, std::vector<std::string> more = {}) const {
    std::vector<std::string> out = {"capture",    "--scanner", scanner_file(), "-o", (scratch / name).string(),
                                    "--exposure", "20"};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  /// The frames as the simulation gives them without any wire.
  std::vector<GrayImage> rendered(const std::string& scene, std::uint64_t stack_seed, int bits = 8,
                                  double exposure = 1) const {
    const virt::VirtualScanner scanner(preset(), 7, {.theta_mrad = {}, .bits = bits});
    return scanner.capture(scanner.standard_scene(scene), {.exposure = exposure}, stack_seed).frames;
  }

  test::TemporaryFolder scratch;

 private:
  virt::ChangedPreset small_{virt::few_pixels()};
};

}  // namespace fringecal::test

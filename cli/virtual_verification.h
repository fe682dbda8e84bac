// The virtual scanner as a verification sees it: commissioned, aligned as its commissioning left it, with artefacts
// whose certificates it wrote itself.
#pragma once

#include "hw/virtual/virtual_scanner.h"
#include "metrology/artefact_file.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fringecal::cli {

class VirtualVerification {
 public:
  /// folder: a finished commissioning of the virtual scanner. Throws InputError where it is not one, or not finished.
  explicit VirtualVerification(const std::filesystem::path& folder);

  std::filesystem::path scanner_file() const { return folder_ / "scanner.json"; }
  std::string identification() const;
  /// The certificates of this instance's artefacts.
  std::vector<metrology::Gauge> gauges() const;
  /// plan: part of the stack's seed, so that two plans do not measure with the same noise.
  Capture capture(const std::string& plan, const std::string& scene, int place) const;

 private:
  std::filesystem::path folder_;
  std::string preset_;
  std::uint64_t seed_ = 0;
  virt::VirtualScanner instrument_;
  virt::InstrumentState state_;
};

}  // namespace fringecal::cli

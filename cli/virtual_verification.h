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

/// The certificates of the artefacts of that instance.
std::vector<metrology::Gauge> gauges_of(const virt::VirtualScanner& instrument, std::uint64_t instrument_seed);

class VirtualVerification {
 public:
  /// folder: a finished commissioning of the virtual scanner. Throws InputError where it is not one, or not finished.
  explicit VirtualVerification(const std::filesystem::path& folder);

  std::filesystem::path scanner_file() const { return folder_ / "scanner.json"; }
  std::string identification() const;
  /// The certificates of this instance's artefacts.
  std::vector<metrology::Gauge> gauges() const { return gauges_of(instrument_, seed_); }
  /// From now on the instrument is no longer what was commissioned.
  void befall(const virt::Faults& faults, double room_degC);
  /// Which verification of this commissioning this is: 1, 2, ... of a plan. Taken once and for all, also where several
  /// programs ask at once; the folder `verifications` keeps a file for each.
  int take_run(const std::string& plan) const;
  /// plan and run: part of the stack's seed and of the hand that puts the artefact there, so that two verifications are two
  /// measurements, and each is the same whenever it is made again.
  /// scene: "probing 3", as the virtual scanner names it. again: the how many-th capture of what was left there, from 0.
  Capture capture(const std::string& plan, const std::string& scene, int run = 1, int again = 0) const;
  /// The true instrument. For tests only.
  Value truth() const { return instrument_.truth(state_); }

 private:
  std::filesystem::path folder_;
  std::string preset_;
  std::uint64_t seed_ = 0;
  virt::VirtualScanner instrument_;
  virt::InstrumentState state_;
};

}  // namespace fringecal::cli

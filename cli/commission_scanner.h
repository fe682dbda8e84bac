// The scanner that is commissioned: a camera and a PLC, and what a laboratory knows of the instrument on paper.
//
// The virtual scanner is `fringecal virtual` in a process of its own, reached through the same camera, PLC and capture
// sequence as a real one; scanner.toml in the session's folder says where. In process, the same capture sequence asks
// the virtual devices without a wire: the results are the same to the byte. Nothing is started before the first capture
// that is missing.
//
// Resuming. A virtual scanner that is switched on again has forgotten its adjuster's turns, and gets all of them again
// in their order; its pictures are functions of that, the scene and the capture's name, so it continues as if it had
// never been off. A capture that is on disk is read, one that is there in part is completed.
#pragma once

#include "cli/commission_session.h"
#include "core/capture.h"
#include "hw/virtual/virtual_scanner.h"

#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace fringecal::cli {

struct CommissionScannerOptions {
  bool in_process = false;
  std::string frame_log = {};  // of the virtual scanner's process; empty: none
};

class CommissionScanner {
 public:
  CommissionScanner(const CommissionSession& session, CommissionScannerOptions options, std::stop_token stop);
  ~CommissionScanner();

  /// The capture of that name in the session, of a standard scene. Throws as CaptureSequence::run().
  Capture capture(const std::string& name, const std::string& scene);
  /// Throws hw::CaptureStopped where a stop was asked for.
  void check_stop() const;
  /// Turns the adjuster; the next capture sees it.
  void turn_adjuster(double turn_mrad);

  /// Data sheets and certificates. (What is drawn for this instrument is reached through truth() alone.)
  const virt::VirtualScanner& sheet() const { return instrument_; }
  /// For the truth file of tests.
  Value truth() const;

 private:
  struct Devices;
  Devices& devices();

  const CommissionSession& session_;
  CommissionScannerOptions options_;
  std::stop_token stop_;
  virt::VirtualScanner instrument_;
  std::vector<double> turns_mrad_;
  std::size_t turns_made_ = 0;
  std::unique_ptr<Devices> devices_;
};

}  // namespace fringecal::cli

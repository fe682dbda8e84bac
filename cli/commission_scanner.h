// The scanner that is commissioned: its captures, its adjuster, and what a laboratory knows of it on paper.
//
// VirtualCommission: `fringecal virtual` in a process of its own, reached through the same camera, PLC and capture
// sequence as a real one; scanner.toml in the session's folder says where. In process, the same capture sequence asks
// the virtual devices without a wire: the results are the same to the byte. Nothing is started before the first capture
// that is missing.
//
// OperatedCommission: a scanner of one's own. Its operator is asked to place what is captured next, and to turn the adjuster.
//
// Resuming. A capture that is on disk is read. A virtual scanner that is switched on again has forgotten its adjuster's
// turns, and gets all of them again in their order; its pictures are functions of that, the scene and the capture's
// name, so it continues as if it had never been off, and a capture that is there in part is completed. With an operator
// it is taken afresh: nobody knows what was moved meanwhile.
#pragma once

#include "cli/commission_session.h"
#include "cli/instrument_sheet.h"
#include "cli/operator.h"
#include "core/capture.h"
#include "hw/scanner_file.h"
#include "hw/virtual/virtual_scanner.h"

#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace fringecal::cli {

struct CommissionScannerOptions {
  bool in_process = false;
  std::string frame_log = {};  // of the virtual scanner's process; empty: none
};

/// Of a turn of the adjuster that an earlier call asked for: whether a later capture shows it.
enum class Turned { not_yet, perhaps, before };

class CommissionScanner {
 public:
  CommissionScanner(const CommissionSession& session, InstrumentSheet sheet, std::stop_token stop)
      : session_(session), stop_(std::move(stop)), sheet_(std::move(sheet)) {}
  virtual ~CommissionScanner() = default;

  /// The capture of that name in the session, of "alignment" (the flat board), "calibration N" (the board's pose N) or
  /// "SCENE N" (the repeat N of one of the sheet's). Throws as CaptureSequence::run().
  virtual Capture capture(const std::string& name, const std::string& scene) = 0;
  /// Turns the adjuster; the next capture sees it.
  virtual void turn_adjuster(double turn_mrad, Turned turned) = 0;
  /// For the truth file of tests; none where nobody knows it.
  virtual std::optional<Value> truth() const { return {}; }

  /// Throws hw::CaptureStopped where a stop was asked for.
  void check_stop() const;
  const InstrumentSheet& sheet() const { return sheet_; }

 protected:
  const CommissionSession& session_;
  std::stop_token stop_;

 private:
  InstrumentSheet sheet_;
};

class VirtualCommission : public CommissionScanner {
 public:
  VirtualCommission(const CommissionSession& session, CommissionScannerOptions options, std::stop_token stop);
  ~VirtualCommission() override;
  Capture capture(const std::string& name, const std::string& scene) override;
  void turn_adjuster(double turn_mrad, Turned turned) override;
  std::optional<Value> truth() const override;

 private:
  struct Devices;
  VirtualCommission(const CommissionSession& session, CommissionScannerOptions options, std::stop_token stop,
                    virt::VirtualScanner instrument);
  Devices& devices();

  CommissionScannerOptions options_;
  virt::VirtualScanner instrument_;
  std::vector<double> turns_mrad_;
  std::size_t turns_made_ = 0;
  std::unique_ptr<Devices> devices_;
};

class OperatedCommission : public CommissionScanner {
 public:
  /// wiring: of scanner.toml.
  OperatedCommission(const CommissionSession& session, InstrumentSheet sheet, hw::ScannerFile wiring,
                     std::stop_token stop);
  ~OperatedCommission() override;
  Capture capture(const std::string& name, const std::string& scene) override;
  void turn_adjuster(double turn_mrad, Turned turned) override;

 private:
  struct Devices;

  Operator operator_;
  hw::ScannerFile wiring_;
  std::string in_place_, turn_;  // what stands before the scanner; the turn that is still to be made, in words
  std::unique_ptr<Devices> devices_;
};

}  // namespace fringecal::cli

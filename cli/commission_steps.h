// The steps of a commissioning, each resumable, each leaving its results as files in the
// session.
//   alignment/iteration-N/     Capture of the flat board
//   alignment/record.json      what was measured and done in each iteration (calib/align_record.h)
//   linearisation/stack-N/     Captures of the flat board, aligned
//   linearisation.json         the phase-linearisation table from them
//   calibration/pose-NN/       Captures of the board
//   calibration/pose-NN-corners.json  where its corners are in the picture
//   calibration/so-far.json    the Scanner of the poses so far, until scanner.json is there
//   calibration/poses.json     which of them were used
//   scanner.json               camera, projector, and the paper's closed form fitted to them
//   verification/SCENE-NN.json one repeat: every artefact through the three models; frames and deviation maps stay of
//                              the first
#pragma once

#include "calib/model/phase_linearisation.h"
#include "cli/commission_scanner.h"
#include "cli/commission_session.h"
#include "cli/progress.h"
#include "reports/commissioning_report.h"

#include <string>
#include <vector>

namespace fringecal::cli {

inline constexpr int kMaxAlignments = 6;
inline constexpr int kFlatStacks = 4;  // the fixed two cycles to half of what a stack adds; the table to 0.05 mrad
inline constexpr int kBoardPoses = 15;

/// Relative durations of the items, for the estimate of the time left.
struct Weights {
  static constexpr double alignment = 1.0, flat = 1.0, pose = 1.2, solve = 6.0, repeat = 1.6, report = 3.0;
  static double total(std::size_t scenes, int repeats);
};

/// Turns the grating until it is aligned.
void align_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);
/// The periodic phase errors that stay, from stacks of the flat board on the aligned instrument.
void linearise_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);
/// Name of a capture of linearise_step, which calibrate_step looks at again.
std::string flat_stack_name(int number);
/// What linearise_step left.
model::PhaseLinearisation load_linearisation(const CommissionSession& session);
void calibrate_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);
void verify_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);

/// The alignment, as found and as left, and the calibration as entries of a history; once, however often the
/// commissioning is continued.
void record_step(const CommissionSession& session, const InstrumentSheet& sheet, const std::string& history);

/// Everything the report shows, read from the session's files.
reports::CommissioningReport gather_report(const CommissionSession& session, const CommissionScanner& commissioned);

/// "once", "10 times".
std::string times(int n);
/// The table of the summary, for stdout.
std::string summary_table(const reports::CommissioningReport& report);

}  // namespace fringecal::cli

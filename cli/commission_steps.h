// The steps of a commissioning on the virtual scanner, each resumable, each leaving its results as files in the
// session.
//   alignment/iteration-N/     Capture of the flat board
//   alignment/record.json      what was measured and done in each iteration (calib/align_record.h)
//   calibration/pose-NN/       Captures of the board
//   calibration/poses.json     which of them were used
//   scanner.json               camera, projector, and the paper's closed form fitted to them
//   verification/SCENE-NN.json one repeat: every artefact through the three models; frames and deviation maps stay of
//                              the first
#pragma once

#include "cli/commission_scanner.h"
#include "cli/commission_session.h"
#include "cli/progress.h"
#include "metrology/artefact.h"
#include "reports/commissioning_report.h"

#include <string>
#include <vector>

namespace fringecal::cli {

inline constexpr int kMaxAlignments = 6;
inline constexpr int kBoardPoses = 15;

/// What is measured in the verification: the paper's section 4.
struct VerificationScene {
  std::string name;  // "plane", "spheres", "cylinder": standard scenes of the virtual scanner
  std::vector<metrology::NominalArtefact> artefacts;
};
std::vector<VerificationScene> verification_scenes();

/// Relative durations of the items, for the estimate of the time left.
struct Weights {
  static constexpr double alignment = 1.0, pose = 1.2, solve = 6.0, repeat = 1.6, report = 3.0;
  static double total(int repeats);
};

/// Turns the grating until it is aligned.
void align_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);
void calibrate_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);
void verify_step(const CommissionSession& session, CommissionScanner& instrument, Progress& progress);

/// Everything the report shows, read from the session's files.
reports::CommissioningReport gather_report(const CommissionSession& session, const CommissionScanner& commissioned);

/// The table of the summary, for stdout.
std::string summary_table(const reports::CommissioningReport& report);

}  // namespace fringecal::cli

// After a commissioning: what it leaves in the scanner's history.
#include "cli/alignment_entry.h"
#include "cli/commission_steps.h"
#include "core/capture.h"
#include "core/file.h"

#include <fmt/format.h>

namespace fringecal::cli {
namespace {

void add_capture(const CommissionSession& session, const std::string& name, AlignmentEntry& entry) {
  const auto file = session.path(name) / "capture.json";
  entry.captures.push_back(read_capture_info(session.path(name)));
  entry.inputs.emplace_back(name + "/capture.json", sha256_of_file(file));
}

}  // namespace

void record_step(const CommissionSession& session, const InstrumentSheet& sheet, const std::string& history) {
  const std::string record_file = "alignment/record.json";
  AlignmentEntry alignment{.scanner = sheet.identification, .ended = utc_now()};
  const auto iterations = calib::read_record(session.path(record_file)).iterations;
  for (std::size_t i = 0; i < iterations.size(); ++i) {
    add_capture(session, fmt::format("alignment/iteration-{}", i), alignment);
  }
  alignment.inputs.emplace_back(record_file, sha256_of_file(session.path(record_file)));
  fmt::print("{}", append_words(history, record_of(alignment, iterations, session.path(record_file).string())));

  auto calibration = metrology::record_of(model::read_scanner(session.path("scanner.json")), utc_now());
  calibration.scanner = sheet.identification;
  std::vector<CaptureInfo> captures;
  captures.reserve(kBoardPoses);
  for (int i = 0; i < kBoardPoses; ++i) {
    captures.push_back(read_capture_info(session.path(fmt::format("calibration/pose-{:02}", i))));
  }
  if (auto temperature = metrology::temperature_of(captures)) calibration.quantities.push_back(*temperature);
  calibration.provenance.inputs.emplace_back("scanner.json", sha256_of_file(session.path("scanner.json")));
  fmt::print("{}", append_words(history, calibration));
}

}  // namespace fringecal::cli

// The record of an alignment: what was measured, said and done in each iteration. Schema
// "fringecal.alignment_record", version 1. Reading it back gives the next step the moves made so far, from which it
// learns the adjuster's gain.
#pragma once

#include "calib/align_loop.h"
#include "core/value.h"

#include <filesystem>
#include <vector>

namespace fringecal::calib {

struct AlignmentIteration {
  std::string capture;         // name or folder
  double turn_before_rad = 0;  // made just before this capture
  Misalignment measured = {};
  AlignmentStep step = {};
};

/// Every figure with its unit in the key (um, mrad, px), as reports and --json show it.
Value to_value(const Misalignment& measured);
Value to_value(const AlignmentStep& step);
Value to_value(const AlignmentIteration& iteration);
Value to_value(const AlignmentProfile& profile);

Value record_of(std::span<const AlignmentIteration> iterations);

/// The readings of a record and its iterations as they stand in the file, to be continued. Throws InputError.
struct AlignmentHistory {
  std::vector<AlignmentReading> readings;
  std::vector<Value> iterations;
};
AlignmentHistory read_record(const std::filesystem::path& file);
/// The record with one more iteration.
Value record_of(const AlignmentHistory& before, const AlignmentIteration& latest);

}  // namespace fringecal::calib

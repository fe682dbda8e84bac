// An alignment as an entry of a history.
#pragma once

#include "calib/align_record.h"
#include "metrology/instrument_record.h"

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace fringecal::cli {

struct AlignmentEntry {
  std::string scanner;                                      // identification
  std::string ended;                                        // RFC 3339 UTC
  std::vector<CaptureInfo> captures;                        // for the temperature
  std::vector<std::pair<std::string, std::string>> inputs;  // name, SHA-256
};

/// iterations: as in an alignment record, at least one; the first is "as found", the last "as left", or "on the way"
/// where the adjuster is still to be turned. `file` is for messages. Throws InputError.
metrology::InstrumentRecord record_of(const AlignmentEntry& entry, std::span<const Value> iterations,
                                      const std::string& file);

/// Appended once; the line for people that says where.
std::string append_words(const std::string& history, const metrology::InstrumentRecord& record);

}  // namespace fringecal::cli

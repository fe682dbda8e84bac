// InstrumentRecord: what an alignment or a calibration leaves in the history ("fringecal.instrument_record", version 1):
// the figures whose course over the years says whether the instrument drifts, and the hashes of what they came from.
//
//   alignment    theta / mrad and delta / um of the deciding bit, each "as found" and "as left", delta with the tolerance
//                that the alignment worked to as its limits
//   calibration  kc1, kc2, kp1, kp2, L, b, alpha, p_R of the paper's closed form as fitted to the scanner [Chen2008],
//                f, c, k1 of both lenses and the base line with their uncertainties, the residuals
//   both         temperature / degC, where the captures hold one
// The keys of a quantity are those of a verification (verification.h), so one reader serves both. `artefact` is "scanner".
#pragma once

#include "calib/model/scanner.h"
#include "core/capture.h"
#include "metrology/decision.h"
#include "metrology/history.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

/// The artefact of what belongs to the instrument itself.
inline constexpr const char* kScannerItself = "scanner";

struct RecordedQuantity {
  std::string symbol, name, position;  // position: "as found", "as left"; empty for a single value
  std::string unit;
  double value = 0;
  std::optional<double> u;  // standard uncertainty; absent: not stated
  std::optional<Limits> limits = {};
};

struct InstrumentRecord {
  std::string event;    // "alignment", "calibration": the kind of its entry
  std::string scanner;  // identification
  std::string ended;    // RFC 3339 UTC
  std::string outcome;  // in one sentence
  std::vector<RecordedQuantity> quantities;
  Provenance provenance;
};

/// Of a calibrated scanner; its inputs are the record's. The temperature is the caller's to add (temperature_of()).
InstrumentRecord record_of(const model::Scanner& scanner, const std::string& ended);
/// Mean over the sensors and captures; nothing where there is none.
std::optional<RecordedQuantity> temperature_of(const std::vector<CaptureInfo>& captures);

Value to_value(const InstrumentRecord& record);
/// Throws InputError.
InstrumentRecord instrument_record_from(const Value& value, const std::string& name_in_messages);

/// Appends it as an entry of its kind, unless one with the same inputs stands there already (a run that was continued):
/// then that entry's number is returned.
std::int64_t append_once(History& history, const InstrumentRecord& record);

}  // namespace fringecal::metrology

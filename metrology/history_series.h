// One quantity of the verifications in a history, over time: what a control chart needs.
#pragma once

#include "metrology/control_chart.h"
#include "metrology/history.h"
#include "metrology/verification.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

/// Which line of the verifications: symbol and artefact; position where the artefact stands at several.
struct QuantityKey {
  std::string symbol, artefact;
  std::optional<std::string> position;  // absent: the largest magnitude of all positions
};

struct HistorySeries {
  std::vector<ChartValue> values;     // days since 1970-01-01
  std::vector<std::int64_t> numbers;  // entries they come from
  std::vector<double> U;              // expanded uncertainties
  std::string unit = "mm", name;
  std::optional<Limits> limits;  // of the newest verification
};

/// The document of an entry of kind "verification". Throws InputError with the entry's number.
Verification verification_of(const HistoryEntry& entry);

/// Empty where no verification has the quantity. An entry that cannot be read: InputError with its number.
HistorySeries series_of(const std::vector<HistoryEntry>& entries, const QuantityKey& key);

/// Every (symbol, artefact) that the verifications have, in the order of their first appearance.
std::vector<QuantityKey> quantities_of(const std::vector<HistoryEntry>& entries);

}  // namespace fringecal::metrology

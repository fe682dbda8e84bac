// One quantity of a history over time: what a control chart needs.
//
// A history may be long (a verification every morning makes 100 000 entries of many scanners in a few years), so no
// document is parsed: each is the text that core/value.h wrote, where a key of depth n stands on a line of its own after
// 2 n blanks and a text never holds a line break, and what is wanted is read from those lines. `show` and the
// certificates parse.
#pragma once

#include "metrology/control_chart.h"
#include "metrology/history.h"
#include "metrology/verification.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

/// Which line of the records: symbol and artefact ("scanner" for what belongs to the instrument itself: delta, theta,
/// kc1, ...; "room" for the temperature of every record); position where there are several.
struct QuantityKey {
  std::string symbol, artefact;
  std::optional<std::string> position;  // absent: the largest magnitude of all positions
};

struct HistorySeries {
  std::vector<ChartValue> values;        // days since 1970-01-01
  std::vector<std::int64_t> numbers;     // entries they come from
  std::vector<std::optional<double>> U;  // expanded uncertainties; absent where none is stated
  std::string unit = "mm", name;
  std::optional<Limits> limits;  // of the newest record
};

/// The document of an entry of kind "verification". Throws InputError with the entry's number.
Verification verification_of(const HistoryEntry& entry);

/// Empty where no record has the quantity. An entry that cannot be read: InputError with its number.
HistorySeries series_of(const History& history, const QuantityKey& key);

/// Every (symbol, artefact) that the records have, in the order of their first appearance.
std::vector<QuantityKey> quantities_of(const History& history);

/// What an entry is about, in a few words: plan, scanner and verdict, an alignment's or calibration's outcome, or a
/// certificate's number.
std::string summary_of(const HistoryView& entry);

}  // namespace fringecal::metrology

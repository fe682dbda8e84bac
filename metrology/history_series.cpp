#include "metrology/history_series.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
Verification verification_of(const HistoryEntry& entry) {
  const std::string name = fmt::format("history, entry {}", entry.number);
  return verification_from(parse_json(entry.document, name), name);
}

HistorySeries series_of(const std::vector<HistoryEntry>& entries, const QuantityKey& key) {
  HistorySeries out;
  for (const auto& entry : entries) {
    if (entry.kind != "verification") continue;
    const Verification v = verification_of(entry);
    const Quantity* found = nullptr;
    for (const auto& q : v.quantities) {
      if (q.symbol != key.symbol || q.artefact != key.artefact || (key.position && q.position != *key.position))
        continue;
      if (found == nullptr || std::abs(q.value) > std::abs(found->value)) found = &q;
    }
    if (found == nullptr) continue;
    out.values.push_back({day_of(v.ended), found->value});
    out.numbers.push_back(entry.number);
    out.U.push_back(found->uncertainty.U);
    out.unit = found->unit;
    out.name = found->name;
    out.limits = found->limits;
  }
  return out;
}

std::vector<QuantityKey> quantities_of(const std::vector<HistoryEntry>& entries) {
  std::vector<QuantityKey> out;
  for (const auto& entry : entries) {
    if (entry.kind != "verification") continue;
    for (const auto& q : verification_of(entry).quantities) {
      const bool known = std::any_of(out.begin(), out.end(), [&](const QuantityKey& k) {
        return k.symbol == q.symbol && k.artefact == q.artefact;
      });
      if (!known) out.push_back({q.symbol, q.artefact, std::nullopt});
    }
  }
  return out;
}

}  // namespace fringecal::metrology

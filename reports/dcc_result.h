// What a DCC holds, read back: the results and records of our own certificates, and the certified quantities of anybody's.
// Numbers stay the texts that stand in the document. Missing parts are empty; nothing is judged here.
#pragma once

#include "reports/xml_document.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

/// A quantity with refType fringecal_result.
struct DccResult {
  std::string name, value, unit, U, k;  // unit in D-SI form
  std::optional<std::string> lower, upper;
};

struct DccMeasurement {
  std::vector<DccResult> results;
  std::string record;                 // JSON of the verification record; "" where there is none
  std::optional<std::int64_t> entry;  // of the history, with its hash
  std::string entry_hash;
};

std::vector<DccMeasurement> dcc_measurements(const XmlDocument& document);

/// SHA-256 of data.zip from the statement fringecal_data; "" where there is none.
std::string data_sha256_of(const XmlDocument& document);

/// RFC 4648; white space is skipped. Nothing where it is not base64.
std::optional<std::string> from_base64(const std::string& text);

}  // namespace fringecal::reports

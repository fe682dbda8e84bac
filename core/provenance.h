// Where a result comes from: program version, date, and the hashes of what it was computed from.
#pragma once

#include "core/value.h"

#include <string>
#include <vector>

namespace fringecal {

extern const char* const kProgramVersion;

struct Provenance {
  std::string program = "fringecal";
  std::string version;
  std::string date;                                         // RFC 3339 UTC
  std::vector<std::pair<std::string, std::string>> inputs;  // name, SHA-256
};

/// Version and date of now, no inputs yet.
Provenance provenance_now();
Value to_value(const Provenance& provenance);

}  // namespace fringecal

// Verification records for certificates and reports: from files, or by their numbers from a history.
#pragma once

#include "reports/certificate.h"

#include <filesystem>
#include <string>
#include <vector>

namespace fringecal::cli {

/// history empty: `names` are files. Otherwise they are numbers of its entries, and the history's chain must hold.
/// Throws InputError.
std::vector<reports::Record> read_records(const std::vector<std::string>& names, const std::string& history);

/// dcc.xsd in a folder of PTB's schemas. Throws InputError.
std::filesystem::path schema_in(const std::string& folder);

}  // namespace fringecal::cli

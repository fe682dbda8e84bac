// Verification records for certificates and reports: from files, or by their numbers from a history.
#pragma once

#include "metrology/history.h"
#include "reports/certificate.h"

#include <filesystem>
#include <string>
#include <vector>

namespace fringecal::cli {

/// history empty: `names` are files. Otherwise they are numbers of its entries, and the history's chain must hold.
/// Throws InputError.
std::vector<reports::Record> read_records(const std::vector<std::string>& names, const std::string& history);

/// The residual clouds that the records name, from a folder of `verify`. One that is not there, or is not the one that the
/// record names by its hash: InputError.
void take_clouds(std::vector<reports::Record>& records, const std::filesystem::path& folder);
/// The same from beside the records' files (as-found records first), as far as they are there.
void take_clouds_beside(std::vector<reports::Record>& records, const std::vector<std::string>& as_found,
                        const std::vector<std::string>& as_left);

/// Results of this scanner in the history up to a date: of verifications, and of alignments where they state a value and
/// a unit.
std::vector<reports::PastResult> read_past(const std::string& history, const std::string& scanner,
                                           const std::string& until);

/// A history to append to. Where its newest entry is of a later time than this machine's clock shows, a warning on standard
/// error: the clock was set back, and what is dated by it, and whether certificates have run out, cannot be relied on.
metrology::History history_to_append(const std::string& file);

/// dcc.xsd in a folder of PTB's schemas. Throws InputError.
std::filesystem::path schema_in(const std::string& folder);

}  // namespace fringecal::cli

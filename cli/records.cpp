#include "cli/records.h"

#include "core/error.h"
#include "core/file.h"
#include "metrology/history.h"

#include <fmt/format.h>

#include <charconv>

namespace fringecal::cli {
namespace {

reports::Record record_from(std::string document, const std::string& name) {
  reports::Record out;
  out.verification = metrology::verification_from(parse_json(document, name), name);
  out.sha256 = sha256_hex(document);
  out.document = std::move(document);
  return out;
}

std::int64_t entry_number(const std::string& name) {
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), number);
  if (error != std::errc() || end != name.data() + name.size() || number < 1) {
    throw InputError(
        fmt::format("\"{}\" is not the number of an entry; with --history records are given as 1, 2, ...", name));
  }
  return number;
}

}  // namespace

std::vector<reports::Record> read_records(const std::vector<std::string>& names, const std::string& file) {
  std::vector<reports::Record> out;
  if (file.empty()) {
    for (const auto& name : names) out.push_back(record_from(read_bytes(name), name));
    return out;
  }
  const metrology::History history(file, metrology::History::Access::read);
  if (const auto fault = history.check()) throw InputError(fmt::format("{}: {}", file, fault->sentence));
  for (const auto& name : names) {
    const std::int64_t number = entry_number(name);
    const auto entry = history.entry(number);
    if (entry.kind != "verification") {
      throw InputError(fmt::format("{}: entry {} is of kind \"{}\"; only a verification can be certified", file, number,
                                   entry.kind));
    }
    out.push_back(record_from(entry.document, fmt::format("{}, entry {}", file, number)));
    out.back().entry = number;
    out.back().entry_hash = entry.hash;
    out.back().entry_date = entry.date;
  }
  return out;
}

std::filesystem::path schema_in(const std::string& folder) {
  for (const char* place : {"v3.3.0/dcc.xsd", "dcc.xsd"}) {
    if (std::filesystem::exists(std::filesystem::path(folder) / place)) return std::filesystem::path(folder) / place;
  }
  throw InputError(fmt::format(
      "{}: there is no v3.3.0/dcc.xsd in this folder; it holds PTB's schemas as they are published", folder));
}

}  // namespace fringecal::cli

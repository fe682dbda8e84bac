#include "cli/records.h"

#include "core/error.h"
#include "core/file.h"
#include "metrology/history.h"
#include "metrology/history_series.h"

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

enum class Absent { refused, left_out };

void take_of(reports::Record& record, const std::filesystem::path& folder, Absent absent) {
  for (const auto& feature : record.verification.features) {
    if (feature.cloud.empty()) continue;
    const auto file = folder / feature.cloud;
    if (feature.cloud.find("..") != std::string::npos || feature.cloud.starts_with('/')) {
      throw InputError(fmt::format("the record names a cloud \"{}\" outside of its folder", feature.cloud));
    }
    if (absent == Absent::left_out && !std::filesystem::exists(file)) continue;
    std::string bytes = read_bytes(file);
    if (sha256_hex(bytes) != feature.cloud_sha256) {
      throw InputError(
          fmt::format("{}: not the residual cloud that the record names: its SHA-256 differs", file.string()));
    }
    record.clouds.push_back({feature.cloud, std::move(bytes)});
  }
}

const std::string* text_at(const Value& value, const char* key) {
  const Value* found = value.find(key);
  return found == nullptr ? nullptr : found->if_text();
}

std::optional<double> number_at(const Value& value, const char* key) {
  const Value* found = value.find(key);
  if (found == nullptr) return std::nullopt;
  if (const double* real = found->if_real()) return *real;
  if (const std::int64_t* integer = found->if_integer()) return static_cast<double>(*integer);
  return std::nullopt;
}

/// An alignment's quantities; what a later version adds to its records is no matter here.
std::vector<reports::PastResult> alignment_results(const metrology::HistoryEntry& entry, const std::string& scanner) {
  const Value document = parse_json(entry.document, fmt::format("history, entry {}", entry.number));
  std::vector<reports::PastResult> out;
  const std::string* whose = text_at(document, "scanner");
  const Value* quantities = document.find("quantities");
  if (whose == nullptr || *whose != scanner || quantities == nullptr || quantities->if_array() == nullptr) return out;
  for (const Value& q : *quantities->if_array()) {
    const std::string *symbol = text_at(q, "symbol"), *unit = text_at(q, "unit"), *position = text_at(q, "position");
    const auto value = number_at(q, "value");
    if (symbol == nullptr || unit == nullptr || position == nullptr || !value) continue;
    if (*position != "as found" && *position != "as left") continue;
    reports::PastResult one{entry.number, entry.kind, entry.date, *symbol, *symbol, "",
                            *position,    *unit,      *value,     {},      {}};
    if (const Value* uncertainty = q.find("uncertainty")) one.U = number_at(*uncertainty, "U");
    const auto lower = number_at(q, "lower_limit"), upper = number_at(q, "upper_limit");
    if (lower || upper) one.limits = metrology::Limits{lower, upper};
    out.push_back(std::move(one));
  }
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

void take_clouds(std::vector<reports::Record>& records, const std::filesystem::path& folder) {
  for (auto& record : records) take_of(record, folder, Absent::refused);
}

void take_clouds_beside(std::vector<reports::Record>& records, const std::vector<std::string>& as_found,
                        const std::vector<std::string>& as_left) {
  for (std::size_t k = 0; k < records.size(); ++k) {
    const std::string& file = k < as_found.size() ? as_found[k] : as_left[k - as_found.size()];
    take_of(records[k], std::filesystem::path(file).parent_path(), Absent::left_out);
  }
}

std::vector<reports::PastResult> read_past(const std::string& file, const std::string& scanner,
                                           const std::string& until) {
  const metrology::History history(file, metrology::History::Access::read);
  std::vector<reports::PastResult> out;
  for (const auto& entry : history.entries()) {
    if (entry.date > until) continue;
    if (entry.kind == "verification") {
      const auto v = metrology::verification_of(entry);
      if (v.scanner != scanner) continue;
      for (const auto& q : v.quantities) {
        out.push_back({entry.number, entry.kind, v.ended, q.symbol, q.name, q.artefact, q.position, q.unit, q.value,
                       q.uncertainty.U, q.limits});
      }
    } else if (entry.kind == "alignment") {
      for (auto& one : alignment_results(entry, scanner)) out.push_back(std::move(one));
    }
  }
  return out;
}

metrology::History history_to_append(const std::string& file) {
  metrology::History history(file, metrology::History::Access::write);
  const std::string newest = history.newest_date(), now = utc_now();
  if (newest > now) {
    fmt::print(stderr,
               "fringecal: warning: {}: its newest entry is of {}, but this machine's clock shows {}; set the clock, "
               "as dates on "
               "records and certificates, and whether artefacts' certificates have run out, go by it\n",
               file, newest, now);
  }
  return history;
}

std::filesystem::path schema_in(const std::string& folder) {
  for (const char* place : {"v3.3.0/dcc.xsd", "dcc.xsd"}) {
    if (std::filesystem::exists(std::filesystem::path(folder) / place)) return std::filesystem::path(folder) / place;
  }
  throw InputError(fmt::format(
      "{}: there is no v3.3.0/dcc.xsd in this folder; it holds PTB's schemas as they are published", folder));
}

}  // namespace fringecal::cli

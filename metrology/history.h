// History: an append-only record of every alignment, calibration, verification and certificate, in one SQLite file.
//
// An entry's hash covers its number, date, kind, document and the hash of the entry before:
//   h_n = SHA-256(h_{n-1} LF n LF date LF kind LF document),  h_0 = 64 zeros                                       (1)
// so a changed, removed or inserted entry breaks the chain from there on. What a chain alone cannot show is an end cut off:
// the newest hash is therefore printed on reports and certificates, and check() takes it. Beside the chain, check()
// rebuilds the file from its entries and compares it byte for byte, so that an altered byte is found wherever it is, in
// an index or an unused page as well.
//
// Writers take the database's write lock for the time of one append and wait up to `wait` for it; every append is one
// synced transaction: after a crash the entry is there or not, and the next writer rolls half of one back. Triggers refuse
// UPDATE and DELETE. Documents are JSON as core/value.h writes it.
#pragma once

#include "core/value.h"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::metrology {

struct HistoryEntry {
  std::int64_t number = 0;  // 1, 2, ...
  std::string date;         // RFC 3339 UTC
  std::string kind;         // "alignment", "calibration", "verification", "certificate"
  std::string document;     // JSON
  std::string hash;         // eq. 1
};

/// The same without a copy; valid inside of the call that hands it over.
struct HistoryView {
  std::int64_t number = 0;
  std::string_view date, kind, document, hash;
};

/// What check() found wrong, or nothing. `number`: the first entry concerned, where it is one.
struct HistoryFault {
  std::optional<std::int64_t> number;
  std::string sentence;
};

class History {
 public:
  enum class Access { read, write };

  /// Opens the file; with write access it is made if it is not there. A file that is not a history: InputError.
  History(const std::filesystem::path& file, Access access,
          std::chrono::milliseconds wait = std::chrono::milliseconds(10'000));
  ~History();
  History(History&&) noexcept;

  /// Appends and returns the entry. Disk full, or locked for longer than `wait`: EnvironmentError, nothing appended.
  HistoryEntry append(const std::string& kind, const Value& document, const std::string& date);

  /// In their order; kind: only these. Numbers above `after` only.
  std::vector<HistoryEntry> entries(const std::optional<std::string>& kind = std::nullopt,
                                    std::int64_t after = 0) const;
  /// Every entry in its order, one after the other: for what goes through a long history and keeps little of it.
  void each(const std::function<void(const HistoryView&)>& visit,
            const std::optional<std::string>& kind = std::nullopt) const;
  /// The entry of that number. Throws InputError with how many there are.
  HistoryEntry entry(std::int64_t number) const;
  std::int64_t size() const;
  /// Date of the newest entry; empty when there is none.
  std::string newest_date() const;
  /// The newest hash, eq. 1; h_0 when empty.
  std::string head() const;

  /// expected_head: a hash that was printed; it must stand somewhere in the chain.
  std::optional<HistoryFault> check(const std::optional<std::string>& expected_head = std::nullopt) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Eq. 1.
std::string hash_of(const std::string& previous, const HistoryEntry& entry);

}  // namespace fringecal::metrology

#include "metrology/history.h"

#include "core/error.h"
#include "core/file.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>

namespace fringecal::metrology {
namespace {

constexpr const char* kNoHash = "0000000000000000000000000000000000000000000000000000000000000000";
constexpr int kApplicationId = 0x66636831;  // "fch1", in SQLite's header: what the file is
constexpr int kVersion = 1;

constexpr const char* kTables = R"sql(
CREATE TABLE entries (
  number INTEGER PRIMARY KEY,
  date TEXT NOT NULL,
  kind TEXT NOT NULL,
  document TEXT NOT NULL,
  hash TEXT NOT NULL
) STRICT;
CREATE TRIGGER entries_stay BEFORE UPDATE ON entries BEGIN SELECT RAISE(ABORT, 'a history is append-only'); END;
CREATE TRIGGER entries_remain BEFORE DELETE ON entries BEGIN SELECT RAISE(ABORT, 'a history is append-only'); END;
)sql";

// Bytes of SQLite's header that say when and by which version it was last written, not what it holds:
// change counter (24..27), version-valid-for (92..95), SQLite's version (96..99). [SQLite file format, 1.3]
bool is_bookkeeping(std::size_t offset) { return (offset >= 24 && offset < 28) || (offset >= 92 && offset < 100); }

void make_tables(SQLite::Database& database) {
  database.exec(fmt::format("PRAGMA application_id = {}; PRAGMA user_version = {};", kApplicationId, kVersion));
  database.exec(kTables);
}

HistoryEntry read_entry(SQLite::Statement& row) {
  return {.number = row.getColumn(0).getInt64(),
          .date = row.getColumn(1).getString(),
          .kind = row.getColumn(2).getString(),
          .document = row.getColumn(3).getString(),
          .hash = row.getColumn(4).getString()};
}

void insert(SQLite::Database& database, const HistoryEntry& entry) {
  SQLite::Statement statement(database,
                              "INSERT INTO entries (number, date, kind, document, hash) VALUES (?, ?, ?, ?, ?)");
  statement.bind(1, entry.number);
  statement.bind(2, entry.date);
  statement.bind(3, entry.kind);
  statement.bind(4, entry.document);
  statement.bind(5, entry.hash);
  statement.exec();
}

/// The bytes of a file that holds these entries and nothing else. Appends of one transaction each and one large
/// transaction fill the same pages in the same order.
std::string rebuilt(const std::vector<HistoryEntry>& entries) {
  SQLite::Database database(":memory:", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  make_tables(database);
  SQLite::Transaction transaction(database);
  for (const auto& entry : entries) insert(database, entry);
  transaction.commit();
  sqlite3_int64 size = 0;
  unsigned char* bytes = sqlite3_serialize(database.getHandle(), "main", &size, 0);
  if (bytes == nullptr) throw EnvironmentError("history: not enough memory to rebuild the file for comparison");
  std::string out(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
  sqlite3_free(bytes);
  return out;
}

[[noreturn]] void refuse(const std::filesystem::path& file, const SQLite::Exception& e) {
  const int code = e.getErrorCode();
  if (code == SQLITE_NOTADB || code == SQLITE_CORRUPT || code == SQLITE_ERROR) {
    throw InputError(fmt::format("{}: not a history, or damaged: {}", file.string(), e.what()));
  }
  throw EnvironmentError(fmt::format("{}: {}", file.string(), e.what()));
}

}  // namespace

std::string hash_of(const std::string& previous, const HistoryEntry& e) {
  return sha256_hex(fmt::format("{}\n{}\n{}\n{}\n{}", previous, e.number, e.date, e.kind, e.document));
}

struct History::State {
  std::filesystem::path file;
  mutable SQLite::Database database;

  /// A query of the file: damage that SQLite meets on its way is said as what it is.
  template <class Query>
  auto read(const Query& query) const {
    try {
      return query();
    } catch (const SQLite::Exception& e) {
      refuse(file, e);
    }
  }

  [[noreturn]] void complain(const std::exception& cause) const {
    throw EnvironmentError(fmt::format("{}: {}; nothing was appended", file.string(), cause.what()));
  }
};

History::History(const std::filesystem::path& file, Access access, std::chrono::milliseconds wait) {
  const bool exists = std::filesystem::exists(file);
  if (!exists && access == Access::read) throw InputError(fmt::format("{}: there is no such history", file.string()));
  try {
    const int flags = access == Access::read ? SQLite::OPEN_READONLY : SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE;
    state_ =
        std::make_unique<State>(State{file, SQLite::Database(file.string(), flags, static_cast<int>(wait.count()))});
    auto& database = state_->database;
    if (access == Access::write) {
      // The whole of a commit is on the disk before append() returns; a rollback journal, as it leaves one file at rest.
      database.exec("PRAGMA journal_mode = DELETE; PRAGMA synchronous = EXTRA;");
      SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
      if (database.execAndGet("SELECT count(*) FROM sqlite_schema").getInt() == 0) make_tables(database);
      transaction.commit();
    }
    if (database.execAndGet("PRAGMA application_id").getInt() != kApplicationId) {
      throw InputError(fmt::format("{}: a database, but not a history of this program", file.string()));
    }
    if (const int version = database.execAndGet("PRAGMA user_version").getInt(); version > kVersion) {
      throw InputError(
          fmt::format("{}: history of version {}; this program knows up to {}", file.string(), version, kVersion));
    }
    // Under that name a view would be computed at every query, and could be one that never ends.
    SQLite::Statement table(database, "SELECT sql FROM sqlite_schema WHERE name = 'entries'");
    if (!table.executeStep() || !table.getColumn(0).getString().starts_with("CREATE TABLE")) {
      throw InputError(fmt::format("{}: a history without its table of entries; restore the file", file.string()));
    }
  } catch (const SQLite::Exception& e) {
    refuse(file, e);
  }
}

History::~History() = default;
History::History(History&&) noexcept = default;

HistoryEntry History::append(const std::string& kind, const Value& document, const std::string& date) {
  try {
    SQLite::Transaction transaction(state_->database, SQLite::TransactionBehavior::IMMEDIATE);
    HistoryEntry entry{.number = size() + 1, .date = date, .kind = kind, .document = to_json(document), .hash = {}};
    entry.hash = hash_of(head(), entry);
    insert(state_->database, entry);
    transaction.commit();
    return entry;
  } catch (const SQLite::Exception& e) {
    state_->complain(e);
  }
}

std::vector<HistoryEntry> History::entries(const std::optional<std::string>& kind, std::int64_t after) const {
  return state_->read([&] {
    std::vector<HistoryEntry> out;
    SQLite::Statement rows(state_->database,
                           std::string("SELECT number, date, kind, document, hash FROM entries WHERE number > ?") +
                               (kind ? " AND kind = ?" : "") + " ORDER BY number");
    rows.bind(1, after);
    if (kind) rows.bind(2, *kind);
    while (rows.executeStep()) out.push_back(read_entry(rows));
    return out;
  });
}

void History::each(const std::function<void(const HistoryView&)>& visit, const std::optional<std::string>& kind) const {
  state_->read([&] {
    SQLite::Statement rows(state_->database, std::string("SELECT number, date, kind, document, hash FROM entries") +
                                                 (kind ? " WHERE kind = ?" : "") + " ORDER BY number");
    if (kind) rows.bind(1, *kind);
    const auto text = [&rows](int column) {
      const auto cell = rows.getColumn(column);
      return std::string_view(cell.getText(), static_cast<std::size_t>(cell.getBytes()));
    };
    while (rows.executeStep()) visit({rows.getColumn(0).getInt64(), text(1), text(2), text(3), text(4)});
  });
}

HistoryEntry History::entry(std::int64_t number) const {
  return state_->read([&] {
    SQLite::Statement row(state_->database, "SELECT number, date, kind, document, hash FROM entries WHERE number = ?");
    row.bind(1, number);
    if (!row.executeStep()) {
      throw InputError(
          fmt::format("{}: there is no entry {}; the history has {}", state_->file.string(), number, size()));
    }
    return read_entry(row);
  });
}

std::int64_t History::size() const {
  return state_->read(
      [&] { return state_->database.execAndGet("SELECT coalesce(max(number), 0) FROM entries").getInt64(); });
}

std::string History::newest_date() const {
  SQLite::Statement row(state_->database, "SELECT date FROM entries ORDER BY number DESC LIMIT 1");
  return row.executeStep() ? row.getColumn(0).getString() : std::string();
}

std::string History::head() const {
  return state_->read([&]() -> std::string {
    SQLite::Statement row(state_->database, "SELECT hash FROM entries ORDER BY number DESC LIMIT 1");
    return row.executeStep() ? row.getColumn(0).getString() : kNoHash;
  });
}

std::optional<HistoryFault> History::check(const std::optional<std::string>& expected_head) const {
  try {
    // A read transaction: a writer that appends meanwhile changes nothing of what is compared.
    SQLite::Transaction transaction(state_->database);
    std::string integrity = state_->database.execAndGet("PRAGMA integrity_check").getString();
    if (integrity != "ok") return HistoryFault{{}, fmt::format("the file is damaged: {}", integrity)};
    const auto all = entries();
    std::string previous = kNoHash;
    bool met = !expected_head || *expected_head == kNoHash;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const auto number = static_cast<std::int64_t>(i + 1);
      if (all[i].number != number) {
        return HistoryFault{number, fmt::format("entry {} is missing: it was removed", number)};
      }
      if (hash_of(previous, all[i]) != all[i].hash) {
        return HistoryFault{
            number, fmt::format("entry {} ({}, {}) does not match its hash: it, or the one before, was altered", number,
                                all[i].kind, all[i].date)};
      }
      previous = all[i].hash;
      met = met || (expected_head && *expected_head == previous);
    }
    if (!met) {
      return HistoryFault{{},
                          fmt::format("the hash {} stands nowhere in the chain: later entries were cut off, or it is "
                                      "of another history",
                                      *expected_head)};
    }
    const std::string found = read_bytes(state_->file), expected = rebuilt(all);
    const std::size_t common = std::min(found.size(), expected.size());
    for (std::size_t i = 0; i < common; ++i) {
      if (found[i] == expected[i] || is_bookkeeping(i)) continue;
      return HistoryFault{{},
                          fmt::format("byte {} of the file is not what its entries give: the file was altered "
                                      "outside of the entries",
                                      i)};
    }
    if (found.size() != expected.size()) {
      return HistoryFault{
          {}, fmt::format("the file has {} bytes where its entries give {}", found.size(), expected.size())};
    }
    // The two counters of the header move together; one changed alone is an alteration.
    if (found.compare(24, 4, found, 92, 4) != 0) {
      return HistoryFault{{}, "the change counter of the file's header was altered"};
    }
    return std::nullopt;
  } catch (const SQLite::Exception& e) {
    return HistoryFault{{}, fmt::format("the file cannot be read: {}", e.what())};
  } catch (const InputError& e) {
    return HistoryFault{{}, e.what()};
  }
}

}  // namespace fringecal::metrology

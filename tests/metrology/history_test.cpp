// The history: what is appended stays, what is altered is found, and a killed writer loses nothing that was committed.
#include "metrology/history.h"
#include "core/error.h"
#include "core/file.h"
#include "tests/support/long_tests.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <thread>

namespace fringecal::metrology {
namespace {

using test::TemporaryFolder;

constexpr const char* kDate = "2026-11-22T08:00:00Z";

Value document(int i) { return Value::object().set("schema", "test").set("i", i).set("note", "Prüfkörper <&>"); }

void fill(const std::filesystem::path& file, int count) {
  History history(file, History::Access::write);
  for (int i = 0; i < count; ++i) history.append(i % 2 == 0 ? "verification" : "alignment", document(i), kDate);
}

TEST(History, KeepsEntriesInOrderAndChainsThem) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "history.db";
  fill(file, 5);
  const History history(file, History::Access::read);
  const auto all = history.entries();
  ASSERT_EQ(all.size(), 5u);
  std::string previous(64, '0');
  for (const auto& entry : all) {
    EXPECT_EQ(entry.hash, hash_of(previous, entry));
    previous = entry.hash;
  }
  EXPECT_EQ(history.head(), previous);
  EXPECT_EQ(history.entries("alignment").size(), 2u);
  EXPECT_EQ(history.entries(std::nullopt, 3).size(), 2u);
  EXPECT_FALSE(history.check());
}

TEST(History, RefusesChangesThroughTheDatabaseItself) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "history.db";
  fill(file, 2);
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  const auto run = [&](const char* sql) { return sqlite3_exec(database, sql, nullptr, nullptr, nullptr); };
  EXPECT_EQ(run("UPDATE entries SET kind = 'x' WHERE number = 1"), SQLITE_CONSTRAINT);
  EXPECT_EQ(run("DELETE FROM entries WHERE number = 2"), SQLITE_CONSTRAINT);
  sqlite3_close(database);
  EXPECT_FALSE(History(file, History::Access::read).check());
}

TEST(History, MissesAnEndThatWasCutOffOnlyWithoutThePrintedHash) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "history.db", shorter = folder.path() / "shorter.db";
  fill(file, 3);
  fill(shorter, 2);
  const std::string head = History(file, History::Access::read).head();
  const History cut(shorter, History::Access::read);
  EXPECT_FALSE(cut.check());
  ASSERT_TRUE(cut.check(head));
  EXPECT_NE(cut.check(head)->sentence.find("cut off"), std::string::npos);
}

TEST(History, IsRefusedWhenItIsAnotherDatabaseOrNoneAtAll) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "text.db";
  write_atomically(file, std::string(5000, 'x'));
  EXPECT_THROW(History(file, History::Access::read), InputError);
  EXPECT_THROW(History(folder.path() / "absent.db", History::Access::read), InputError);
}

// Every byte of a small file, one after the other: either it cannot be opened, or check() says so. The bytes exempted
// are SQLite's own mark of the version that wrote last (96 to 99), which no result rests on.
TEST(History, FindsOneAlteredByteAnywhere) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "history.db", altered = folder.path() / "altered.db";
  fill(file, 3);
  const std::string bytes = read_bytes(file);
  std::vector<std::size_t> missed;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (i >= 96 && i < 100) continue;
    std::string changed = bytes;
    changed[i] = static_cast<char>(changed[i] ^ 0x04);
    std::ofstream(altered, std::ios::binary | std::ios::trunc)
        .write(changed.data(), static_cast<std::streamsize>(changed.size()));
    try {
      if (!History(altered, History::Access::read).check()) missed.push_back(i);
    } catch (const InputError&) {
    } catch (const EnvironmentError&) {
    }
  }
  EXPECT_TRUE(missed.empty()) << missed.size() << " missed, first at byte " << missed.front();
}

/// A writer that appends until it is killed and says on the pipe what it has committed.
pid_t start_writer(const std::filesystem::path& file, int id, int pipe_to) {
  const pid_t child = fork();
  if (child != 0) return child;
  try {
    History history(file, History::Access::write, std::chrono::seconds(60));
    for (int i = 0;; ++i) {
      const auto entry = history.append(id == 0 ? "alignment" : "verification", document(i), kDate);
      const std::string line = std::to_string(entry.number) + " " + entry.hash + "\n";
      if (write(pipe_to, line.data(), line.size()) != static_cast<ssize_t>(line.size())) _exit(1);
    }
  } catch (...) {
    _exit(2);
  }
}

// Two writers, both killed with SIGKILL at a random moment, again and again on the same file. What a writer said to be
// committed is there with the same hash, and the chain holds. FRINGECAL_LONG: 200 kills as the specification has it.
TEST(History, LosesNothingCommittedWhenWritersAreKilled) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "history.db";
  fill(file, 1);
  const int kills = test::long_tests() ? 200 : 20;
  std::mt19937 random(7);
  std::map<std::int64_t, std::string> committed;
  for (int k = 0; k < kills; ++k) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t writers[2] = {start_writer(file, 0, ends[1]), start_writer(file, 1, ends[1])};
    close(ends[1]);
    std::this_thread::sleep_for(std::chrono::milliseconds(5 + random() % 60));
    for (const pid_t writer : writers) {
      kill(writer, SIGKILL);
      int status = 0;
      waitpid(writer, &status, 0);
      ASSERT_TRUE(WIFSIGNALED(status)) << "a writer ended by itself with " << WEXITSTATUS(status);
    }
    std::string said;
    char buffer[4096];
    for (ssize_t n; (n = read(ends[0], buffer, sizeof buffer)) > 0;) said.append(buffer, static_cast<std::size_t>(n));
    close(ends[0]);
    std::istringstream lines(said);
    std::int64_t number = 0;
    for (std::string hash; lines >> number >> hash;) {
      EXPECT_TRUE(committed.emplace(number, hash).second) << "entry " << number << " was given twice";
    }
  }
  // The next writer rolls back what was left half done; then everything is there.
  History(file, History::Access::write).append("calibration", document(0), kDate);
  const History history(file, History::Access::read);
  const auto fault = history.check();
  EXPECT_FALSE(fault) << fault->sentence;
  const auto all = history.entries();
  for (const auto& [number, hash] : committed) {
    ASSERT_LE(number, static_cast<std::int64_t>(all.size()));
    EXPECT_EQ(all[static_cast<std::size_t>(number - 1)].hash, hash);
  }
  EXPECT_GT(committed.size(), static_cast<std::size_t>(kills) / 4) << "too few appends for the test to mean anything";
}

}  // namespace
}  // namespace fringecal::metrology

// A commissioning over the protocols that is killed at random moments and continued each time.
//
// The instrument is chen2008 with pixels 8/3 times as large: a run takes seconds. Every frame has noise of its own, so
// the hash of its pixels is its name: the log of the virtual scanner says which frames were sent, the files on the
// disk which were finished.
#include "core/file.h"
#include "core/image_file.h"
#include "tests/hw/virtual_support.h"
#include "tests/support/long_tests.h"
#include "tests/support/program.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <sstream>
#include <thread>

namespace fringecal::test {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

/// The hashes in the log, in the order in which the frames were sent.
std::vector<std::string> sent_frames(const fs::path& log) {
  std::vector<std::string> hashes;
  if (!fs::exists(log)) return hashes;
  std::istringstream in(read_bytes(log));
  for (std::string id, hash; in >> id >> hash;) hashes.push_back(hash);
  return hashes;
}

/// The hashes of all frames that are finished, whatever becomes of their files later.
class FinishedFrames {
 public:
  explicit FinishedFrames(fs::path folder) : folder_(std::move(folder)) {}

  void look() {
    for (const std::string& name : listing(folder_)) {
      if (!name.ends_with(".png") || name.find(".part/") != std::string::npos) continue;
      // The same frame stands in NAME.partial first and in NAME afterwards.
      std::string key = name;
      if (const auto at = key.find(".partial/"); at != std::string::npos) key.erase(at, 8);
      if (seen_.insert(key).second) hashes_.insert(hash_of(folder_ / name));
    }
  }
  bool has(const std::string& hash) const { return hashes_.contains(hash); }
  std::size_t size() const { return hashes_.size(); }
  int not_in(const std::set<std::string>& sent) const {
    return static_cast<int>(
        std::count_if(hashes_.begin(), hashes_.end(), [&](const std::string& hash) { return !sent.contains(hash); }));
  }

 private:
  static std::string hash_of(const fs::path& file) {
    const GrayImage image = decode_gray_image(read_bytes(file), file.string());
    const auto& values = std::get<Image8>(image).values();
    return sha256_hex({reinterpret_cast<const char*>(values.data()), values.size()});
  }

  fs::path folder_;
  std::set<std::string> seen_, hashes_;
};

std::map<std::string, std::string> files_of(const fs::path& folder) {
  std::map<std::string, std::string> out;
  for (const std::string& name : listing(folder)) {
    // scanner.toml says where the virtual scanner was served last.
    if (fs::is_regular_file(folder / name) && name != "scanner.toml") out[name] = sha256_of_file(folder / name);
  }
  return out;
}

class KilledCommissioning : public testing::Test {
 protected:
  KilledCommissioning() { setenv("SOURCE_DATE_EPOCH", "1700000000", 1); }  // or else dates and durations differ

  std::vector<std::string> command(const fs::path& folder, std::vector<std::string> more) const {
    std::vector<std::string> out = {"commission", "--virtual", "--preset", preset_.file(), "--seed",
                                    "11",         "--repeats", "2",        "--output",     folder.string()};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }

  /// One commissioning, killed up to so many times and then let to its end. Returns how often it was.
  int commission(const fs::path& folder, int kills) {
    const fs::path log = folder.string() + ".log";
    // Moments spread over the frames of a whole run, 3 alignments, 15 poses and 2 x 3 scenes of 11 patterns, and a
    // random time behind each; every fourth of them long enough to reach into what is computed between the captures.
    constexpr int kFrames = 24 * 11;
    std::vector<int> moments;
    for (int i = 0; i < kills; ++i) moments.push_back(std::uniform_int_distribution<>(0, kFrames)(random_));
    std::sort(moments.begin(), moments.end());
    FinishedFrames finished(folder);
    std::size_t read = 0;
    int starts = 0, killed = 0, taken_again = 0;
    const auto look = [&] {
      const auto sent = sent_frames(log);
      for (; read < sent.size(); ++read) taken_again += finished.has(sent[read]);
      finished.look();
    };
    for (const int moment : moments) {
      RunningProgram client(command(folder, {"--frame-log", log.string()}));
      ++starts;
      std::optional<int> ended;
      // Each start sends one frame that belongs to no capture.
      while (!ended && static_cast<int>(sent_frames(log).size()) - starts < moment)
        ended = client.wait(milliseconds(2));
      const int behind_ms = std::uniform_int_distribution<>(0, starts % 4 == 0 ? 4000 : 150)(random_);
      if (!ended) ended = client.wait(milliseconds(behind_ms));
      if (ended) {
        EXPECT_EQ(*ended, 0);
        break;
      }
      client.send(SIGKILL);
      client.wait();
      ++killed;
      look();
    }
    const auto last = run_fringecal(command(folder, {"--frame-log", log.string()}));
    EXPECT_EQ(last.exit_code, 0) << last.errors;
    look();
    EXPECT_EQ(taken_again, 0);
    // What is not yet finished at a kill: one frame that is being taken, and one that is being written meanwhile. This
    // also counts the frames of captures that were measured and removed.
    const auto sent = sent_frames(log);
    const std::set<std::string> different(sent.begin(), sent.end());
    EXPECT_LE(static_cast<int>(sent.size() - different.size()), 2 * killed + starts);
    EXPECT_EQ(finished.not_in(different), 0) << "what was saved is not what was sent";
    std::printf("killed %d times; %zu frames sent, %zu seen finished, %d of them taken again\n", killed, sent.size(),
                finished.size(), taken_again);
    return killed;
  }

  const TemporaryFolder scratch_;
  const virt::ChangedPreset preset_{{{"width_px", "522"}, {"height_px", "390"}, {"pixel_mm", "0.0172"}}};
  std::mt19937 random_{20081215};
};

TEST_F(KilledCommissioning, EndsAsTheSameBytesAndTakesNoFinishedFrameAgain) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "takes half an hour under the thread sanitizer, which sees the same threads in virtual_faults_test";
#endif
  const auto whole = run_fringecal(command(scratch_ / "whole", {"--in-process"}));
  ASSERT_EQ(whole.exit_code, 0) << whole.errors;
  const auto expected = files_of(scratch_ / "whole");
  // A run that ends before all moments came leaves the rest to another one.
  const int kills = long_tests() ? 50 : 10;
  for (int killed = 0, run = 0; killed < kills && !HasFailure(); ++run) {
    const auto folder = scratch_ / ("killed-" + std::to_string(run));
    killed += commission(folder, kills - killed);
    EXPECT_EQ(files_of(folder), expected);
    if (!long_tests() && killed >= kills * 4 / 5) break;
  }
}

}  // namespace
}  // namespace fringecal::test

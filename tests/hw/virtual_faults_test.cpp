// What happens to a capture, and to a commissioning, when the world fails: packets lost, disk full, Ctrl-C. Each over
// the real protocols and with its exact outcome.
#include "core/file.h"
#include "core/image_file.h"
#include "core/value.h"
#include "hw/exposure.h"
#include "tests/hw/virtual_process.h"

#include <gmock/gmock.h>
#include <signal.h>

#include <algorithm>
#include <optional>
#include <random>
#include <thread>

namespace {

using namespace fringecal;
using namespace std::chrono_literals;
using test::listing;
using test::run_fringecal;
using test::RunningProgram;
using test::same_bytes;
using testing::HasSubstr;

class VirtualFaults : public test::VirtualProcess {
 protected:
  /// Lamp off, stage at its home, no fault: what the PLC itself says.
  void expect_safe() const {
    const auto state = run_fringecal({"devices", "--scanner", scanner_file(), "--frames", "0"});
    EXPECT_EQ(state.exit_code, 0) << state.errors;
    EXPECT_THAT(state.output, HasSubstr("idle, fault code 0, stage at 0.000 mm, lamp off"));
  }
  std::size_t frames_in(const std::string& folder) const {
    const auto files = listing(scratch / folder);
    return static_cast<std::size_t>(
        std::count_if(files.begin(), files.end(), [](const std::string& name) { return name.ends_with(".png"); }));
  }
};

std::int64_t number(const std::string& json, const char* key) {
  const Value summary = parse_json(json, "the summary");
  const Value* value = summary.find(key);
  return value && value->if_integer() ? *value->if_integer() : -1;
}

// 14 packets a frame: 2.8 % of the frames are lost, four in a row with 6e-7.
TEST_F(VirtualFaults, ACaptureAtTwoPerMilleLossOfPacketsHasEveryByte) {
  RunningProgram scanner(serve("127.0.0.112", {"--scene", "plane 0", "--stack-seed", "5", "--packet-loss", "0.002"}));
  ASSERT_NE(scanner.line(), "");
  const auto expected = rendered("plane 0", 5);
  for (int i = 0; i < 5; ++i) {
    const auto result = run_fringecal(capture("stack"));
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    EXPECT_TRUE(same_bytes(read_capture(scratch / "stack").frames, expected));
  }
}

TEST_F(VirtualFaults, TwoExposuresAreMergedByModulation) {
  RunningProgram scanner(serve("127.0.0.113"));
  ASSERT_NE(scanner.line(), "");
  const auto result = run_fringecal(
      capture("stack", {"--scene", "spheres 0", "--stack-seed", "5", "--hdr", "--hdr-ratio", "3", "--json"}));
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_EQ(number(result.output, "frames_taken"), 22);
  const Capture got = read_capture(scratch / "stack");
  const auto low = rendered("spheres 0", 5), high = rendered("spheres 0", 5, 8, 3);
  const auto merged = hw::merge_exposures(got.info.plan, {low, high}, 255);
  EXPECT_TRUE(same_bytes(got.frames, merged));
  EXPECT_FALSE(same_bytes(merged, low)) << "no pixel came from the longer exposure";
  EXPECT_FALSE(same_bytes(merged, high)) << "no pixel came from the shorter exposure";
}

// A limit on the size of a file is a full disk that hits an exact frame: PNG files of finer stripes are larger.
TEST_F(VirtualFaults, AFullDiskStopsTheCaptureSafelyAndItContinuesWhenThereIsSpace) {
  RunningProgram scanner(serve("127.0.0.114", {"--scene", "calibration 3", "--stack-seed", "5"}));
  ASSERT_NE(scanner.line(), "");
  const auto expected = rendered("calibration 3", 5);
  std::size_t fails = 1, limit = encode_png(expected[0]).size();
  while (fails < expected.size() && (fails < 3 || encode_png(expected[fails]).size() <= limit)) {
    limit = std::max(limit, encode_png(expected[fails]).size());
    ++fails;
  }
  ASSERT_LT(fails, expected.size()) << "no frame is larger than all before it";
  const auto full = run_fringecal(capture("stack"), limit);
  EXPECT_EQ(full.exit_code, 3);
  EXPECT_THAT(full.errors, HasSubstr("cannot be written (File too large); free space or choose another folder"));
  EXPECT_THAT(full.errors, HasSubstr(std::to_string(fails) + " of 11 frames are kept in"));
  EXPECT_EQ(frames_in("stack.partial"), fails);
  EXPECT_FALSE(std::filesystem::exists(scratch / "stack"));
  expect_safe();
  const auto again = run_fringecal(capture("stack", {"--json"}));
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_EQ(number(again.output, "frames_resumed"), static_cast<std::int64_t>(fails));
  EXPECT_EQ(number(again.output, "frames_taken"), static_cast<std::int64_t>(expected.size() - fails));
  EXPECT_TRUE(same_bytes(read_capture(scratch / "stack").frames, expected));
}

TEST_F(VirtualFaults, CtrlCEndsACaptureSafelyAndTheSameCommandContinues) {
  RunningProgram scanner(serve("127.0.0.115", {"--scene", "plane 0", "--stack-seed", "5", "--motion", "60"}));
  ASSERT_NE(scanner.line(), "");
  RunningProgram client(capture("stack"));
  for (int i = 0; i < 4000 && frames_in("stack.partial") < 3; ++i) std::this_thread::sleep_for(5ms);
  client.send(SIGINT);
  EXPECT_EQ(client.wait(), 130);
  expect_safe();
  const auto kept = static_cast<std::int64_t>(frames_in("stack.partial"));
  EXPECT_GE(kept, 3);
  EXPECT_LT(kept, 11);
  const auto again = run_fringecal(capture("stack", {"--json"}));
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_EQ(number(again.output, "frames_resumed"), kept);
  EXPECT_EQ(number(again.output, "frames_taken"), 11 - kept);
  EXPECT_TRUE(same_bytes(read_capture(scratch / "stack").frames, rendered("plane 0", 5)));
}

// A system call that waits with a limit of its own (poll, a socket's timeout) ends with EINTR when the process is stopped and
// continued, handler or not (signal(7)): client and scanner, both, some hundred times in a stack of one second and more. A pause
// is 1 to 9 ms, far below the watchdog of the PLC.
TEST_F(VirtualFaults, InterruptedSystemCallsCostNoByte) {
  RunningProgram scanner(serve("127.0.0.119", {"--scene", "plane 0", "--stack-seed", "5", "--motion", "60"}));
  ASSERT_NE(scanner.line(), "");
  RunningProgram client(capture("stack"));
  std::mt19937 random(7);
  std::uniform_int_distribution<int> pause(1, 9), between(1, 5);
  int interrupted = 0;
  std::optional<int> ended;
  for (; interrupted < 4000 && !ended; ++interrupted) {
    const RunningProgram& process = interrupted % 2 == 0 ? client : scanner;
    process.send(SIGSTOP);
    std::this_thread::sleep_for(std::chrono::milliseconds(pause(random)));
    process.send(SIGCONT);
    ended = client.wait(std::chrono::milliseconds(between(random)));
  }
  EXPECT_EQ(ended, 0);
  EXPECT_GE(interrupted, 50);
  EXPECT_TRUE(same_bytes(read_capture(scratch / "stack").frames, rendered("plane 0", 5)));
}

// SIGTERM asks the same as Ctrl-C; the virtual scanner that the commissioning started ends with it, and by itself where
// nobody was left to end it.
TEST_F(VirtualFaults, AStoppedOrKilledCommissioningTakesItsVirtualScannerWithIt) {
  for (const int signal : {SIGINT, SIGTERM, SIGKILL}) {
    const auto folder = scratch / std::to_string(signal);
    RunningProgram client({"commission", "--virtual", "--preset", preset(), "--output", folder.string()});
    for (int i = 0; i < 4000 && frames_in(std::to_string(signal)) < 5; ++i) std::this_thread::sleep_for(5ms);
    client.send(signal);
    EXPECT_EQ(client.wait(), signal == SIGKILL ? 128 + SIGKILL : 130);
    std::string scanner = read_bytes(folder / "scanner.toml");
    scanner.erase(0, scanner.find("127.0.1."));
    const std::string address = scanner.substr(0, scanner.find('"'));
    auto answer = run_fringecal({"devices", "--camera", address, "--frames", "0"});
    for (int i = 0; i < 100 && signal == SIGKILL && answer.exit_code == 0; ++i) {
      std::this_thread::sleep_for(50ms);
      answer = run_fringecal({"devices", "--camera", address, "--frames", "0"});
    }
    EXPECT_EQ(answer.exit_code, 3);
    EXPECT_THAT(answer.errors, HasSubstr("nothing answers there"));
  }
}

TEST_F(VirtualFaults, TwoCommissioningsDoNotShareAFolderNorAScanner) {
  const std::vector<std::string> command = {"commission", "--virtual", "--preset", preset(), "--output"};
  const auto in = [&](const char* folder) {
    auto words = command;
    words.push_back((scratch / folder).string());
    return words;
  };
  RunningProgram first(in("first")), second(in("second"));
  for (int i = 0; i < 4000 && (frames_in("first") < 2 || frames_in("second") < 2); ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_GE(frames_in("first"), 2u);
  EXPECT_GE(frames_in("second"), 2u);
  const auto third = run_fringecal(in("first"));
  EXPECT_EQ(third.exit_code, 2);
  EXPECT_THAT(third.errors, HasSubstr("another commissioning is at work there"));
}

}  // namespace

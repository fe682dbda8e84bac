// The virtual scanner as a process, and the commands of the program against it over the real protocols. The instrument
// is chen2008 with a sixteenth of its pixels, each four times as large.
#include "tests/hw/virtual_process.h"
#include "core/file.h"
#include "core/value.h"
#include "tests/support/other_programs.h"
#include "tests/support/sanitizers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <thread>

namespace {

using namespace fringecal;
using namespace std::chrono_literals;
using test::installed;
using test::run_fringecal;
using test::run_in_shell;
using test::RunningProgram;
using testing::HasSubstr;

using test::same_bytes;
using test::VirtualProcess;

TEST_F(VirtualProcess, ACaptureHasTheBytesOfTheSimulation) {
  RunningProgram scanner(serve("127.0.0.101"));
  ASSERT_THAT(scanner.line(), HasSubstr("modbus-tcp://127.0.0.101:"));
  const auto result = run_fringecal(capture("stack", {"--scene", "plane 0", "--stack-seed", "5", "--json"}));
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const Capture got = read_capture(scratch / "stack");
  EXPECT_EQ(got.info.bits, 8);
  EXPECT_TRUE(same_bytes(got.frames, rendered("plane 0", 5)));
}

TEST_F(VirtualProcess, TwelveBitsPassUnchanged) {
  RunningProgram scanner(serve("127.0.0.102", {"--bits", "12"}));
  ASSERT_NE(scanner.line(), "");
  const auto result = run_fringecal(capture("stack", {"--scene", "spheres 1", "--stack-seed", "6"}));
  ASSERT_EQ(result.exit_code, 0) << result.errors;
  const Capture got = read_capture(scratch / "stack");
  EXPECT_EQ(got.info.bits, 12);
  EXPECT_TRUE(same_bytes(got.frames, rendered("spheres 1", 6, 12)));
}

/// Threads of other programs that want a processor, on average over half a second.
double others_at_work() {
  double sum = 0;
  constexpr int kLooks = 25;
  for (int i = 0; i < kLooks; ++i) {
    std::istringstream in(read_bytes("/proc/loadavg"));
    std::string minutes;
    int running = 0;
    for (int k = 0; k < 3; ++k) in >> minutes;
    in >> running;
    sum += running - 1;
    std::this_thread::sleep_for(20ms);
  }
  return sum / kLooks;
}

// Full size, with the rendering, the checks of every frame and the writing to the disk. The best of ten, because the
// figure is the program's and not that of a moment; 0.3 to 0.4 s where nothing else runs.
TEST(VirtualScannerSpeed, ElevenPatternsTakeAtMostSixTenthsOfASecondWithAnInstantStage) {
  if (test::kSanitized) GTEST_SKIP() << "a sanitizer slows the program down";
  const test::TemporaryFolder scratch;
  const std::string file = (scratch / "scanner.toml").string();
  RunningProgram scanner({"virtual", "--address", "127.0.0.116", "--scanner-file", file, "--scene", "plane 0"});
  ASSERT_NE(scanner.line(), "");
  double best_s = 1e9;
  for (int i = 0; i < 10 && best_s > 0.6; ++i) {
    const auto result =
        run_fringecal({"capture", "--scanner", file, "--exposure", "20", "-o", (scratch / "stack").string(), "--json"});
    ASSERT_EQ(result.exit_code, 0) << result.errors;
    best_s = std::min(best_s, *parse_json(result.output, "the summary").find("seconds")->if_real());
  }
  scanner.send(SIGTERM);
  scanner.wait();
  if (best_s > 0.6 && others_at_work() > 1) GTEST_SKIP() << "the processors are busy: " << best_s << " s";
  EXPECT_LE(best_s, 0.6);
}

TEST_F(VirtualProcess, AScannerKilledInMidStackAndStartedAgainLeavesNoTraceInTheFrames) {
  const std::vector<std::string> command =
      serve("127.0.0.103", {"--plc-port", "15020", "--scene", "plane 1", "--stack-seed", "5", "--motion", "60"});
  auto scanner = std::make_unique<RunningProgram>(command);
  ASSERT_NE(scanner->line(), "");
  RunningProgram client(capture("stack"));
  const auto partial = scratch / "stack.partial";
  for (int i = 0; i < 4000 && test::listing(partial).size() < 4; ++i) std::this_thread::sleep_for(5ms);
  scanner->send(SIGKILL);
  scanner->wait();
  EXPECT_FALSE(std::filesystem::exists(scratch / "stack"));
  scanner = std::make_unique<RunningProgram>(command);
  ASSERT_NE(scanner->line(), "");
  EXPECT_EQ(client.wait(), 0);
  EXPECT_TRUE(same_bytes(read_capture(scratch / "stack").frames, rendered("plane 1", 5)));
}

TEST_F(VirtualProcess, SigtermEndsItCleanlyAndTheAddressIsFreeAgain) {
  for (int round = 0; round < 2; ++round) {
    RunningProgram scanner(serve("127.0.0.104", {"--truth", (scratch / "truth.json").string()}));
    ASSERT_NE(scanner.line(), "");
    scanner.send(SIGTERM);
    EXPECT_EQ(scanner.wait(10s), 0);
    EXPECT_TRUE(std::filesystem::exists(scratch / "truth.json"));
  }
}

TEST_F(VirtualProcess, ItEndsWithTheProgramThatStartedIt) {
  const auto out = scratch / "out";
  const pid_t parent = fork();
  if (parent == 0) {
    RunningProgram scanner(serve("127.0.0.105"));
    write_atomically(out, scanner.line());
    _exit(0);  // no destructor runs: the scanner is left behind
  }
  waitpid(parent, nullptr, 0);
  const Value ready = parse_json(read_bytes(out), "the ready line");
  const auto* pid = ready.find("pid")->if_integer();
  ASSERT_NE(pid, nullptr);
  bool gone = false;
  for (int i = 0; i < 1000 && !gone; ++i) {
    const std::string state = "/proc/" + std::to_string(*pid) + "/stat";
    std::FILE* file = std::fopen(state.c_str(), "r");
    char letter = 'Z';  // a zombie that nobody waits for is gone, too
    if (file && std::fscanf(file, "%*d %*s %c", &letter) != 1) letter = '?';
    if (file) std::fclose(file);
    gone = letter == 'Z';
    if (!gone) std::this_thread::sleep_for(10ms);
  }
  EXPECT_TRUE(gone);
}

TEST_F(VirtualProcess, ASecondOneOnTheSameAddressSaysSo) {
  RunningProgram scanner(serve("127.0.0.106"));
  ASSERT_NE(scanner.line(), "");
  const auto second = run_fringecal(serve("127.0.0.106"));
  EXPECT_EQ(second.exit_code, 3);
  EXPECT_THAT(second.errors, HasSubstr("127.0.0.106"));
  RunningProgram beside(serve("127.0.0.107"));
  EXPECT_NE(beside.line(), "");
}

TEST_F(VirtualProcess, DevicesTellsWhatAnswersAndWhatDoesNot) {
  RunningProgram scanner(serve("127.0.0.108", {"--packet-loss", "0.01"}));
  ASSERT_NE(scanner.line(), "");
  const auto found = run_fringecal({"devices", "--scanner", scanner_file(), "--frames", "40", "--json"});
  ASSERT_EQ(found.exit_code, 0) << found.errors;
  const Value json = parse_json(found.output, "devices");
  const Value* camera = json.find("camera");
  ASSERT_NE(camera, nullptr);
  EXPECT_EQ(*camera->find("width_px")->if_integer(), 348);
  EXPECT_EQ(*camera->find("packet_size_bytes")->if_integer(), 8192);
  // 14 packets a frame: of 560 packets none lost at 1 % has the chance 0.4 %.
  EXPECT_GT(*camera->find("packets_lost")->if_integer(), 0);
  EXPECT_EQ(*camera->find("frames_whole")->if_integer() + *camera->find("frames_incomplete")->if_integer() +
                *camera->find("frames_missing")->if_integer(),
            40);
  EXPECT_NE(json.find("plc"), nullptr);
  const auto nothing = run_fringecal({"devices", "--camera", "127.0.0.99", "--frames", "1"});
  EXPECT_EQ(nothing.exit_code, 3);
  EXPECT_THAT(nothing.errors, HasSubstr("127.0.0.99"));
  EXPECT_THAT(nothing.errors, HasSubstr("nothing answers"));
  EXPECT_EQ(run_fringecal({"devices", "--camera", "my-camera"}).exit_code, 2);
}

TEST_F(VirtualProcess, LiveShowsFiguresAndLeavesTheScannerDark) {
  RunningProgram scanner(serve("127.0.0.109", {"--scene", "plane 0"}));
  ASSERT_NE(scanner.line(), "");
  const auto live = run_fringecal({"live", "--scanner", scanner_file(), "--pattern", "10", "--frames", "5"});
  ASSERT_EQ(live.exit_code, 0) << live.errors;
  EXPECT_THAT(live.output, HasSubstr("sharpness"));
  const auto after = run_fringecal({"devices", "--scanner", scanner_file(), "--frames", "0"});
  EXPECT_THAT(after.output, HasSubstr("idle"));
  EXPECT_THAT(after.output, HasSubstr("lamp off"));
}

TEST_F(VirtualProcess, ArvToolReadsAndWritesItsFeatures) {
  if (!installed("arv-tool-0.8")) GTEST_SKIP() << "arv-tool-0.8 is not installed: apt-get install aravis-tools-cli";
  RunningProgram scanner(serve("127.0.0.110"));
  ASSERT_NE(scanner.line(), "");
  const auto read = run_in_shell("arv-tool-0.8 -a 127.0.0.110 control DeviceModelName Width Height PixelFormat");
  EXPECT_THAT(read.output, HasSubstr("fringecal virtual scanner"));
  EXPECT_THAT(read.output, HasSubstr("Width = 348"));
  EXPECT_THAT(read.output, HasSubstr("Height = 260"));
  EXPECT_THAT(read.output, HasSubstr("PixelFormat = Mono8"));
  run_in_shell("arv-tool-0.8 -a 127.0.0.110 control ExposureTimeAbs=12345");
  EXPECT_THAT(run_in_shell("arv-tool-0.8 -a 127.0.0.110 control ExposureTimeAbs").output, HasSubstr("12345"));
}

TEST_F(VirtualProcess, ArvCameraTestGrabsFrames) {
  if (!installed("arv-camera-test-0.8")) {
    GTEST_SKIP() << "arv-camera-test-0.8 is not installed: apt-get install aravis-tools";
  }
  RunningProgram scanner(serve("127.0.0.111"));
  ASSERT_NE(scanner.line(), "");
  const auto grab =
      run_in_shell("arv-camera-test-0.8 -n 127.0.0.111 -o 20 --duration=2 --no-packet-socket -a -j never -i 8192");
  const auto at = grab.output.find("n_completed_buffers");
  ASSERT_NE(at, std::string::npos) << grab.output;
  EXPECT_GT(std::atoi(grab.output.c_str() + grab.output.find('=', at) + 1), 0) << grab.output;
}

}  // namespace

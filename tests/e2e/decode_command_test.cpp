// `fringecal import` and `fringecal decode` as a user runs them.
#include "calib/decode/decode.h"
#include "core/capture.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/import_plan.h"
#include "core/value.h"
#include "tests/calib/synthetic_fringes.h"
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdlib>

namespace fringecal {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;
using testing::AllOf;
using testing::HasSubstr;

struct Finished {
  int code = -1;
  std::string out, err;
};

/// before: environment ("FRINGECAL_THREADS=1") or a shell limit ("ulimit -f 100;") in front of the command.
Finished run(const TemporaryFolder& folder, const std::string& arguments, const std::string& before = "") {
  const std::string command = fmt::format("{} {} {} > {} 2> {}", before, FRINGECAL_PROGRAM, arguments,
                                          (folder / "out").string(), (folder / "err").string());
  const int status = std::system(command.c_str());
  return {.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
          .out = read_bytes(folder / "out"),
          .err = read_bytes(folder / "err")};
}

constexpr const char* kPoses = FRINGECAL_SHARED_DATA "/procam-gray";
const std::string kPlan = std::string(FRINGECAL_SOURCE_DIR) + "/tests/e2e/procam_gray.toml";

TEST(ImportAndDecode, TheFiveRealPosesGiveACodeThatGrowsDownTheImage) {
  if (!fs::exists(kPoses)) GTEST_SKIP() << "shared data not present: " << kPoses;
  for (int pose = 0; pose < 5; ++pose) {
    const Capture capture = import_capture(fmt::format("{}/pose_{}", kPoses, pose), kPlan);
    const decode::PhaseMap map = decode::decode_phase(capture, CodeAxis::y);
    const Image<float>& phase = map.phase_rad;
    // The wall and the board fill at least two thirds of every view.
    EXPECT_GT(decode::count_validity(map)[0], 1280u * 1024u * 2 / 3) << pose;
    // In the upper 40 % of the view (wall and board, no floor) the projector's rows follow each other down every
    // column: 0.5 to 0.6 rows per pixel, so a step is 0 or 1 but for noise at a row's edge; 80 rows apart the code has
    // always grown.
    const auto row_of = [&](int x, int y) { return (phase(x, y) + std::numbers::pi) / (2 * std::numbers::pi); };
    std::size_t steps = 0, small = 0, far = 0, grown = 0;
    for (int x = 0; x < 1280; x += 5) {
      for (int y = 0; y < 400; ++y) {
        if (std::isnan(phase(x, y))) continue;
        if (!std::isnan(phase(x, y + 1))) {
          const double step = row_of(x, y + 1) - row_of(x, y);
          ++steps;
          small += step > -1.5 && step < 2.5 ? 1 : 0;
        }
        if (!std::isnan(phase(x, y + 80))) {
          ++far;
          grown += row_of(x, y + 80) > row_of(x, y) ? 1 : 0;
        }
      }
    }
    EXPECT_GT(steps, 50000u) << pose;
    // Exceptions: the board's outline, where the row jumps by the parallax between board and wall, and dark squares.
    EXPECT_GT(static_cast<double>(small) / static_cast<double>(steps), 0.98) << pose;
    EXPECT_GT(static_cast<double>(grown) / static_cast<double>(far), 0.98) << pose;
  }
}

TEST(ImportAndDecode, ARealPoseGoesThroughBothCommands) {
  if (!fs::exists(kPoses)) GTEST_SKIP() << "shared data not present: " << kPoses;
  const TemporaryFolder folder;
  const std::string capture = (folder / "c").string(), maps = (folder / "m").string();
  const Finished import = run(folder, fmt::format("import {}/pose_0 --plan {} -o {}", kPoses, kPlan, capture));
  ASSERT_EQ(import.code, 0) << import.err;
  const Finished decode = run(folder, fmt::format("decode {} -o {} --json", capture, maps));
  ASSERT_EQ(decode.code, 0) << decode.err;
  const Value summary = parse_json(decode.out, "out");
  EXPECT_EQ(*summary.find("axis")->if_text(), "y");
  // What the files hold is what the summary says.
  const auto phase = read_float_tiff(fs::path(maps) / "phase.tiff");
  std::int64_t valid = 0;
  for (const float v : phase.values()) valid += std::isnan(v) ? 0 : 1;
  EXPECT_EQ(*summary.find("pixels")->find("valid")->if_integer(), valid);
}

struct SyntheticCapture : testing::Test {
  TemporaryFolder folder;
  std::string capture = (folder / "capture").string(), maps = (folder / "maps").string();
  void SetUp() override {
    test::FringeScene scene;
    scene.code = {.gray_bits = 6, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
    scene.read_sd = 1;
    scene.along = 300;
    scene.across = 200;
    Capture rendered = test::render(scene);
    write_capture(capture, rendered);
  }
};

TEST_F(SyntheticCapture, GivesTheSameBytesWithOneThreadAndWithThree) {
  const std::string other = (folder / "other").string();
  ASSERT_EQ(run(folder, "decode " + capture + " -o " + maps, "FRINGECAL_THREADS=1").code, 0);
  ASSERT_EQ(run(folder, "decode " + capture + " -o " + other, "FRINGECAL_THREADS=3").code, 0);
  for (const char* name : {"phase.tiff", "u_phase.tiff", "modulation.tiff", "phase.png", "validity.png"}) {
    EXPECT_EQ(sha256_of_file(fs::path(maps) / name), sha256_of_file(fs::path(other) / name)) << name;
  }
}

TEST_F(SyntheticCapture, SummaryIsReadableByPeopleAndMachines) {
  const Finished text = run(folder, "decode " + capture + " -o " + maps);
  EXPECT_THAT(text.out, AllOf(HasSubstr("300 x 200 pixels"), HasSubstr("inconsistent code"), HasSubstr("rad"),
                              HasSubstr("mm on the pattern")));
  const Finished json = run(folder, "decode " + capture + " --plain --json -o " + maps);
  const Value summary = parse_json(json.out, "out");
  EXPECT_EQ(*summary.find("edges")->if_text(), "plain");
  // sigma / (sqrt(2) B): one grey level and its rounding (1.04) over 60.
  EXPECT_NEAR(*summary.find("median_u_phase_rad")->if_real(), 1.04 / (std::sqrt(2.0) * 60), 5e-4);
}

TEST_F(SyntheticCapture, BadRequestsEndWithOneSentenceAndCode2) {
  for (const auto& [arguments, words] : std::vector<std::pair<std::string, std::string>>{
           {"decode " + capture + " --axis y -o " + maps, "no code along y"},
           {"decode /nowhere -o " + maps, "/nowhere"},
           {"import " + capture + " --plan " + capture + "/capture.json -o " + maps, "TOML"},
           {"import " + capture + " --plan " + kPlan + " -o " + maps, "graycode_20.png"},
           {"import " + capture + " --plan " + kPlan + " -o " + capture + "/", "cannot replace the folder"},
       }) {
    const Finished bad = run(folder, arguments);
    EXPECT_EQ(bad.code, 2) << arguments;
    EXPECT_THAT(bad.err, HasSubstr(words));
    EXPECT_EQ(std::count(bad.err.begin(), bad.err.end(), '\n'), 1) << bad.err;
    EXPECT_FALSE(fs::exists(maps)) << arguments;
  }
}

TEST_F(SyntheticCapture, AFullDiskEndsWithCode3AndLeavesNoHalfFile) {
  // A limit of 10 kB per file stands in for the full disk; the largest map has 240 kB before compression.
  const Finished full = run(folder, "decode " + capture + " -o " + maps, "trap '' XFSZ; ulimit -f 20;");
  EXPECT_EQ(full.code, 3) << full.err;
  EXPECT_THAT(full.err, HasSubstr("cannot be written"));
  for (const auto& entry : fs::directory_iterator(maps)) {
    EXPECT_EQ(entry.path().string().find(".part"), std::string::npos) << entry.path();
  }
}

}  // namespace
}  // namespace fringecal

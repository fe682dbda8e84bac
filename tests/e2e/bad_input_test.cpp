// What a user can hand over by mistake: one clear sentence that names the file, exit code 2 or 3, nothing half-written.
#include "tests/support/program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

namespace fringecal::test {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// One line on stderr that starts with the program's name and contains each of the words.
void expect_one_sentence(const ProgramResult& result, int exit_code, const std::vector<std::string>& words) {
  EXPECT_EQ(result.exit_code, exit_code) << result.errors;
  EXPECT_TRUE(result.errors.starts_with("fringecal: ")) << result.errors;
  EXPECT_EQ(std::count(result.errors.begin(), result.errors.end(), '\n'), 1) << result.errors;
  for (const auto& word : words)
    EXPECT_NE(result.errors.find(word), std::string::npos) << word << " not in: " << result.errors;
}

// A PGM of one grey level: the smallest image of any scanner.
std::string pgm(int width, int height, char level) {
  return "P5\n" + std::to_string(width) + " " + std::to_string(height) + "\n255\n" +
         std::string(static_cast<std::size_t>(width * height), level);
}

class BadCapture : public testing::Test {
 protected:
  void SetUp() override {
    plan_ = "[codes.x]\ngray_bits = 1\nphase_steps = 3\nstripes_per_period = 2\nperiod = 0.24\nunit = \"mm\"\n";
    const char* kinds[] = {"kind = \"gray\"\nbit = 0", "kind = \"phase\"\nstep = 0", "kind = \"phase\"\nstep = 1",
                           "kind = \"phase\"\nstep = 2"};
    for (int i = 0; i < 4; ++i) {
      plan_ += "[[frames]]\nfile = \"f" + std::to_string(i) + ".pgm\"\n" + kinds[i] + "\n";
      write(scratch_ / "in" / ("f" + std::to_string(i) + ".pgm"), pgm(16, 8, static_cast<char>(40 + 20 * i)));
    }
    write(scratch_ / "plan.toml", plan_);
  }
  ProgramResult import(std::size_t file_size_limit = 0) const {
    return run_fringecal({"import", (scratch_ / "in").string(), "--plan", (scratch_ / "plan.toml").string(), "-o",
                          (scratch_ / "out").string()},
                         file_size_limit);
  }
  void expect_nothing_written() const {
    EXPECT_EQ(listing(scratch_.path()).size(), 1u + 1u + listing(scratch_ / "in").size());  // in, plan.toml and frames
  }
  ScratchFolder scratch_;
  std::string plan_;
};

TEST_F(BadCapture, TheGoodOneIsTaken) {
  const auto result = import();
  EXPECT_EQ(result.exit_code, 0) << result.errors;
  EXPECT_TRUE(fs::exists(scratch_ / "out" / "capture.json"));
}

TEST_F(BadCapture, MissingFrame) {
  fs::remove(scratch_ / "in" / "f2.pgm");
  expect_one_sentence(import(), 2, {"f2.pgm"});
  expect_nothing_written();
}

TEST_F(BadCapture, TruncatedFrame) {
  write(scratch_ / "in" / "f2.pgm", pgm(16, 8, 'x').substr(0, 60));
  expect_one_sentence(import(), 2, {"f2.pgm"});
  expect_nothing_written();
}

TEST_F(BadCapture, FrameOfAnotherSize) {
  write(scratch_ / "in" / "f3.pgm", pgm(16, 9, 'x'));
  expect_one_sentence(import(), 2, {"f3.pgm", "9"});
  expect_nothing_written();
}

TEST_F(BadCapture, PlanThatDoesNotMatchTheFrames) {
  std::string two_bits = plan_;
  two_bits.replace(two_bits.find("gray_bits = 1"), 13, "gray_bits = 2");
  write(scratch_ / "plan.toml", two_bits);
  expect_one_sentence(import(), 2, {"plan.toml", "gray 1"});
  expect_nothing_written();
}

TEST_F(BadCapture, UnknownKeyInThePlan) {
  write(scratch_ / "plan.toml", "exposure_in_milliseconds = 3\n" + plan_);
  expect_one_sentence(import(), 2, {"plan.toml", "exposure_in_milliseconds"});
  expect_nothing_written();
}

TEST_F(BadCapture, TomlThatIsNotToml) {
  write(scratch_ / "plan.toml", "[codes.x\ngray_bits");
  expect_one_sentence(import(), 2, {"plan.toml", "line 1"});
  expect_nothing_written();
}

TEST_F(BadCapture, FullDisk) {
  // 400 bytes stand for the last free bytes of a disk: capture.json does not fit (the sentence on stderr does).
  expect_one_sentence(import(400), 3, {"out"});
  expect_nothing_written();
}

TEST_F(BadCapture, AFolderThatMayNotBeWrittenTo) {
  const fs::path closed = scratch_ / "closed";
  fs::create_directory(closed);
  fs::permissions(closed, fs::perms::owner_read | fs::perms::owner_exec);
  const std::string in = (scratch_ / "in").string(), plan = (scratch_ / "plan.toml").string();
  const std::string out = (closed / "out").string();
  const std::vector<std::vector<std::string>> commands = {
      {"import", in, "--plan", plan, "-o", out},
      {"render", "--scene", "plane 0", "-o", out},
      {"commission", "--virtual", "--in-process", "-o", out},
  };
  for (const auto& command : commands) {
    expect_one_sentence(run_fringecal(command, 0, true), 3, {"closed/out", "Permission denied"});
    EXPECT_TRUE(listing(closed).empty()) << command[0];
  }
  fs::permissions(closed, fs::perms::owner_all);
}

TEST_F(BadCapture, AFileAndAFolderThatMayNotBeRead) {
  ASSERT_EQ(import().exit_code, 0);
  const fs::path capture = scratch_ / "out", frame = capture / "capture.json";
  const std::vector<std::string> decode = {"decode", capture.string(), "-o", (scratch_ / "maps").string()};
  for (const fs::path& shut : {frame, capture}) {
    const fs::perms before = fs::status(shut).permissions();
    fs::permissions(shut, fs::perms::none);
    const auto result = run_fringecal(decode, 0, true);
    fs::permissions(shut, before);
    expect_one_sentence(result, 2, {"out/capture.json", "Permission denied", "check its permissions"});
    EXPECT_FALSE(fs::exists(scratch_ / "maps"));
  }
  EXPECT_EQ(run_fringecal(decode, 0, true).exit_code, 0);
}

TEST_F(BadCapture, AlteredFrameInAFinishedCapture) {
  ASSERT_EQ(import().exit_code, 0);
  for (const auto& entry : fs::directory_iterator(scratch_ / "out")) {
    if (entry.path().filename() == "capture.json") continue;
    std::string bytes = read(entry.path());
    bytes[bytes.size() / 2] ^= 1;
    write(entry.path(), bytes);
    break;
  }
  expect_one_sentence(run_fringecal({"decode", (scratch_ / "out").string(), "-o", (scratch_ / "phase").string()}), 2,
                      {"out"});
  EXPECT_FALSE(fs::exists(scratch_ / "phase"));
}

TEST_F(BadCapture, CaptureJsonWithAnUnknownKey) {
  ASSERT_EQ(import().exit_code, 0);
  std::string text = read(scratch_ / "out" / "capture.json");
  text.insert(text.find('{') + 1, "\"colour\": 1,");
  write(scratch_ / "out" / "capture.json", text);
  expect_one_sentence(run_fringecal({"decode", (scratch_ / "out").string(), "-o", (scratch_ / "phase").string()}), 2,
                      {"capture.json", "colour"});
}

TEST_F(BadCapture, NoBoardInAnyPose) {
  ASSERT_EQ(import().exit_code, 0);
  write(scratch_ / "board.toml", "kind = \"chessboard\"\ncolumns = 9\nrows = 7\npitch_mm = 30\n");
  const auto result = run_fringecal({"calibrate", (scratch_ / "out").string(), "--board",
                                     (scratch_ / "board.toml").string(), "-o", (scratch_ / "scanner.json").string()});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.errors.find("out"), std::string::npos) << result.errors;  // the dropped pose, by name
  EXPECT_NE(result.errors.find("3"), std::string::npos) << result.errors;    // the number of poses that are needed
  EXPECT_FALSE(fs::exists(scratch_ / "scanner.json"));
}

class BadPoints : public testing::Test {
 protected:
  ProgramResult fit(const std::string& name, const std::string& text, const std::string& shape = "sphere") const {
    write(scratch_ / name, text);
    return run_fringecal({"fit", shape, (scratch_ / name).string(), "--json"});
  }
  ScratchFolder scratch_;
};

TEST_F(BadPoints, Empty) { expect_one_sentence(fit("a.xyz", ""), 2, {"a.xyz"}); }
TEST_F(BadPoints, NotANumber) { expect_one_sentence(fit("a.xyz", "0 0 0\n1 nan 0\n"), 2, {"a.xyz", "2"}); }
TEST_F(BadPoints, Infinity) { expect_one_sentence(fit("a.xyz", "0 0 0\n1 inf 0\n"), 2, {"a.xyz", "2"}); }
TEST_F(BadPoints, TwoNumbersInALine) { expect_one_sentence(fit("a.xyz", "0 0 0\n1 2\n"), 2, {"a.xyz", "2"}); }
TEST_F(BadPoints, CountThatDoesNotMatch) { expect_one_sentence(fit("a.ds", "5\n0 0 0\n1 2 3\n"), 2, {"a.ds", "5"}); }
// Two spheres in one file: the sphere fitted to both is no sphere, and the program says what to do.
TEST_F(BadPoints, OfSeveralObjectsAreSaidToBeNoSphere) {
  std::string one, two;
  for (int i = 0; i < 400; ++i) {
    const double z = 1.0 - (i + 0.5) / 400.0, across = std::sqrt(1.0 - z * z), r = 25.0 + 0.01 * std::sin(7.0 * i);
    const double x = r * across * std::cos(2.4 * i), y = r * across * std::sin(2.4 * i);
    const auto line = [](double a, double b, double c) {
      return std::to_string(a) + " " + std::to_string(b) + " " + std::to_string(c) + "\n";
    };
    one += line(x, y, r * z);
    two += line(0.6 * x + 60.0, 0.6 * y, 0.6 * r * z);
  }
  const auto alone = fit("one.xyz", one), both = fit("both.xyz", one + two);
  EXPECT_EQ(alone.exit_code, 0);
  EXPECT_EQ(both.exit_code, 0);
  EXPECT_EQ(alone.output.find("doubt"), std::string::npos) << alone.output;
  EXPECT_NE(both.output.find("doubt"), std::string::npos) << both.output;
  EXPECT_NE(both.output.find("--robust"), std::string::npos) << both.output;
  EXPECT_NE(both.output.find("fringecal find"), std::string::npos) << both.output;
}
TEST_F(BadPoints, FewerPointsThanParameters) {
  expect_one_sentence(fit("a.xyz", "0 0 0\n1 0 0\n0 1 0\n"), 2, {"3", "4"});
  expect_one_sentence(fit("a.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n", "cylinder"), 2, {"4", "5"});
}
TEST_F(BadPoints, MissingFile) {
  expect_one_sentence(run_fringecal({"fit", "plane", (scratch_ / "none.xyz").string()}), 2, {"none.xyz"});
}
TEST_F(BadPoints, TruncatedBinaryPly) {
  const std::string header =
      "ply\nformat binary_little_endian 1.0\nelement vertex 10\nproperty float x\nproperty float y\nproperty float "
      "z\nend_header\n";
  expect_one_sentence(fit("a.ply", header + std::string(50, '\0')), 2, {"a.ply"});
}

TEST(BadOption, UnknownCommandAndUnknownOptionAreUsage) {
  EXPECT_EQ(run_fringecal({"frobnicate"}).exit_code, 2);
  EXPECT_EQ(run_fringecal({"fit", "sphere", "a.xyz", "--frobnicate"}).exit_code, 2);
  EXPECT_EQ(run_fringecal({}).exit_code, 2);
}

}  // namespace
}  // namespace fringecal::test

#include "core/capture.h"

#include "core/file.h"
#include "core/image_file.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

namespace fringecal {
namespace {

using test::entries_in;
using test::message_of;
using test::TemporaryFolder;
using testing::AllOf;
using testing::HasSubstr;

/// A capture of three phase steps and one Gray bit with marks to tell the frames apart.
Capture small_capture(int bits = 8) {
  Capture capture;
  CaptureInfo& info = capture.info;
  info.width_px = 20;
  info.height_px = 10;
  info.bits = bits;
  info.plan.x = FringeCode{.gray_bits = 1, .phase_steps = 3, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
  info.plan.patterns = {{PatternKind::gray, CodeAxis::x, 0},
                        {PatternKind::phase, CodeAxis::x, 0},
                        {PatternKind::phase, CodeAxis::x, 1},
                        {PatternKind::phase, CodeAxis::x, 2}};
  for (std::size_t k = 0; k < 4; ++k) {
    info.frames.push_back({.file = "", .pattern = info.plan.patterns[k], .sha256 = "", .time = "2026-11-21T23:55:16Z"});
    if (bits == 8) {
      capture.frames.emplace_back(Image8(20, 10, static_cast<std::uint8_t>(10 * k + 1)));
    } else {
      capture.frames.emplace_back(Image16(20, 10, static_cast<std::uint16_t>(1000 * k + 1)));
    }
  }
  info.exposure_ms = 12.5;
  info.temperatures_degC["room"] = 20.25;
  info.devices["camera"] = "Basler A102k 20711234";
  info.source = "a test";
  return capture;
}

void replace_in(const std::filesystem::path& file, const std::string& from, const std::string& to) {
  std::string text = read_bytes(file);
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  write_atomically(file, text.replace(at, from.size(), to));
}

struct CaptureOnDisk : testing::Test {
  TemporaryFolder folder;
  std::filesystem::path at = folder / "board_1";
  Capture capture = small_capture();
  void SetUp() override { write_capture(at, capture); }
  std::string complaint() {
    return message_of<InputError>([&] { read_capture(at); });
  }
};

TEST_F(CaptureOnDisk, IsReadBackAsItWasWritten) {
  const Capture back = read_capture(at);
  ASSERT_EQ(back.frames.size(), 4u);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(std::get<Image8>(back.frames[k]).values(), std::get<Image8>(capture.frames[k]).values());
    EXPECT_EQ(back.info.frames[k].pattern, capture.info.frames[k].pattern);
    EXPECT_EQ(back.info.frames[k].sha256, sha256_of_file(at / back.info.frames[k].file));
    EXPECT_EQ(back.info.frames[k].time, "2026-11-21T23:55:16Z");
  }
  EXPECT_EQ(back.info.plan.x->period, 0.24);
  EXPECT_EQ(back.info.exposure_ms, 12.5);
  EXPECT_EQ(back.info.temperatures_degC.at("room"), 20.25);
  EXPECT_EQ(back.info.devices.at("camera"), "Basler A102k 20711234");
  EXPECT_EQ(back.info.source, "a test");
}

TEST_F(CaptureOnDisk, WrittenTwiceGivesTheSameBytes) {
  Capture again = small_capture();
  write_capture(folder / "again", again);
  EXPECT_EQ(read_bytes(at / "capture.json"), read_bytes(folder / "again" / "capture.json"));
}

TEST(Capture, KeepsTwelveBitsIn16AndKnowsWhereTheySaturate) {
  const TemporaryFolder folder;
  Capture capture = small_capture(12);
  std::get<Image16>(capture.frames[2])(3, 4) = 4095;
  write_capture(folder / "c", capture);
  const Capture back = read_capture(folder / "c");
  EXPECT_EQ(back.saturation_level(), 4095);
  EXPECT_EQ(std::get<Image16>(back.frames[2])(3, 4), 4095);
}

TEST_F(CaptureOnDisk, AMissingFrameIsNamed) {
  std::filesystem::remove(at / capture.info.frames[2].file);
  EXPECT_THAT(complaint(), AllOf(HasSubstr("02_phase_1.png"), HasSubstr("frame 2 ('phase 1')"), HasSubstr("missing")));
}

TEST_F(CaptureOnDisk, ATruncatedFrameIsNamed) {
  const auto file = at / capture.info.frames[1].file;
  write_atomically(file, read_bytes(file).substr(0, 60));
  EXPECT_THAT(complaint(), AllOf(HasSubstr("01_phase_0.png"), HasSubstr("truncated")));
}

TEST_F(CaptureOnDisk, AnExchangedFrameIsNamed) {
  write_atomically(at / capture.info.frames[1].file, encode_png(GrayImage(Image8(20, 10, 99))));
  EXPECT_THAT(complaint(), AllOf(HasSubstr("01_phase_0.png"), HasSubstr("SHA-256")));
}

TEST_F(CaptureOnDisk, AFrameOfAnotherSizeOrDepthIsNamedWithBothFigures) {
  const auto file = at / capture.info.frames[3].file;
  write_atomically(file, encode_png(GrayImage(Image8(21, 10, 9))));
  EXPECT_THAT(complaint(), AllOf(HasSubstr("03_phase_2.png"), HasSubstr("21 x 10"), HasSubstr("20 x 10")));
  write_atomically(file, encode_png(GrayImage(Image16(20, 10, 9))));
  EXPECT_THAT(complaint(), AllOf(HasSubstr("03_phase_2.png"), HasSubstr("16-bit image"), HasSubstr("8 bits")));
}

TEST_F(CaptureOnDisk, TheFirstBadFrameIsNamedWhateverTheThreadsDo) {
  for (const std::size_t k : {3u, 1u, 2u}) std::filesystem::remove(at / capture.info.frames[k].file);
  for (int round = 0; round < 20; ++round) EXPECT_THAT(complaint(), HasSubstr("frame 1 "));
}

TEST_F(CaptureOnDisk, AnUnknownKeyIsRefusedByName) {
  replace_in(at / "capture.json", "\"bits\": 8", "\"bits\": 8, \"colour\": 1");
  EXPECT_THAT(complaint(), AllOf(HasSubstr("capture.json"), HasSubstr("'colour'")));
}

TEST_F(CaptureOnDisk, ANewerSchemaAndAForeignFileAreRefused) {
  replace_in(at / "capture.json", "\"schema_version\": 1", "\"schema_version\": 2");
  EXPECT_THAT(complaint(), HasSubstr("use a newer fringecal"));
  write_atomically(at / "capture.json", "{\"schema\": \"something\"}");
  EXPECT_THAT(complaint(), HasSubstr("not a fringecal.capture file"));
  write_atomically(at / "capture.json", "{\"schema\": ");
  EXPECT_THAT(complaint(), AllOf(HasSubstr("line 1"), HasSubstr("not valid JSON")));
}

TEST_F(CaptureOnDisk, APlanThatDoesNotHoldIsRefused) {
  replace_in(at / "capture.json", "\"phase_steps\": 3", "\"phase_steps\": 4");
  EXPECT_THAT(complaint(), HasSubstr("'phase 3' of 4 phase steps is missing"));
}

TEST_F(CaptureOnDisk, AFileNameCannotLeaveTheFolder) {
  replace_in(at / "capture.json", "\"00_gray_0.png\"", "\"../secret.png\"");
  EXPECT_THAT(complaint(), AllOf(HasSubstr("../secret.png"), HasSubstr("own folder")));
}

TEST_F(CaptureOnDisk, ReplacesACaptureAndNoOtherFolder) {
  Capture other = small_capture();
  std::get<Image8>(other.frames[0])(0, 0) = 77;
  write_capture(at, other);
  EXPECT_EQ(std::get<Image8>(read_capture(at).frames[0])(0, 0), 77);
  std::filesystem::create_directory(folder / "photos");
  folder.write("photos/holiday.jpg", "x");
  EXPECT_THAT(message_of<InputError>([&] { write_capture(folder / "photos", other); }), HasSubstr("not a capture"));
  EXPECT_TRUE(std::filesystem::exists(folder / "photos" / "holiday.jpg"));
}

TEST(Capture, ASentenceTellsThatThereIsNoCapture) {
  const TemporaryFolder folder;
  EXPECT_THAT(message_of<InputError>([&] { read_capture(folder.path()); }), HasSubstr("fringecal import"));
}

/// Runs `call` in a process that may write no file longer than `limit` bytes (what a full disk does to it); true if it
/// threw an EnvironmentError.
template <class Call>
bool fails_on_full_disk(rlim_t limit, const Call& call) {
  const pid_t child = ::fork();
  if (child == 0) {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit most{limit, limit};
    ::setrlimit(RLIMIT_FSIZE, &most);
    int code = 1;
    try {
      call();
    } catch (const EnvironmentError&) {
      code = 0;
    } catch (...) {
      code = 2;
    }
    ::_exit(code);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST(Capture, AFullDiskLeavesNothingHalfWritten) {
  const TemporaryFolder folder;
  Capture capture = small_capture();
  EXPECT_TRUE(fails_on_full_disk(50, [&] { write_capture(folder / "c", capture); }));
  EXPECT_EQ(entries_in(folder.path()), 0u);
}

TEST(Capture, AFullDiskLeavesTheOldCapture) {
  const TemporaryFolder folder;
  Capture capture = small_capture();
  write_capture(folder / "c", capture);
  EXPECT_TRUE(fails_on_full_disk(50, [&] { write_capture(folder / "c", capture); }));
  EXPECT_EQ(entries_in(folder.path()), 1u);
  EXPECT_EQ(read_capture(folder / "c").frames.size(), 4u);
}

TEST(WriteAtomically, AFullDiskLeavesTheOldFile) {
  const TemporaryFolder folder;
  const auto file = folder.write("report.json", "the old one");
  EXPECT_TRUE(fails_on_full_disk(20, [&] { write_atomically(file, std::string(1000, 'x')); }));
  EXPECT_EQ(read_bytes(file), "the old one");
  EXPECT_EQ(entries_in(folder.path()), 1u);
}

}  // namespace
}  // namespace fringecal

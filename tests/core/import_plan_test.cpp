#include "core/import_plan.h"

#include "core/file.h"
#include "core/image_file.h"
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal {
namespace {

using test::message_of;
using test::TemporaryFolder;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr const char* kCode =
    "[codes.x]\ngray_bits = 2\nphase_steps = 3\nstripes_per_period = 2\nperiod = 0.24\nunit = \"mm\"\n";
constexpr const char* kSequence =
    "[[sequence]]\nfiles = \"f_{:02}.png\"\nfirst = 8\npatterns = [\"gray 0..1\", \"phase 0..2\"]\n";

/// Five images f_08.png .. f_12.png whose grey levels tell them apart.
struct PhotoFolder : testing::Test {
  TemporaryFolder folder;
  std::filesystem::path photos = folder / "photos";
  void SetUp() override {
    for (int i = 8; i <= 12; ++i) put(fmt::format("f_{:02}.png", i), Image8(6, 4, static_cast<std::uint8_t>(i)));
  }
  void put(const std::string& name, const GrayImage& image) { write_atomically(photos / name, encode_png(image)); }
  Capture import(const std::string& plan) { return import_capture(photos, folder.write("plan.toml", plan)); }
  std::string complaint(const std::string& plan) {
    return message_of<InputError>([&] { import(plan); });
  }
};

TEST(PatternWords, MeanWhatTheySay) {
  const auto words = [](const std::string& text) {
    std::vector<std::string> out;
    for (const Pattern& p : patterns_from(text, CodeAxis::x, "plan")) out.push_back(describe(p));
    return out;
  };
  EXPECT_THAT(words("gray 3"), ElementsAre("gray 3"));
  EXPECT_THAT(words("x gray 3 inverted"), ElementsAre("gray 3 inverted"));
  EXPECT_THAT(words("y gray 0..1 with inverses"),
              ElementsAre("y gray 0", "y gray 0 inverted", "y gray 1", "y gray 1 inverted"));
  EXPECT_THAT(words("phase 2..0"), ElementsAre("phase 2", "phase 1", "phase 0"));
  EXPECT_THAT(words("white"), ElementsAre("white"));
  for (const char* wrong :
       {"", "gray", "grey 3", "gray three", "gray 1..", "phase 2 inverted", "white 1", "z gray 0"}) {
    EXPECT_THAT(message_of<InputError>([&] { words(wrong); }), HasSubstr(std::string("'") + wrong + "'")) << wrong;
  }
}

TEST_F(PhotoFolder, BecomesACaptureInThePlansOrder) {
  const Capture capture = import(std::string(kCode) + kSequence);
  ASSERT_EQ(capture.frames.size(), 5u);
  for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(std::get<Image8>(capture.frames[k])(0, 0), 8 + static_cast<int>(k));
  EXPECT_EQ(describe(capture.info.frames[4].pattern), "phase 2");
  EXPECT_EQ(capture.info.width_px, 6);
  EXPECT_EQ(capture.info.height_px, 4);
  EXPECT_EQ(capture.info.bits, 8);
}

TEST_F(PhotoFolder, NotesOfThePlanReachTheCapture) {
  const Capture capture = import("exposure_ms = 20\nsource = \"lab 3\"\n" + std::string(kCode) + kSequence +
                                 "[devices]\ncamera = \"A102k\"\n[temperatures_degC]\nroom = 20.5\n");
  EXPECT_EQ(capture.info.exposure_ms, 20.0);
  EXPECT_EQ(capture.info.source, "lab 3");
  EXPECT_EQ(capture.info.devices.at("camera"), "A102k");
  EXPECT_EQ(capture.info.temperatures_degC.at("room"), 20.5);
}

TEST_F(PhotoFolder, NamesWithAStarStandInTheOrderOfTheirNumbers) {
  for (int i = 8; i <= 12; ++i) put(fmt::format("shot{}.png", i), Image8(6, 4, static_cast<std::uint8_t>(i)));
  const Capture capture =
      import(std::string(kCode) + "[[sequence]]\nfiles = \"shot*.png\"\npatterns = [\"gray 0..1\", \"phase 0..2\"]\n");
  for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(std::get<Image8>(capture.frames[k])(0, 0), 8 + static_cast<int>(k));
  std::filesystem::remove(photos / "shot9.png");
  EXPECT_THAT(complaint(std::string(kCode) +
                        "[[sequence]]\nfiles = \"shot*.png\"\npatterns = [\"gray 0..1\", \"phase 0..2\"]\n"),
              AllOf(HasSubstr("4 files"), HasSubstr("5 patterns")));
}

TEST_F(PhotoFolder, FramesCanBeListedOneByOne) {
  const Capture capture = import(std::string(kCode) +
                                 "[[sequence]]\nfiles = \"f_{:02}.png\"\nfirst = 10\npatterns = [\"phase 0..2\"]\n"
                                 "[[frames]]\nfile = \"f_09.png\"\nkind = \"gray\"\nbit = 1\n"
                                 "[[frames]]\nfile = \"f_08.png\"\nkind = \"gray\"\nbit = 0\n");
  EXPECT_EQ(describe(capture.info.frames[3].pattern), "gray 1");
  EXPECT_EQ(std::get<Image8>(capture.frames[3])(0, 0), 9);
}

TEST_F(PhotoFolder, TwelveBitsCanStandAtEitherEnd) {
  const std::string plan = "bits = 12\n" + std::string(kCode) + kSequence;
  for (int i = 8; i <= 12; ++i) put(fmt::format("f_{:02}.png", i), Image16(6, 4, static_cast<std::uint16_t>(4095 - i)));
  const Capture right = import(plan);
  EXPECT_EQ(right.saturation_level(), 4095);
  EXPECT_EQ(std::get<Image16>(right.frames[0])(1, 1), 4087);
  for (int i = 8; i <= 12; ++i)
    put(fmt::format("f_{:02}.png", i), Image16(6, 4, static_cast<std::uint16_t>((4095 - i) << 4)));
  EXPECT_THAT(complaint(plan), AllOf(HasSubstr("65392"), HasSubstr("4095 of 12 bits")));
  EXPECT_EQ(std::get<Image16>(import("left_aligned = true\n" + plan).frames[0])(1, 1), 4087);
  put("f_09.png", Image16(6, 4, 0xabc1));
  EXPECT_THAT(complaint("left_aligned = true\n" + plan), AllOf(HasSubstr("f_09.png"), HasSubstr("no multiple of 16")));
  EXPECT_THAT(complaint(std::string(kCode) + kSequence), HasSubstr("say in the plan how many bits"));
}

TEST_F(PhotoFolder, EveryMismatchIsOneSentence) {
  const std::string plan = std::string(kCode) + kSequence;
  EXPECT_THAT(complaint("colour = 1\n" + plan), AllOf(HasSubstr("plan.toml"), HasSubstr("'colour'")));
  EXPECT_THAT(complaint(plan + "last = 3\n"), AllOf(HasSubstr("sequence[0]"), HasSubstr("'last'")));
  EXPECT_THAT(complaint("codes = ["), AllOf(HasSubstr("plan.toml"), HasSubstr("line 1")));
  EXPECT_THAT(complaint(kCode), HasSubstr("lists no frames"));
  EXPECT_THAT(
      complaint(std::string(kCode) +
                "[[sequence]]\nfiles = \"f_{:02}.png\"\nfirst = 8\npatterns = [\"gray 0..1\", \"phase 0..1\"]\n"),
      HasSubstr("'phase 2' of 3 phase steps is missing"));
  EXPECT_THAT(complaint(std::string(kCode) + "[[sequence]]\nfiles = \"f.png\"\npatterns = [\"gray 0\"]\n"),
              HasSubstr("one place for the number"));
  std::filesystem::remove(photos / "f_10.png");
  EXPECT_THAT(complaint(plan), AllOf(HasSubstr("f_10.png"), HasSubstr("'phase 0'"), HasSubstr("missing")));
  put("f_10.png", Image8(6, 5));
  EXPECT_THAT(complaint(plan), AllOf(HasSubstr("f_10.png"), HasSubstr("6 x 5"), HasSubstr("6 x 4")));
  put("f_10.png", Image16(6, 4));
  EXPECT_THAT(complaint(plan), AllOf(HasSubstr("f_10.png"), HasSubstr("16-bit")));
  write_atomically(photos / "f_10.png", "not an image");
  EXPECT_THAT(complaint(plan), AllOf(HasSubstr("f_10.png"), HasSubstr("not a PNG")));
  EXPECT_THAT(message_of<InputError>([] { import_capture("/nowhere", "plan.toml"); }), HasSubstr("/nowhere"));
}

TEST(ImportPlan, OfTheRealPairIsAcceptedAndComplete) {
  const ImportPlan plan = read_import_plan(std::string(FRINGECAL_SOURCE_DIR) + "/tests/e2e/procam_gray.toml", "unused");
  ASSERT_EQ(plan.entries.size(), 22u);
  EXPECT_EQ(plan.entries.front().file, "graycode_20.png");
  EXPECT_EQ(describe(plan.entries[19].pattern), "y gray 9 inverted");
  EXPECT_EQ(plan.entries.back().file, "graycode_41.png");
  EXPECT_EQ(describe(plan.entries.back().pattern), "black");
}

}  // namespace
}  // namespace fringecal

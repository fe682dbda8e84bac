// A commissioning of "a scanner of one's own": the virtual scanner as a process, of which the program knows two addresses,
// and an operator - this test - who reads what is asked for, places it, turns the adjuster, and answers.
// The instrument is chen2008 with pixels 8/3 times as large.
#include "cli/virtual_verification.h"
#include "core/file.h"
#include "core/value.h"
#include "hw/open_plc.h"
#include "hw/plc_map.h"
#include "hw/scanner_file.h"
#include "tests/hw/virtual_support.h"
#include "tests/support/program.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <memory>

namespace fringecal::test {
namespace {

using testing::HasSubstr;
constexpr std::uint64_t kInstrument = 4;

class OperatedCommission : public testing::Test {
 protected:
  OperatedCommission() {
    const virt::VirtualScanner maker(preset_.file(), kInstrument);
    const model::Board board = maker.certified_board("chessboard");
    scratch.write("board.toml",
                  fmt::format("kind = 'chessboard'\ncolumns = {}\nrows = {}\npitch_x_mm = {}\npitch_y_mm = "
                              "{}\nu_print_mm = {}\nu_pitch_relative = {}\n",
                              board.columns, board.rows, board.pitch_x_mm, board.pitch_y_mm, board.u_print_mm,
                              board.u_pitch_relative));
    scratch.write("artefacts.toml", metrology::to_toml(cli::gauges_of(maker, kInstrument)));
    scratch.write(
        "instrument.toml",
        fmt::format(
            "name = 'scanner 3, hall 2'\npixel_mm = {}\nworking_distance_mm = {}\npattern_pitch_mm = "
            "{}\nmrad_per_division = 0.5\nflatness_mm = 0.005\nboard = 'board.toml'\nartefacts = 'artefacts.toml'\n"
            "error_limit_mm = 0.06\nform_limit_mm = 0.06\n[[scene]]\nname = 'spheres'\n"
            "artefacts = ['sphere50', 'sphere38', 'sphere30']\n",
            maker.pixel_mm(), maker.design_working_distance_mm(), maker.pattern_pitch_mm()));
    scanner_ = std::make_unique<RunningProgram>(
        std::vector<std::string>{"virtual", "--preset", preset_.file(), "--seed", std::to_string(kInstrument),
                                 "--address", "127.0.0.119", "--scanner-file", (scratch / "scanner.toml").string()});
    EXPECT_NE(scanner_->line(), "");
    plc_ = hw::open_plc(hw::read_scanner_file(scratch / "scanner.toml").plc_address);
  }

  std::vector<std::string> command() const {
    return {"commission",
            "--scanner",
            (scratch / "scanner.toml").string(),
            "--sheet",
            (scratch / "instrument.toml").string(),
            "-o",
            (scratch / "c").string(),
            "--repeats",
            "1",
            "--history",
            (scratch / "history.db").string()};
  }

  void place(const char* scene, int pose) {
    hw::VirtualSelection selection;
    selection.scene = static_cast<std::uint16_t>(
        std::find(hw::kSceneNames.begin(), hw::kSceneNames.end(), std::string(scene)) - hw::kSceneNames.begin());
    selection.pose = static_cast<std::uint16_t>(pose);
    selection.stack_seed = ++stacks_;
    plc_->select(selection);
  }

  /// Does what is asked for until the program ends or asks for `last`; everything it said.
  std::string operate(RunningProgram& program, const std::string& last = "nothing at all") {
    std::string said;
    for (;;) {
      const std::string line = program.line();
      said += line + "\n";
      if (line.find(last) != std::string::npos) return said;
      const auto after = [&](const char* words) {
        const auto at = line.find(words);
        return at == std::string::npos ? nullptr : line.c_str() + at + std::string(words).size();
      };
      if (const char* turn = after(">> Turn the adjuster ")) {
        plc_->turn_mrad(std::atof(turn));
      } else if (after(">> Put the flat board")) {
        place("alignment", 0);
      } else if (const char* pose = after("(pose ")) {
        place("calibration", std::atoi(pose) - 1);
      } else if (after(">> Put into the volume")) {
        place("spheres", 0);
      } else {
        if (line.empty()) return said;
        continue;
      }
      program.say("");
    }
  }

  const virt::ChangedPreset preset_{{{"width_px", "522"}, {"height_px", "390"}, {"pixel_mm", "0.0172"}}};
  ScratchFolder scratch;
  std::unique_ptr<RunningProgram> scanner_;
  std::unique_ptr<hw::RegisterPlc> plc_;
  std::uint64_t stacks_ = 0;
};

std::string text(const Value& tree, const char* key) { return tree.find(key) ? *tree.find(key)->if_text() : ""; }

TEST_F(OperatedCommission, AsksForEachPlaceAndTurnAndEndsCommissioned) {
  // The operator forgets the flat board: spheres stand there. Said, kept aside, asked for again.
  place("spheres", 0);
  {
    RunningProgram forgetful(command(), true);
    std::string line = forgetful.line();
    ASSERT_THAT(line, HasSubstr(">> Put the flat board"));
    forgetful.say("");
    std::string said;
    for (line = forgetful.line(); !line.empty(); line = forgetful.line()) said += line + "\n";
    EXPECT_EQ(forgetful.wait(), 2) << said;
    EXPECT_THAT(said, HasSubstr("kept as alignment/iteration-0-refused-1"));
  }
  // Nobody answers: it ends as with Ctrl-C.
  {
    RunningProgram alone(command(), true);
    operate(alone, ">> Put the calibration board");
    alone.hang_up();
    EXPECT_EQ(alone.wait(), 130);
  }
  RunningProgram program(command(), true);
  const std::string said = operate(program);
  ASSERT_EQ(program.wait(), 0) << said;
  for (const char* finished : {">> Put the flat board", ">> Turn"}) {
    EXPECT_EQ(said.find(finished), std::string::npos) << "what was finished is not asked for again";
  }
  const Value report = read_json(scratch / "c" / "report.json");
  EXPECT_EQ(text(report, "scanner_name"), "scanner 3, hall 2");
  EXPECT_FALSE(*report.find("virtual_instrument")->if_bool());
  EXPECT_EQ(text(report, "verdict"), "met") << text(report, "verdict_text");
  EXPECT_EQ(report.find("artefacts")->if_array()->size(), 3u);
  EXPECT_FALSE(std::filesystem::exists(scratch / "c" / "truth.json"));
  const auto history = run_fringecal({"history", "--file", (scratch / "history.db").string(), "list"});
  EXPECT_THAT(history.output, HasSubstr("scanner 3, hall 2"));
}

TEST_F(OperatedCommission, RefusesAnotherSheetAndExpiredCertificates) {
  const auto without = run_fringecal({"commission", "--scanner", (scratch / "scanner.toml").string()});
  EXPECT_EQ(without.exit_code, 2);
  {
    RunningProgram begun(command(), true);
    ASSERT_THAT(begun.line(), HasSubstr(">> Put the flat board"));
    begun.hang_up();
    EXPECT_EQ(begun.wait(), 130);
  }
  const std::string artefacts = read_bytes(scratch / "artefacts.toml");
  scratch.write("artefacts.toml", artefacts + "\n");
  const auto other = run_fringecal(command());
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.errors, HasSubstr("was begun with an instrument sheet of SHA-256"));
  std::string expired = artefacts;
  for (auto at = expired.find("2099-12-31"); at != std::string::npos; at = expired.find("2099-12-31")) {
    expired.replace(at, 10, "2026-02-01");
  }
  scratch.write("artefacts.toml", expired);
  const auto refused = run_fringecal(command());
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.errors, HasSubstr("--accept-expired"));
}

}  // namespace
}  // namespace fringecal::test

// The whole way on the virtual scanner, held against its truth: three instruments, each with its own errors.
#include "core/value.h"
#include "tests/support/program.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

namespace fringecal::test {
namespace {

namespace fs = std::filesystem;

const Value& at(const Value& tree, const char* key) {
  const Value* v = tree.find(key);
  if (!v) throw std::runtime_error(std::string("no key ") + key);
  return *v;
}

double number(const Value& tree, const char* key) {
  const Value& v = at(tree, key);
  return v.if_real() ? *v.if_real() : static_cast<double>(*v.if_integer());
}

class CommissioningOfSeed : public testing::TestWithParam<int> {};

TEST_P(CommissioningOfSeed, EndsAlignedWithEveryArtefactWithinItsLimits) {
  const ScratchFolder scratch;
  const auto run = run_fringecal(
      {"commission", "--virtual", "--output", (scratch / "c").string(), "--seed", std::to_string(GetParam())});
  ASSERT_EQ(run.exit_code, 0) << run.errors;
  EXPECT_NE(run.output.find("paper error"), std::string::npos) << run.output;
  EXPECT_TRUE(fs::exists(scratch / "c" / "report.html"));
  const Value report = read_json(scratch / "c" / "report.json");
  const Value truth = read_json(scratch / "c" / "truth.json");

  const auto& iterations = *at(at(report, "alignment"), "iterations").if_array();
  EXPECT_EQ(*at(iterations.back(), "verdict").if_text(), "aligned");
  // What the tolerance of 0.01 p on the coarsest bit's 108 mm asks for, 0.022 mrad, rounded down.
  EXPECT_LE(std::abs(number(truth, "theta_mrad")), 0.02);

  int spheres_and_cylinders = 0;
  for (const Value& artefact : *at(report, "artefacts").if_array()) {
    const std::string name = *at(artefact, "name").if_text();
    const Value& full = at(artefact, "models").if_array()->front();
    ASSERT_EQ(*at(full, "model").if_text(), "full");
    // Form: the pixels' noise alone gives 26 to 31 um; without the phase corrections it is 38 to 51 um. 35 um lies
    // between the two.
    EXPECT_LE(number(full, "max_form_sd_mm"), 0.035) << name;
    EXPECT_GT(number(full, "max_form_sd_mm"), 0.02) << name << ": below what the pixels' noise allows";
    if (!full.find("error_mm")) continue;
    ++spheres_and_cylinders;
    EXPECT_LE(std::abs(number(full, "error_mm")), 0.06) << name;
    EXPECT_EQ(at(artefact, "repeats").if_array()->size(), 10u) << name;
  }
  EXPECT_EQ(spheres_and_cylinders, 4);
}

INSTANTIATE_TEST_SUITE_P(Three, CommissioningOfSeed, testing::Values(1, 2, 3));

TEST(Commissioning, ContinuesAfterTheLastFinishedStepAndEndsTheSame) {
  const ScratchFolder scratch;
  const std::vector<std::string> command = {"commission", "--virtual", "--repeats", "1", "--seed", "5", "--output"};
  const auto in = [&](const char* folder) {
    auto words = command;
    words.push_back((scratch / folder).string());
    return words;
  };
  ASSERT_EQ(run_fringecal(in("whole")).exit_code, 0);
  ASSERT_EQ(run_fringecal(in("broken")).exit_code, 0);
  // What a stop in the middle of the verification leaves behind.
  const auto pose_before = fs::last_write_time(scratch / "broken" / "calibration" / "pose-03" / "capture.json");
  fs::remove_all(scratch / "broken" / "verification");
  fs::remove(scratch / "broken" / "report.json");
  ASSERT_EQ(run_fringecal(in("broken")).exit_code, 0);
  EXPECT_EQ(fs::last_write_time(scratch / "broken" / "calibration" / "pose-03" / "capture.json"), pose_before);
  const Value a = read_json(scratch / "whole" / "report.json"), b = read_json(scratch / "broken" / "report.json");
  EXPECT_EQ(to_json(at(a, "artefacts")), to_json(at(b, "artefacts")));

  auto other = in("whole");
  other[5] = "6";
  const auto refused = run_fringecal(other);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.errors.find("--fresh"), std::string::npos) << refused.errors;
  other.push_back("--fresh");
  EXPECT_EQ(run_fringecal(other).exit_code, 0);
}

TEST(Commissioning, RefusesAFolderThatIsNotItsOwn) {
  const ScratchFolder scratch;
  fs::create_directories(scratch / "mine");
  std::ofstream(scratch / "mine" / "letter.txt") << "dear";
  const auto refused = run_fringecal({"commission", "--virtual", "--output", (scratch / "mine").string(), "--fresh"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_EQ(listing(scratch / "mine"), std::vector<std::string>{"letter.txt"});
}

}  // namespace
}  // namespace fringecal::test

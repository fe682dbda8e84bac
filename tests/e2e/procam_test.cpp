// A real camera-projector pair, as its owner would calibrate it: five poses of a 9 x 7 chessboard of 75 mm, ten Gray
// bits of the projector's vertical coordinate. Reference figures: data README (converged OpenCV solutions).
#include "tests/support/program.h"
#include "tests/support/value_at.h"

#include <gtest/gtest.h>

#include <filesystem>

namespace fringecal::test {
namespace {

namespace fs = std::filesystem;

class Procam : public testing::Test {
 protected:
  // Imports the poses once and calibrates once per set of terms; every case looks at its own solution.
  static Value calibrated(const std::string& camera_terms, const std::string& method) {
    const fs::path data = fs::path(FRINGECAL_SHARED_DATA) / "procam-gray";
    const ScratchFolder scratch;
    std::vector<std::string> command = {"calibrate"};
    for (int pose = 0; pose < 5; ++pose) {
      const std::string name = "pose_" + std::to_string(pose);
      const auto imported = run_fringecal({"import", (data / name).string(), "--plan",
                                           std::string(FRINGECAL_SOURCE_DIR) + "/tests/e2e/procam_gray.toml", "-o",
                                           (scratch / name).string()});
      EXPECT_EQ(imported.exit_code, 0) << imported.errors;
      command.push_back((scratch / name).string());
    }
    for (const std::string& word :
         {std::string("--board"), std::string(FRINGECAL_SOURCE_DIR) + "/tests/e2e/procam_board.toml", std::string("-o"),
          (scratch / "scanner.json").string(), std::string("--camera-terms"), camera_terms, std::string("--method"),
          method}) {
      command.push_back(word);
    }
    const auto result = run_fringecal(command);
    EXPECT_EQ(result.exit_code, 0) << result.errors;
    return read_json(scratch / "scanner.json");
  }
  void SetUp() override {
    if (!fs::exists(fs::path(FRINGECAL_SHARED_DATA) / "procam-gray")) {
      GTEST_SKIP() << "shared data not present: procam-gray";
    }
  }
};

// The reference solutions are plain least squares over all corners, camera alone: --method staged works as they do.
TEST_F(Procam, RadialTermsReproduceTheConvergedReference) {
  const Value scanner = calibrated("radial", "staged");
  // The target: focal lengths within 0.2 %, principal point within 4 px of the reference with the same terms
  // (camera alone, k1 and k2: f = 3453.80 / 3452.51, c = 611.02 / 527.11).
  EXPECT_NEAR(number_at(scanner, {"camera", "fx_px"}), 3453.80, 0.002 * 3453.80);
  EXPECT_NEAR(number_at(scanner, {"camera", "fy_px"}), 3452.51, 0.002 * 3452.51);
  EXPECT_NEAR(number_at(scanner, {"camera", "cx_px"}), 611.02, 4.0);
  EXPECT_NEAR(number_at(scanner, {"camera", "cy_px"}), 527.11, 4.0);
  // The projector from its vertical code alone: within 1.5 % of the converged two-direction solution, 1895.7 px.
  EXPECT_NEAR(number_at(scanner, {"projector", "y", "f"}), 1895.7, 0.015 * 1895.7);
}

TEST_F(Procam, FiveTermsReproduceTheConvergedReference) {
  const Value scanner = calibrated("full", "staged");
  // OpenCV's five coefficients, converged: f = 3452.39 / 3449.93, c = 587.17 / 521.45.
  EXPECT_NEAR(number_at(scanner, {"camera", "fx_px"}), 3452.39, 0.002 * 3452.39);
  EXPECT_NEAR(number_at(scanner, {"camera", "fy_px"}), 3449.93, 0.002 * 3449.93);
  EXPECT_NEAR(number_at(scanner, {"camera", "cx_px"}), 587.17, 4.0);
  EXPECT_NEAR(number_at(scanner, {"camera", "cy_px"}), 521.45, 4.0);
  EXPECT_NEAR(number_at(scanner, {"projector", "y", "f"}), 1895.7, 0.015 * 1895.7);
}

TEST_F(Procam, JointSolveReproducesTheBoardBetterThanTheStagedOne) {
  const Value staged = calibrated("radial", "staged"), joint = calibrated("radial", "joint");
  EXPECT_NEAR(number_at(joint, {"projector", "y", "f"}), 1895.7, 0.015 * 1895.7);
  EXPECT_EQ(number_at(joint, {"residuals", "poses"}), 5);
  // The corners triangulated through each scanner against the 75 mm grid. A camera pixel is about 0.3 mm on the board,
  // a projector pixel 0.6 mm at an intersection of 0.3 rad; corners good to 0.2 px give about half a millimetre.
  const double staged_mm = number_at(staged, {"residuals", "grid_rms_mm"});
  const double joint_mm = number_at(joint, {"residuals", "grid_rms_mm"});
  EXPECT_GT(joint_mm, 0.0);
  EXPECT_LT(joint_mm, staged_mm);
  EXPECT_LT(staged_mm, 1.0);
}

}  // namespace
}  // namespace fringecal::test

// Corners and lenses of other programs through the command line, and what a calibration is uncertain by.
#include "calib/calibrate.h"
#include "calib/corner_files.h"
#include "core/file.h"
#include "tests/calib/synthetic_board_views.h"
#include "tests/support/program.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::test {
namespace {

using ::testing::HasSubstr;

/// A scanner calibrated from synthetic corners, written to a file.
std::string written_scanner(const ScratchFolder& scratch) {
  auto scanner = calib::calibrate(views(known_scanner(), known_board(), 8, {.seed = 3}), known_board(), 1392, 1040,
                                  known_plan(), {.camera_terms = calib::DistortionTerms::radial, .u_bow_relative = 0});
  scanner->name = "synthetic";
  const std::string file = (scratch / "scanner.json").string();
  model::write_scanner(file, *scanner);
  return file;
}

TEST(Exchange, ExportedLensesComeBackToTheSameBytes) {
  const ScratchFolder scratch;
  const std::string scanner = written_scanner(scratch);
  for (const std::string to : {"mrcal", "opencv"}) {
    const std::string ending = to == "mrcal" ? ".cameramodel" : ".yml";
    const auto out = run_fringecal({"export", scanner, "--to", to, "-o", (scratch / to).string()});
    ASSERT_EQ(out.exit_code, 0) << out.errors;
    const std::string camera = (scratch / to / ("camera" + ending)).string();
    const std::string again = (scratch / (to + ".json")).string();
    const auto in = run_fringecal({"import-lenses", scanner, "--camera", camera, "--projector",
                                   (scratch / to / ("projector" + ending)).string(), "-o", again});
    ASSERT_EQ(in.exit_code, 0) << in.errors;
    const model::Scanner a = model::read_scanner(scanner), b = model::read_scanner(again);
    EXPECT_EQ(a.camera.fx_px, b.camera.fx_px);
    EXPECT_EQ(a.camera.distortion, b.camera.distortion);
    EXPECT_EQ(a.projector.distortion, b.projector.distortion);
    // Through stripes, a rotation vector or matrix, and metres: some roundings.
    EXPECT_NEAR(a.projector.x->u0, b.projector.x->u0, 1e-13);
    EXPECT_LT((a.proj_from_cam.translation_mm - b.proj_from_cam.translation_mm).norm(), 1e-11);
    EXPECT_TRUE(b.uncertainty.names.empty());
  }
}

TEST(Exchange, CornersOfAnotherProgramGiveACameraAndAreCrossChecked) {
  const ScratchFolder scratch;
  std::string vnl = "# filename x y level\n";
  int image = 0;
  for (const auto& view : planar_views(8, 10, 10, 22, 0.1)) {
    ++image;
    for (const auto& p : view.pixels) vnl += fmt::format("image{}.png {} {} 0\n", image, p.x(), p.y());
  }
  write_atomically(scratch / "corners.vnl", vnl);
  write_atomically(scratch / "board.toml", "kind = \"chessboard\"\ncolumns = 10\nrows = 10\npitch_mm = 22\n");
  for (const std::string solver : {"mrcal", "opencv"}) {
    const auto out = run_fringecal({"calibrate", "--corners", (scratch / "corners.vnl").string(), "--board",
                                    (scratch / "board.toml").string(), "--image-size", "1392", "1040", "--cross-check",
                                    solver, "-o", (scratch / "camera.cameramodel").string()});
    ASSERT_EQ(out.exit_code, 0) << out.errors;
    std::printf("%s", out.output.c_str());
    EXPECT_THAT(out.output, HasSubstr("cross-check"));
    EXPECT_THAT(out.output, HasSubstr("px at most"));
  }
  const auto tsai =
      run_fringecal({"calibrate", "--corners", (scratch / "corners.vnl").string(), "--board",
                     (scratch / "board.toml").string(), "--image-size", "1392", "1040", "--method", "tsai"});
  EXPECT_EQ(tsai.exit_code, 0) << tsai.errors;
  EXPECT_THAT(tsai.output, HasSubstr("Tsai's two stages"));
  const auto none = run_fringecal(
      {"calibrate", "--corners", (scratch / "corners.vnl").string(), "--board", (scratch / "board.toml").string()});
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.errors, HasSubstr("--image-size"));
}

TEST(Exchange, UncertaintyOfAScannerIsAPageAndAProposal) {
  const ScratchFolder scratch;
  const std::string scanner = written_scanner(scratch);
  const auto out =
      run_fringecal({"uncertainty", scanner, "--halves", "--next-pose", "-o", (scratch / "u.html").string()});
  ASSERT_EQ(out.exit_code, 0) << out.errors;
  std::printf("%s", out.output.c_str());
  EXPECT_THAT(out.output, HasSubstr("halves of the poses"));
  EXPECT_THAT(out.output, HasSubstr("next: hold the board"));
  EXPECT_THAT(read_bytes(scratch / "u.html"), HasSubstr("section Z"));
  const auto bare = run_fringecal({"export", scanner, "--to", "mrcal", "-o", (scratch / "m").string()});
  ASSERT_EQ(bare.exit_code, 0);
  const auto in = run_fringecal({"import-lenses", scanner, "--camera", (scratch / "m" / "camera.cameramodel").string(),
                                 "-o", (scratch / "bare.json").string()});
  ASSERT_EQ(in.exit_code, 0) << in.errors;
  const auto refused = run_fringecal({"uncertainty", (scratch / "bare.json").string()});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.errors, HasSubstr("no covariance"));
}

}  // namespace
}  // namespace fringecal::test

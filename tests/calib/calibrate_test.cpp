#include "calib/calibrate.h"
#include "tests/calib/synthetic_board_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal {
namespace {

using calib::calibrate;
using calib::CalibrationOptions;
using calib::DistortionTerms;
using ::testing::HasSubstr;

Result<model::Scanner> solve(const std::vector<model::BoardObservation>& seen, CalibrationOptions options = {},
                             bool two_axes = false) {
  model::Board board = test::known_board();
  board.u_print_mm = 0.0;
  board.u_pitch_relative = 1e-9;
  return calibrate(seen, board, 1392, 1040, test::known_plan(two_axes), options);
}

TEST(Calibrate, FindsAKnownScannerFromPerfectViews) {
  const auto truth = test::known_scanner();
  const auto seen = test::views(truth, test::known_board(), 12, {.u_pixel_px = 0, .u_coordinate_mm = 0});
  const auto found = solve(seen, {.camera_terms = DistortionTerms::radial_tangential});
  ASSERT_TRUE(found) << found.error().sentence;
  std::puts(found->method.c_str());
  // Perfect readings are fitted to the rounding of the readings (1e-12 px), the weakest parameter (the place along the fringes,
  // seen through distortion only) is amplified by 1e5 and pulled by its prior, whose weight is that of 1e-6 mm readings.
  EXPECT_NEAR(found->camera.fx_px, truth.camera.fx_px, 1e-4);
  EXPECT_NEAR(found->camera.cx_px, truth.camera.cx_px, 1e-4);
  EXPECT_NEAR(found->projector.x->f, truth.projector.x->f, 1e-5);
  EXPECT_NEAR(found->proj_from_cam.translation_mm.x(), 400.0, 1e-3);
}

TEST(Calibrate, FindsAKnownScannerFromNoisyViews) {
  const auto truth = test::known_scanner();
  const auto seen = test::views(truth, test::known_board(), 15, {});
  const auto found = solve(seen);
  ASSERT_TRUE(found) << found.error().sentence;
  std::puts(found->method.c_str());
  for (std::size_t i = 0; i < found->uncertainty.names.size(); ++i)
    std::printf("%s %g\n", found->uncertainty.names[i].c_str(), *found->uncertainty.u(found->uncertainty.names[i]));
  std::printf("%g %g %g %g grid %g chi2 %g it %d used %d rej %d\n", found->camera.fx_px, found->camera.cx_px, found->projector.x->f,
              found->proj_from_cam.translation_mm.y(), found->residuals.grid_rms_mm, found->residuals.chi2_per_dof, found->residuals.iterations,
              found->residuals.corners_used, found->residuals.corners_rejected);
}

TEST(Calibrate, RefusesTwoPoses) {
  const auto seen = test::views(test::known_scanner(), test::known_board(), 2, {});
  const auto found = solve(seen);
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("at least 3"));
}

TEST(Calibrate, RefusesParallelBoards) {
  const auto seen = test::parallel_views(test::known_scanner(), test::known_board(), 8, {});
  const auto found = solve(seen);
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("tilted"));
}

}  // namespace
}  // namespace fringecal

#include "calib/calibrate.h"

#include "tests/calib/synthetic_board_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace fringecal {
namespace {

using calib::calibrate;
using calib::CalibrationOptions;
using calib::DistortionTerms;
using ::testing::HasSubstr;

Result<model::Scanner> solve(const std::vector<model::BoardObservation>& seen, const CalibrationOptions& options = {},
                             bool two_axes = false) {
  model::Board board = test::known_board();
  board.u_print_mm = 0.0;
  board.u_pitch_relative = 1e-6;
  return calibrate(seen, board, 1392, 1040, test::known_plan(two_axes), options);
}

TEST(Calibrate, FindsAKnownScannerFromPerfectViews) {
  const auto truth = test::known_scanner();
  const auto seen = test::views(truth, test::known_board(), 12, {.u_pixel_px = 0, .u_coordinate_mm = 0});
  const auto found = solve(seen, {.camera_terms = DistortionTerms::radial_tangential});
  ASSERT_TRUE(found) << found.error().sentence;
  // The scales end at their floor: 1e-6 px and 1e-9 mm, so the standard uncertainties are 3e-5 of those at 0.03 px (f
  // 0.3 px, base line 0.03 mm, u(f_P) 0.004 mm), and the pull of the priors (bow 0.3 mm, along 40 mm; both off by less
  // than one of theirs) is smaller still.
  EXPECT_NEAR(found->camera.fx_px, truth.camera.fx_px, 1e-4);
  EXPECT_NEAR(found->camera.cx_px, truth.camera.cx_px, 1e-4);
  EXPECT_NEAR(found->camera.distortion[2], truth.camera.distortion[2], 1e-8);
  EXPECT_NEAR(found->projector.x->f, truth.projector.x->f, 1e-5);
  EXPECT_NEAR(found->proj_from_cam.translation_mm.x(), 400.0, 1e-3);
  EXPECT_EQ(found->residuals.corners_rejected, 0);
}

TEST(Calibrate, FindsBothAxesWithFullDistortionSets) {
  const auto truth = test::known_scanner(true);
  const auto seen = test::views(truth, test::known_board(), 12, {.u_pixel_px = 0, .u_coordinate_mm = 0});
  const auto found = solve(
      seen, {.camera_terms = DistortionTerms::radial_tangential, .projector_terms = DistortionTerms::radial_tangential},
      true);
  ASSERT_TRUE(found) << found.error().sentence;
  // As above; the place along the fringes is now measured as well as the one across.
  EXPECT_NEAR(found->projector.y->f, truth.projector.y->f, 1e-5);
  EXPECT_NEAR(found->proj_from_cam.translation_mm.y(), truth.proj_from_cam.translation_mm.y(), 1e-3);
  EXPECT_TRUE(found->uncertainty.u("projector.y.f").has_value());
  for (const auto& p : found->priors) EXPECT_EQ(p.parameter.find("translation"), std::string::npos);
}

TEST(Calibrate, TakesTangentialTermsWhereTheDataHaveThem) {
  const auto seen = test::views(test::known_scanner(), test::known_board(), 15, {});
  const auto found = solve(seen);
  ASSERT_TRUE(found) << found.error().sentence;
  // p1 = 2e-4 is five standard uncertainties of the 15 poses: chi2 falls by some 15 to 25, two terms cost 2 ln n = 15.
  EXPECT_TRUE(found->uncertainty.u("camera.p1").has_value()) << found->method;
  EXPECT_FALSE(found->uncertainty.u("camera.k3").has_value()) << found->method;
  EXPECT_THAT(found->method, HasSubstr("BIC"));
}

TEST(Calibrate, NamesThePriorAlongTheFringes) {
  const auto found =
      solve(test::views(test::known_scanner(), test::known_board(), 8, {}), {.camera_terms = DistortionTerms::radial});
  ASSERT_TRUE(found) << found.error().sentence;
  bool named = false;
  for (const auto& p : found->priors) named = named || p.parameter == "proj_from_cam.translation_y_mm";
  EXPECT_TRUE(named);
}

TEST(Calibrate, LeavesOutTheCornersThatAreWrongAndOnlyThose) {
  auto seen = test::views(test::known_scanner(), test::known_board(), 10, {});
  seen[2].corners[11].pixel.x() += 3.0;  // a reflection
  seen[4].corners[30].x->value += 0.24;  // a fringe number that is off by one
  const auto found = solve(seen, {.camera_terms = DistortionTerms::radial_tangential});
  ASSERT_TRUE(found) << found.error().sentence;
  EXPECT_FALSE(found->observations[2].corners[11].used);
  EXPECT_FALSE(found->observations[4].corners[30].used);
  // 630 corners with three components each: 0.12 good ones are expected beyond 4 standard deviations.
  EXPECT_LE(found->residuals.corners_rejected, 4);
}

TEST(Calibrate, EstimatesTheBowOfTheBoard) {
  const auto truth = test::known_scanner();
  const auto seen = test::views(truth, test::known_board(), 12, {.bow_mm = 0.075});
  const auto bent = solve(seen, {.camera_terms = DistortionTerms::radial_tangential});
  const auto flat = solve(seen, {.camera_terms = DistortionTerms::radial_tangential, .u_bow_relative = 0});
  ASSERT_TRUE(bent && flat);
  const double u = *bent->uncertainty.u("projector.x.f");
  EXPECT_LT(std::abs(bent->projector.x->f - truth.projector.x->f), 4.0 * u);
  EXPECT_THAT(bent->method, HasSubstr("bow +0.07"));
  // A bow of 75 um is three times the scatter of a triangulated corner: without it the residuals show it.
  EXPECT_GT(flat->residuals.projector_rms, 1.2 * bent->residuals.projector_rms);
}

TEST(Calibrate, IsTheSameToTheLastBitTwice) {
  const auto seen = test::views(test::known_scanner(), test::known_board(), 6, {});
  const auto a = solve(seen, {.camera_terms = DistortionTerms::radial});
  const auto b = solve(seen, {.camera_terms = DistortionTerms::radial});
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->camera.fx_px, b->camera.fx_px);
  EXPECT_EQ(a->uncertainty.covariance, b->uncertainty.covariance);
}

TEST(Calibrate, RefusesTwoPosesWithTheNumberNeeded) {
  const auto found = solve(test::views(test::known_scanner(), test::known_board(), 2, {}));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("at least 3"));
}

TEST(Calibrate, RefusesParallelBoards) {
  const auto found = solve(test::parallel_views(test::known_scanner(), test::known_board(), 4, {}),
                           {.camera_terms = DistortionTerms::radial});
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("tilted"));
}

TEST(Calibrate, RefusesAValueThatIsNotFiniteByItsPose) {
  auto seen = test::views(test::known_scanner(), test::known_board(), 4, {});
  seen[3].corners[9].x->value = std::numeric_limits<double>::quiet_NaN();
  const auto found = solve(seen);
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("pose_04"));
}

TEST(Calibrate, RefusesTangentialProjectorTermsOnOneAxis) {
  const auto found =
      solve(test::views(test::known_scanner(), test::known_board(), 4, {}), {.projector_terms = DistortionTerms::full});
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("radial"));
}

}  // namespace
}  // namespace fringecal

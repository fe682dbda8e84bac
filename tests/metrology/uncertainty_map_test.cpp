// What a calibration leaves open is named: maps and combinations on good views, and views that are ill posed on purpose.
#include "metrology/uncertainty_map.h"

#include "calib/calibrate.h"
#include "calib/halves.h"
#include "calib/next_pose.h"
#include "metrology/compare_scanners.h"
#include "metrology/residual_whiteness.h"
#include "reports/uncertainty_page.h"
#include "tests/calib/synthetic_board_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/math/distributions/chi_squared.hpp>

#include <algorithm>

namespace fringecal::metrology {
namespace {

using ::testing::HasSubstr;

Result<model::Scanner> calibrated(const std::vector<model::BoardObservation>& views,
                                  calib::DistortionTerms terms = calib::DistortionTerms::radial_tangential) {
  return calib::calibrate(views, test::known_board(), 1392, 1040, test::known_plan(),
                          {.camera_terms = terms, .u_bow_relative = 0});
}

const model::Scanner& good() {
  static const model::Scanner scanner =
      calibrated(test::views(test::known_scanner(), test::known_board(), 12, {.seed = 5})).value();
  return scanner;
}

bool names(const UncertaintyMap& map, const std::string& parameter) {
  for (const auto& c : map.combinations) {
    for (const auto& share : c.shares) {
      if (c.open && share.parameter == parameter) return true;
    }
  }
  return false;
}

std::string all_words(const UncertaintyMap& map) {
  std::string out;
  for (const auto& words : open_words(map)) out += words + "\n";
  return out;
}

TEST(UncertaintyMap, SplitsIntoCombinationsThatAddUpToTheWhole) {
  const auto map = uncertainty_map(good(), {.section_steps = 9});
  ASSERT_TRUE(map) << map.error().sentence;
  double sum = 0;
  for (const auto& c : map->combinations) sum += c.rms_mm * c.rms_mm;
  // Orthogonal parts of one mean square, cut off at 99 %; six at most.
  EXPECT_LE(sum, map->rms_mm * map->rms_mm * (1 + 1e-9));
  EXPECT_GT(sum, 0.9 * map->rms_mm * map->rms_mm);
  ASSERT_EQ(map->sections.size(), 3u);
  for (const auto& p : map->points) {
    // Eq. 1: the parts of the diagonal.
    EXPECT_NEAR(p.total_mm * p.total_mm, p.calibration_mm * p.calibration_mm + p.phase_mm * p.phase_mm, 1e-12);
    EXPECT_GT(p.phase_mm, 0);
  }
  // The middle of a section is a point of the volume like any other: as uncertain as the grid's points near it.
  const auto& z = map->sections.front();
  const auto& middle = z.values[static_cast<std::size_t>((z.rows / 2) * z.columns + z.columns / 2)];
  ASSERT_TRUE(middle);
  EXPECT_LT(middle->calibration_mm, map->worst_mm);
}

TEST(UncertaintyMap, PhaseNoiseIsThatOfATriangulation) {
  const auto map = uncertainty_map(good(), {.u_phase_rad = 0.01, .section_steps = 0});
  ASSERT_TRUE(map);
  // On the axis a shift of u by u(u) = p u(phi) / 2 pi moves the point by L/f u(u) across and, along the camera's ray, by
  // that over sin(angle between the rays), 0.37 for a base of 400 at 1000 mm; over the volume within 20 %.
  const double across = 1000.0 / 32.0 * 0.24 * 0.01 / (2 * 3.14159265);
  double mean = 0;
  for (const auto& p : map->points) mean += p.phase_mm / static_cast<double>(map->points.size());
  EXPECT_NEAR(mean, across / 0.371, 0.2 * across / 0.371);
}

TEST(UncertaintyMap, NamesTheProjectorsPlaceAlongTheFringesAsHeldByItsPrior) {
  // With lenses without distortion one code axis does not see it at all.
  model::Scanner truth = test::known_scanner();
  truth.projector.distortion = {};
  truth.camera.distortion = {-0.1, 0.06, 0, 0, 0};
  const auto found = calibrated(test::views(truth, test::known_board(), 12, {.seed = 5}));
  ASSERT_TRUE(found) << found.error().sentence;
  const auto map = uncertainty_map(*found, {.section_steps = 0});
  ASSERT_TRUE(map) << map.error().sentence;
  EXPECT_THAT(all_words(*map), HasSubstr("held by its prior, not by the views: proj_from_cam.translation_y_mm"));
}

TEST(IllPosed, TwoPosesAreRefused) {
  const auto found = calibrated(test::views(test::known_scanner(), test::known_board(), 2, {}));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("2 poses of the board; at least 3"));
}

TEST(IllPosed, ParallelBoardsAreRefusedAndTheFocalLengthNamed) {
  // With tangential terms too, whose p2 the views leave open as well: in mm at the edge f is what matters.
  for (const auto terms :
       {calib::DistortionTerms::radial, calib::DistortionTerms::radial_tangential, calib::DistortionTerms::automatic}) {
    const auto found = calibrated(test::parallel_views(test::known_scanner(), test::known_board(), 8, {}), terms);
    ASSERT_FALSE(found);
    std::printf("parallel boards: %s\n", found.error().sentence.c_str());
    // A focal length against its distance, of the camera or of the projector.
    EXPECT_THAT(found.error().sentence, ::testing::ContainsRegex("fx_px|fy_px|projector.x.f"));
  }
}

TEST(IllPosed, NearlyParallelBoardsNameTheFocalLengthFirst) {
  // Turned by 1 degree about axes that go round.
  const model::Scanner truth = test::known_scanner();
  const Eigen::Vector3d middle = 0.5 * test::known_board().corner_mm(8, 6);
  std::vector<model::BoardObservation> views;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.0175, Eigen::Vector3d(std::cos(2.4 * i), std::sin(2.4 * i), 0)));
    const Eigen::Vector3d at(10.0 * i - 35, -5.0 * i + 18, 1077 + 30.0 * (i - 4));
    views.push_back(test::view_at(truth, test::known_board(), {turn, at - turn * middle},
                                  {.seed = 50 + static_cast<std::uint64_t>(i)}));
  }
  const auto found = calibrated(views);
  ASSERT_TRUE(found) << found.error().sentence;
  const auto map = uncertainty_map(*found, {.section_steps = 0});
  ASSERT_TRUE(map);
  std::printf("nearly parallel: %s", all_words(*map).c_str());
  ASSERT_TRUE(map->combinations.front().open);
  bool focal = false;
  for (const auto& share : map->combinations.front().shares) {
    focal = focal || share.parameter == "camera.fx_px" || share.parameter == "camera.fy_px";
  }
  EXPECT_TRUE(focal);
}

/// The board at a third of its size, always near one corner of the image.
std::vector<model::BoardObservation> in_one_corner() {
  auto views = test::views(test::known_scanner(), test::known_board(), 12, {.seed = 5});
  for (auto& o : views) {
    std::erase_if(o.corners, [](const auto& c) { return c.column > 3 || c.row > 2; });
  }
  return views;
}

TEST(IllPosed, ABoardAlwaysInOneCornerIsFlaggedWithTheLensNamed) {
  const auto found = calibrated(in_one_corner());
  ASSERT_TRUE(found) << found.error().sentence;
  const auto map = uncertainty_map(*found, {.section_steps = 0}), whole = uncertainty_map(good(), {.section_steps = 0});
  ASSERT_TRUE(map && whole);
  std::printf("one corner: %.3f mm rms, %.3f at most\n%s", map->rms_mm, map->worst_mm, all_words(*map).c_str());
  EXPECT_TRUE(names(*map, "camera.k1") || names(*map, "camera.k2") || names(*map, "projector.k1") ||
              names(*map, "projector.k2") || names(*map, "camera.cx_px") || names(*map, "projector.x.u0"));
  EXPECT_GT(map->worst_mm, 3 * whole->worst_mm);
}

TEST(IllPosed, PosesAtOneDistanceAreFlaggedAtTheEndsOfTheDepth) {
  const auto views = test::views(test::known_scanner(), test::known_board(), 40, {.seed = 5});
  std::vector<model::BoardObservation> one_distance, several(views.begin(), views.begin() + 8);
  for (std::size_t i = 2; i < views.size(); i += 5) one_distance.push_back(views[i]);  // the middle of the depth
  const auto poor = calibrated(one_distance), rich = calibrated(several);
  ASSERT_TRUE(poor && rich);
  const auto map = uncertainty_map(*poor, {.section_steps = 0}), whole = uncertainty_map(*rich, {.section_steps = 0});
  ASSERT_TRUE(map && whole);
  std::printf("one distance: %.4f mm rms, %.4f at most; several: %.4f, %.4f\n%s", map->rms_mm, map->worst_mm,
              whole->rms_mm, whole->worst_mm, all_words(*map).c_str());
  EXPECT_GT(map->worst_mm, whole->worst_mm);
  // Tilts of 15 to 35 degrees determine f; what is left open is what the boards never reached: the projector's distortion
  // at the end of the depth.
  ASSERT_TRUE(map->combinations.front().open);
  EXPECT_NEAR(std::abs(map->combinations.front().worst_at_mm.z()), heights_of(*poor, {}).second, 1e-9);
  EXPECT_TRUE(names(*map, "projector.k1") && names(*map, "projector.k2"));
}

TEST(CrossValidation, HalvesOfGoodViewsAgreeWithinWhatTheyAllow) {
  constexpr int kRepeats = 20;
  double squares = 0, variance = 0, below = 0;
  int disagree = 0;
  for (int seed = 1; seed <= kRepeats; ++seed) {
    const auto whole = calibrated(
        test::views(test::known_scanner(), test::known_board(), 12, {.seed = static_cast<std::uint64_t>(seed)}));
    ASSERT_TRUE(whole) << whole.error().sentence;
    const auto halves = calib::solve_halves(*whole);
    ASSERT_TRUE(halves) << halves.error().sentence;
    const auto compared = compare_scanners(halves->first, halves->second);
    ASSERT_TRUE(compared) << compared.error().sentence;
    squares += compared->ratio * compared->ratio / kRepeats;
    variance += 2 / compared->ways / kRepeats;
    const boost::math::chi_squared chi2(compared->ways);
    below += boost::math::cdf(chi2, compared->ways * compared->ratio * compared->ratio) / kRepeats;
    disagree += compared->ratio > compared->limit;
  }
  std::printf("halves: squared ratio %.3f, variance %.3f, probability %.3f, %d of %d disagree\n", squares, variance,
              below, disagree, kRepeats);
  // Mean and probability (even over 0 .. 1, standard deviation 0.29) within three of their chances.
  EXPECT_NEAR(squares, 1, 3 * std::sqrt(variance / kRepeats));
  EXPECT_NEAR(below, 0.5, 3 * 0.289 / std::sqrt(kRepeats));
  // One in a hundred is expected; three or more of 20 have a chance of 0.001.
  EXPECT_LE(disagree, 2);
}

TEST(CrossValidation, ResidualsOfGoodViewsAreNoiseAndOthersAreSaidWhere) {
  const auto white = residual_whiteness(good());
  ASSERT_TRUE(white) << white.error().sentence;
  for (const auto& w : *white) EXPECT_TRUE(w.white()) << words_of(w);
  // Every other column of the board off to one side, the others to the other: over the board, the model lacks something.
  model::Scanner bent = good();
  for (auto& o : bent.observations) {
    for (auto& c : o.corners) {
      c.pixel.x() += c.column % 2 == 0 ? 0.025 : -0.025;
    }
  }
  const auto judged = residual_whiteness(bent);
  ASSERT_TRUE(judged);
  EXPECT_TRUE((*judged)[0].white()) << words_of((*judged)[0]);
  EXPECT_FALSE((*judged)[2].white()) << words_of((*judged)[2]);
  // 0.025 px rms, of which the pose's q sees the mean alone: 5 columns against 4, 0.003 px.
  EXPECT_NEAR((*judged)[2].common_px, 0.025, 0.005);
}

/// Five poses, the proposed sixth added and everything solved again: how the worst point's u was, is forecast to be, is.
struct Forecast {
  double before_mm, forecast_mm, after_mm;
};

Forecast forecast(std::uint64_t seed) {
  const model::Scanner truth = test::known_scanner();
  auto views = test::views(truth, test::known_board(), 5, {.seed = seed});
  const model::Scanner before = calibrated(views).value();
  const auto by = derivatives(before, samples_of(before, {})).value();
  const auto next = calib::propose_next_pose(before, by, heights_of(before, {})).value();
  const auto& best = next.best.front();
  // The same pose in the true scanner's cam.
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(best.about_x_deg * 3.14159265 / 180, Eigen::Vector3d::UnitX()) *
                                Eigen::AngleAxisd(best.about_y_deg * 3.14159265 / 180, Eigen::Vector3d::UnitY()));
  const Eigen::Vector3d middle = 0.5 * test::known_board().corner_mm(8, 6);
  const Eigen::Vector3d at = before.world_from_cam().inverse() * best.middle_in_world_mm;
  const auto more = test::view_at(truth, test::known_board(), {turn, at - turn * middle}, {.seed = 100 + seed});
  EXPECT_GE(more.corners.size(), 32u);
  views.push_back(more);
  const model::Scanner after = calibrated(views).value();
  return {next.worst_now_mm, best.worst_mm, uncertainty_map(after, {.section_steps = 0}).value().worst_mm};
}

TEST(NextPose, LowersTheWorstUncertaintyByAboutWhatItSays) {
  // The captures' phase offset is estimated anew, from six values, and knows its standard deviation to 1 / sqrt(2 * 5): so
  // does what is found. The scales of the readings (some 5 %) add nothing to that.
  const double scatter = 1 / std::sqrt(10.0);
  constexpr int kForecasts = 6;
  double sum = 0;
  for (std::uint64_t seed = 1; seed <= kForecasts; ++seed) {
    const auto f = forecast(seed);
    std::printf("from %.4f to %.4f mm, found %.4f mm\n", f.before_mm, f.forecast_mm, f.after_mm);
    EXPECT_LT(f.forecast_mm, f.before_mm);
    EXPECT_LT(f.after_mm, f.before_mm);
    const double off = std::log(f.after_mm / f.forecast_mm);
    EXPECT_NEAR(off, 0, 3 * scatter) << "seed " << seed;
    sum += off;
  }
  EXPECT_NEAR(sum / kForecasts, 0, 3 * scatter / std::sqrt(kForecasts));
}

TEST(UncertaintyPage, ShowsSectionsAndWords) {
  const auto map = uncertainty_map(good(), {.section_steps = 15});
  ASSERT_TRUE(map);
  const std::string html = reports::uncertainty_page({"test", *map, *residual_whiteness(good()), {}, good().priors});
  EXPECT_THAT(html, HasSubstr("section Z"));
  EXPECT_THAT(html, HasSubstr("Phase noise"));
  EXPECT_THAT(html, HasSubstr("residuals over the image"));
}

}  // namespace
}  // namespace fringecal::metrology

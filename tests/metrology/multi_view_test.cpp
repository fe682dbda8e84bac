// Sphere plates, steps and registered views, evaluated on clouds that the scanner's model makes of ideal artefacts.
#include "metrology/multi_view.h"

#include "metrology/calibration_uncertainty.h"
#include "metrology/feature.h"
#include "metrology/match_centres.h"
#include "metrology/prediction.h"
#include "metrology/step.h"
#include "tests/metrology/exact_phase_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <random>

namespace fringecal::metrology {
namespace {

using ::testing::HasSubstr;

/// The sample scanner with three times as many pixels along each side: 0.47 mm on R, a reference sphere has 800 of them.
model::Scanner scanner() {
  auto s = test::sample_scanner();
  s.camera.width_px = 960;
  s.camera.height_px = 720;
  for (double* p : {&s.camera.fx_px, &s.camera.fy_px, &s.camera.cx_px, &s.camera.cy_px}) *p *= 3;
  s.uncertainty = {{"camera.cx_px"}, Eigen::MatrixXd::Constant(1, 1, 0.01)};
  return s;
}

Gauge plate() {
  Gauge g{
      .name = "plate", .kind = GaugeKind::sphere_plate, .diameter_mm = {25, 25, 25, 25, 25}, .U_diameter_mm = 0.001};
  g.U_distance_mm = 0.0015;
  g.centres_mm = {{-60, -45, 0}, {55, -50, 4}, {62, 40, 0}, {-48, 52, 8}, {8, -4, 0}};
  return g;
}

Gauge step() {
  Gauge g{.name = "step", .kind = GaugeKind::step};
  g.distance_mm = 20;
  g.U_distance_mm = 0.0008;
  return g;
}

Gauge bar() {
  Gauge g{.name = "bar150", .kind = GaugeKind::ball_bar, .diameter_mm = {30, 30}, .U_diameter_mm = 0.001};
  g.distance_mm = 150;
  g.U_distance_mm = 0.0015;
  return g;
}

Plan plan_of(const std::string& artefact, std::vector<PlannedQuantity> quantities) {
  Plan plan{.name = "test"};
  plan.series = {{.scene = "scene", .artefacts = {artefact}, .captures = 1}};
  plan.series[0].quantities = std::move(quantities);
  plan.series[0].places = {{5, -3, 10, 0, 10, 40}};
  return plan;
}

// Ten distances of five spheres, each within four standard uncertainties of its noise from what stands there (one in 16 000
// misses), and each sphere where its number is: the plate's own places are 70 mm and more apart.
TEST(SpherePlate, IsFoundInTheOrderOfItsCertificate) {
  const auto plan = plan_of("plate", {{Measurand::distance_error, "SD", "distance", Limits{-0.05, 0.05}}});
  const auto& series = plan.series[0];
  const auto cloud = predicted_cloud(series, 0, {plate()}, scanner(), {});
  ASSERT_TRUE(cloud) << cloud.error().sentence;
  const auto result = evaluate_capture(plan, series, 0, {plate()}, *cloud, scanner());
  ASSERT_TRUE(result) << result.error().sentence;
  ASSERT_EQ(result->features.size(), 5u);
  ASSERT_EQ(result->distances.size(), 10u);
  const auto certified = distances_of(plate());
  for (std::size_t k = 0; k < 10; ++k) {
    const auto& d = result->distances[k];
    EXPECT_NEAR(d.distance_mm, certified[k].value_mm, 4 * d.u_noise_mm) << certified[k].name;
    EXPECT_EQ(d.from, certified[k].from);
    EXPECT_EQ(d.to, certified[k].to);
    EXPECT_GT(d.u_calibration_mm, 0);
  }
  const auto quantities = evaluate_series(plan, series, {plate()}, {*result}, {.monte_carlo_trials = 0});
  ASSERT_EQ(quantities.size(), 10u);
  EXPECT_EQ(quantities[5].position, "1, 2-4");
  EXPECT_NEAR(quantities[5].uncertainty.u, 0.00075, 1e-12);  // at 20 degC the certificate alone
  EXPECT_EQ(capture_result_from(to_value(*result), "it").distances[5].to, 3);
}

TEST(SpherePlate, IsRefusedWhereItsSpheresStandOtherwise) {
  std::vector<Eigen::Vector3d> centres = plate().centres_mm;
  std::vector<Eigen::Vector3d> mixed = {centres[3], centres[0], centres[4], centres[2], centres[1]};
  const auto order = match_centres(mixed, centres);
  ASSERT_TRUE(order) << order.error().sentence;
  EXPECT_EQ(*order, (std::vector<std::size_t>{1, 4, 3, 0, 2}));
  mixed[2].x() += 0.8;
  EXPECT_THAT(match_centres(mixed, centres).error().sentence,
              HasSubstr("no 5 of its 5 spheres stand as the certificate"));
}

TEST(Step, IsMeasuredBetweenItsPlanes) {
  const auto plan = plan_of("step", {{Measurand::distance_error, "H", "height", Limits{-0.05, 0.05}},
                                     {Measurand::form_95, "P95", "form", {}}});
  const auto& series = plan.series[0];
  const auto cloud = predicted_cloud(series, 0, {step()}, scanner(), {});
  ASSERT_TRUE(cloud) << cloud.error().sentence;
  const auto result = evaluate_capture(plan, series, 0, {step()}, *cloud, scanner());
  ASSERT_TRUE(result) << result.error().sentence;
  ASSERT_EQ(result->distances.size(), 1u);
  EXPECT_NEAR(result->distances[0].distance_mm, 20, 4 * result->distances[0].u_noise_mm);
  EXPECT_LT(result->distances[0].u_noise_mm, 0.003);  // some 10 000 points of 0.05 mm a plane
  EXPECT_LT(result->features[0].place_mm.z(), result->features[1].place_mm.z()) << "the lower plane is the first part";
  const auto quantities = evaluate_series(plan, series, {step()}, {*result}, {.monte_carlo_trials = 0});
  ASSERT_EQ(quantities.size(), 3u);
  EXPECT_EQ(quantities[1].position, "1, lower plane");
}

// u of eq. 3 against the scatter of 400 draws, known to 3.5 %: three of these.
TEST(Step, StatesTheScatterThatRepeatsHave) {
  std::mt19937_64 generator(1);
  std::normal_distribution<double> normal;
  double sum = 0, squares = 0, u = 0;
  constexpr int kDraws = 400;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<Eigen::Vector3d> lower, upper;
    for (int x = -10; x <= 10; ++x) {
      for (int y = -10; y <= 10; ++y) {
        lower.emplace_back(3.0 * x - 30, 4.0 * y, 0.03 * normal(generator));
        upper.emplace_back(3.0 * x + 30, 4.0 * y, 20 + 0.03 * normal(generator));
      }
    }
    const auto fit = fit_step(lower, upper);
    ASSERT_TRUE(fit) << fit.error().sentence;
    sum += fit->height_mm - 20;
    squares += (fit->height_mm - 20) * (fit->height_mm - 20);
    u += fit->u_noise_mm / kDraws;
  }
  EXPECT_NEAR(std::sqrt(squares / kDraws) / u, 1, 3 * 0.035);
  EXPECT_NEAR(sum / kDraws, 0, 4 * u / std::sqrt(static_cast<double>(kDraws)));
  std::vector<Eigen::Vector3d> flat, tilted;
  for (int k = 0; k < 100; ++k) {
    flat.emplace_back(k % 10, k / 10, 0);
    tilted.emplace_back(k % 10, k / 10, 20 + 0.05 * (k % 10));
  }
  EXPECT_THAT(fit_step(flat, tilted).error().sentence, HasSubstr("2.86 degrees"));
}

/// A bar on a carrier in three views.
Plan turned_bar() {
  Plan plan = read_plan("vdi2634-3");
  plan.series.erase(plan.series.begin());
  plan.series[0].captures = 1;
  plan.series[0].places.resize(1);
  return plan;
}

// A reference's centre is known to some 3 um (0.05 mm of noise, 800 points of a cap), a view's motion from eight of them to 2 um
// beside the bar's spheres; these are themselves known to 2 um from three views: 0.010 mm is three times all of it.
TEST(MultiView, JoinsTheViewsByTheirReferences) {
  const auto plan = turned_bar();
  const auto& series = plan.series[0];
  const auto clouds = predicted_views(series, 0, {bar()}, scanner(), {});
  ASSERT_TRUE(clouds) << clouds.error().sentence;
  ASSERT_EQ(clouds->size(), 3u);
  const auto result = evaluate_views(plan, series, 0, {bar()}, *clouds, scanner());
  ASSERT_TRUE(result) << result.error().sentence;
  ASSERT_TRUE(result->joined);
  EXPECT_EQ(result->joined->views, 3);
  EXPECT_EQ(result->joined->references, 8);
  EXPECT_LT(result->joined->rms_mm, 0.010);
  ASSERT_EQ(result->distances.size(), 1u);
  EXPECT_NEAR(result->distances[0].distance_mm, 150, 0.010);
  EXPECT_GT(result->distances[0].u_calibration_mm, 0);
  ASSERT_EQ(result->features.size(), 2u);
  for (const auto& f : result->features) EXPECT_NEAR(*f.diameter_mm, 30, 0.010);
  const auto single = evaluate_capture(plan, series, 0, {bar()}, clouds->front(), scanner());
  ASSERT_TRUE(single) << single.error().sentence;
  EXPECT_GT(result->features[0].n_points, 2 * single->features[0].n_points) << "all views' points count";
  const auto back = capture_result_from(to_value(*result), "it");
  EXPECT_EQ(back.joined->references, 8);
}

// A view that measures 0.1 % too long moves the bar's spheres apart by 0.15 mm in it. What of that the union shows depends on
// which side of the spheres that view has to itself: more than none, less than all; at least twice what noise alone may do (above).
// And the references, up to 140 mm from the middle, disagree by some 0.1 mm in that view.
TEST(MultiView, DoesNotHideAViewThatMeasuresTooLong) {
  const auto plan = turned_bar();
  const auto& series = plan.series[0];
  auto clouds = predicted_views(series, 0, {bar()}, scanner(), {});
  ASSERT_TRUE(clouds) << clouds.error().sentence;
  for (auto& p : (*clouds)[1].points) p.position_mm *= 1.001;
  const auto result = evaluate_views(plan, series, 0, {bar()}, *clouds, scanner());
  ASSERT_TRUE(result) << result.error().sentence;
  EXPECT_GT(result->distances[0].distance_mm, 150.02);
  EXPECT_LT(result->distances[0].distance_mm, 150.15);
  EXPECT_GT(result->joined->rms_mm, 0.03);
}

// One view after the other read o higher; what each adds to the bar's length, in one root sum of squares. Derivatives from thinned
// points (one in two to ten) and one-sided here: within 10 % of the sum, which stands among the noise of the points.
TEST(MultiView, CountsTheMeanPhaseErrorOfEachViewByItself) {
  const auto plan = turned_bar();
  const auto& series = plan.series[0];
  constexpr double kOffset = 1e-3;  // mm on the grating: large against the noise of the fits
  auto stated = scanner();
  stated.uncertainty = {{"projector.x.u0"}, Eigen::MatrixXd::Constant(1, 1, 1e-6)};
  auto with_prior = stated;
  with_prior.priors.push_back({"capture.phase_offset", 0.0, kOffset, "estimated from the views"});
  const auto clouds = predicted_views(series, 0, {bar()}, stated, {});
  ASSERT_TRUE(clouds) << clouds.error().sentence;
  const auto evaluated = [&](const std::vector<PointCloud>& views, const model::Scanner& s) {
    return evaluate_views(plan, series, 0, {bar()}, views, s).value().distances[0];
  };
  const auto without = evaluated(*clouds, stated), with = evaluated(*clouds, with_prior);
  const auto shifted = stated.changed_by(Eigen::VectorXd::Constant(1, kOffset));
  double squares = 0, together = 0;
  for (std::size_t v = 0; v < clouds->size(); ++v) {
    auto moved = *clouds;
    for (auto& p : moved[v].points) {
      const std::vector<Eigen::Vector3d> there = retriangulate(std::span(&p.position_mm, 1), stated, shifted);
      ASSERT_EQ(there.size(), 1u);
      p.position_mm = there.front();
    }
    const double change = evaluated(moved, stated).distance_mm - without.distance_mm;
    squares += change * change;
    together += change;
  }
  const double u = std::sqrt(with.u_noise_mm * with.u_noise_mm - without.u_noise_mm * without.u_noise_mm);
  EXPECT_NEAR(u, std::sqrt(squares), 0.1 * std::sqrt(squares));
  EXPECT_GT(std::abs(std::abs(together) - u), 0.1 * u) << "as one error of all views it would be another figure";
}

TEST(MultiView, SaysWhatItCannotJoin) {
  auto plan = turned_bar();
  auto& series = plan.series[0];
  auto clouds = predicted_views(series, 0, {bar()}, scanner(), {});
  ASSERT_TRUE(clouds) << clouds.error().sentence;
  EXPECT_THAT(evaluate_views(plan, series, 0, {[] {
                               Gauge g = step();
                               g.name = "bar150";
                               return g;
                             }()},
                             *clouds, scanner())
                  .error()
                  .sentence,
              HasSubstr("not for a step"));
  std::erase_if((*clouds)[2].points, [](const CloudPoint& p) { return p.position_mm.x() > -100; });
  EXPECT_THAT(evaluate_views(plan, series, 0, {bar()}, *clouds, scanner()).error().sentence,
              HasSubstr("turned_bar-00-2"));
  series.views->reference_diameter_mm = 29;
  EXPECT_THAT(evaluate_views(plan, series, 0, {bar()}, *clouds, scanner()).error().sentence,
              HasSubstr("nearly the same diameter"));
}

}  // namespace
}  // namespace fringecal::metrology

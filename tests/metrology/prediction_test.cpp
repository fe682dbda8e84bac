// What a plan will know, before any capture.
#include "metrology/prediction.h"
#include "tests/metrology/exact_phase_map.h"

#include <gtest/gtest.h>

#include <cmath>

namespace fringecal::metrology {
namespace {

/// The sample scanner with 2.5 times as many pixels along each side: 0.56 mm on R.
model::Scanner scanner() {
  auto s = test::sample_scanner();
  s.camera.width_px = 800;
  s.camera.height_px = 600;
  for (double* p : {&s.camera.fx_px, &s.camera.fy_px, &s.camera.cx_px, &s.camera.cy_px}) *p *= 2.5;
  s.uncertainty = {{"camera.cx_px"}, Eigen::MatrixXd::Constant(1, 1, 0.01)};
  return s;
}

Gauge sphere50() {
  Gauge g{.name = "sphere50", .kind = GaugeKind::sphere, .diameter_mm = {50}, .U_diameter_mm = 0.001};
  return g;
}

Plan plan_at(std::vector<std::array<double, 6>> places) {
  Plan plan{.name = "test"};
  plan.series = {{.scene = "probing", .artefacts = {"sphere50"}, .captures = static_cast<int>(places.size())}};
  plan.series[0].quantities = {{Measurand::diameter_error, "PS", "size", Limits{-0.05, 0.05}}};
  plan.series[0].places = std::move(places);
  return plan;
}

// The predicted noise is the scatter that repeats then have: of 12, a standard deviation is known to 21 %; three of these.
TEST(Prediction, StatesTheScatterThatRepeatsHave) {
  auto plan = plan_at({{20, 10, 5, 0, 0, 0}});
  auto& series = plan.series[0];
  series.captures = 12;
  series.repeats = true;
  std::vector<double> diameters;
  double u = 0;
  for (int i = 0; i < series.captures; ++i) {
    const auto cloud = predicted_cloud(series, i, {sphere50()}, scanner(), {});
    ASSERT_TRUE(cloud) << cloud.error().sentence;
    const auto result = evaluate_capture(plan, series, i, {sphere50()}, *cloud, scanner());
    ASSERT_TRUE(result) << result.error().sentence;
    diameters.push_back(*result->features[0].diameter_mm);
    u += *result->features[0].u_noise_mm / series.captures;
  }
  double mean = 0, squares = 0;
  for (const double d : diameters) mean += d / 12;
  for (const double d : diameters) squares += (d - mean) * (d - mean);
  EXPECT_NEAR(std::sqrt(squares / 11) / u, 1, 3 * 0.21);
  EXPECT_NEAR(mean, 50, 4 * u / std::sqrt(12.0));
}

TEST(Prediction, HasEveryQuantityOfThePlanWithItsBudget) {
  const auto predicted = predict(plan_at({{0, 0, 0, 0, 0, 0}, {60, 30, 40, 0, 0, 0}}), {sphere50()}, scanner());
  ASSERT_TRUE(predicted) << predicted.error().sentence;
  ASSERT_EQ(predicted->size(), 1u);
  EXPECT_TRUE((*predicted)[0].problems.empty());
  ASSERT_EQ((*predicted)[0].quantities.size(), 2u);
  for (const auto& q : (*predicted)[0].quantities) {
    EXPECT_NEAR(q.uncertainty.u, 0.0005, 1e-12);  // a test value of one capture: the certificate alone at 20 degC
    ASSERT_TRUE(q.u_of_later_measurements);
    EXPECT_GT(*q.u_of_later_measurements, 0.0005);
  }
}

TEST(Prediction, NamesACaptureThatCannotBeEvaluated) {
  const auto predicted = predict(plan_at({{0, 0, 0, 0, 0, 0}, {900, 0, 0, 0, 0, 0}}), {sphere50()}, scanner());
  ASSERT_TRUE(predicted);
  ASSERT_EQ((*predicted)[0].problems.size(), 1u);
  EXPECT_NE((*predicted)[0].problems[0].find("probing-01: sphere50"), std::string::npos) << (*predicted)[0].problems[0];
  EXPECT_EQ((*predicted)[0].quantities.size(), 1u);
  const auto without = predict(plan_at({}), {sphere50()}, scanner());
  EXPECT_TRUE(without && (*without)[0].quantities.empty());  // no captures either
  auto plan = plan_at({});
  plan.series[0].captures = 1;
  EXPECT_NE(predict(plan, {sphere50()}, scanner()).error().sentence.find("no places"), std::string::npos);
}

TEST(Prediction, DrawsWhatTheShippedPlansPlace) {
  const auto plan = read_plan("vdi2634-2");
  for (const auto& series : plan.series) {
    EXPECT_EQ(series.places.size(), static_cast<std::size_t>(series.positions())) << series.scene;
  }
  Gauge bar{.name = "bar150", .kind = GaugeKind::ball_bar, .diameter_mm = {30, 30}, .distance_mm = 150};
  const auto lines =
      outlines_of(plan.series[1], 5, {bar});  // its second position: along Y, as it is turned by 90 degrees
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_NEAR((lines[2][1] - lines[2][0]).y(), 150, 1e-9);
  const auto fields = fields_of(plan, scanner());
  ASSERT_EQ(fields.camera.size(), 3u);
  ASSERT_EQ(fields.code[1].size(), 4u);
  // The code covers 64 x 0.24 mm on the glass, 32 mm from the pupil: 480 mm on R, distortion of some 1 % aside.
  EXPECT_NEAR(fields.code[1][1].x() - fields.code[1][0].x(), 480, 15);
}

}  // namespace
}  // namespace fringecal::metrology

// Plans, certificates and the arithmetic of a verification, without pictures: from results to judged quantities.
#include "metrology/acceptance.h"
#include "core/error.h"
#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fringecal::metrology {
namespace {

using test::message_of;
using test::TemporaryFolder;

Gauge sphere30() {
  Gauge g{.name = "sphere30", .kind = GaugeKind::sphere, .diameter_mm = {30.001}, .U_diameter_mm = 0.001};
  g.form_mm = 0.0004;
  g.U_form_mm = 0.0002;
  g.expansion_per_K = 5.5e-6;
  g.u_expansion_per_K = 0.5e-6;
  g.certificate = "K-1";
  g.laboratory = "D-K-00000";
  g.date = "2026-01-01";
  g.valid_until = "2028-01-01";
  return g;
}

Gauge bar150() {
  Gauge g = sphere30();
  g.name = "bar150";
  g.kind = GaugeKind::ball_bar;
  g.diameter_mm = {30.0, 30.0};
  g.distance_mm = 150.01;
  g.U_distance_mm = 0.0015;
  return g;
}

Gauge plate3() {
  Gauge g = sphere30();
  g.name = "plate3";
  g.kind = GaugeKind::sphere_plate;
  g.diameter_mm = {25.001, 25.002, 24.9994};
  g.centres_mm = {{0, 0, 0}, {100.0021, 0, 0.01}, {30.5, 70.25, 0}};
  g.U_distance_mm = 0.0015;
  return g;
}

Gauge step20() {
  Gauge g = sphere30();
  g.name = "step20";
  g.kind = GaugeKind::step;
  g.diameter_mm = {};
  g.U_diameter_mm = 0;
  g.distance_mm = 20.0013;
  g.U_distance_mm = 0.0008;
  return g;
}

TEST(Gauges, SurviveTheWayThroughTheirFile) {
  const TemporaryFolder folder;
  const std::vector<Gauge> all = {sphere30(), bar150(), plate3(), step20()};
  const auto file = folder.write("artefacts.toml", to_toml(all));
  const auto read = read_gauges(file);
  ASSERT_EQ(read.size(), 4u);
  EXPECT_EQ(to_json(to_value(read)), to_json(to_value(all)));
  EXPECT_NE(to_toml(all).find("height_mm = 20.0013\n"), std::string::npos) << "as the certificate has it";
}

TEST(Gauges, OfSeveralPartsSayWhatLiesBetweenThem) {
  EXPECT_EQ(distances_of(sphere30()).size(), 0u);
  EXPECT_EQ(distances_of(step20()).front().name, "height");
  const auto distances = distances_of(plate3());
  ASSERT_EQ(distances.size(), 3u);
  EXPECT_EQ(distances[1].name, "distance 1-3");
  EXPECT_NEAR(distances[1].value_mm, std::hypot(30.5, 70.25), 1e-12);
  EXPECT_EQ(used(plate3(), false).values.size(), 7u);  // three diameters, three distances, the form
  const TemporaryFolder folder;
  std::string text = to_toml({plate3()});
  text.replace(text.find("centres_mm"), 10, "centers_mm");
  const auto said = message_of<InputError>([&] { read_gauges(folder.write("a.toml", text)); });
  EXPECT_NE(said.find("centres_mm is a list of 3 to 12 centres"), std::string::npos) << said;
}

TEST(Gauges, AreRefusedWithFileKeyAndReason) {
  const TemporaryFolder folder;
  std::string text = to_toml({sphere30()});
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    return message_of<InputError>([&] { read_gauges(folder.write("a.toml", changed)); });
  };
  EXPECT_NE(with("diameter_mm = 30.001", "diameter_mm = -3").find("diameter_mm is -3"), std::string::npos);
  EXPECT_NE(with("\"sphere\"", "\"ball\"").find("known: sphere, ball_bar, sphere_plate, flat, cylinder, step"),
            std::string::npos);
  EXPECT_NE(with("2028-01-01", "2025-01-01").find("valid_until is before date"), std::string::npos);
  EXPECT_NE(with("laboratory", "labratory").find("a.toml"), std::string::npos);
}

TEST(Gauges, ExpireAfterTheirLastDay) {
  EXPECT_FALSE(is_expired(sphere30(), "2028-01-01T23:59:59Z"));
  EXPECT_TRUE(is_expired(sphere30(), "2028-01-02T00:00:00Z"));
}

// artefact_file.h eq. 1 and 2 by hand, at 25 degC +- 0.2 K: l = 30.001 (1 + 5.5e-6 x 5) = 30.001825...;
// u = sqrt(0.0005^2 + (30.001 x 5 x 0.5e-6)^2 + (30.001 x 5.5e-6 x 0.2)^2 + (30.001 x 0.5e-6 x 0.2)^2) = 0.0005066.
TEST(Gauges, GiveALengthAtTemperatureWithItsUncertainty) {
  const Environment warm{25, 0.2, {}};
  EXPECT_NEAR(length_at(sphere30(), 30.001, warm), 30.001 + 30.001 * 5.5e-6 * 5, 1e-12);
  const auto combined = combine(contributions_of(sphere30(), 30.001, 0.001, warm));
  const double u = std::sqrt(std::pow(0.0005, 2) + std::pow(30.001 * 5 * 0.5e-6, 2) +
                             std::pow(30.001 * 5.5e-6 * 0.2, 2) + std::pow(30.001 * 0.5e-6 * 0.2, 2));
  EXPECT_NEAR(combined.u, u, 1e-12);
  Gauge held = sphere30();
  held.fixture_mm = 0.0003;
  EXPECT_NEAR(combine(contributions_of(held, 30.001, 0.001, warm)).u, std::hypot(u, 0.0003), 1e-12);
}

TEST(Plans, ShippedOnesAreReadAndNameTheirSource) {
  for (const auto& name : shipped_plans()) {
    const auto plan = read_plan(name);
    EXPECT_EQ(plan.name, name);
    EXPECT_FALSE(plan.source.empty()) << name;
    EXPECT_FALSE(plan.series.empty()) << name;
  }
  const auto bars = read_plan("vdi2634-2").series[1];
  EXPECT_EQ(bars.positions(), 7);
  EXPECT_EQ(bars.captures, 35);
  EXPECT_EQ(capture_name(bars, 34), "ball_bar-06e");
  EXPECT_EQ(bars.places_of(21), (std::vector{bars.places[4]}));
}

TEST(Plans, AreRefusedWithTheNamesThatThereAre) {
  EXPECT_NE(message_of<InputError>([] { read_plan("vdi"); }).find("vdi2634-2"), std::string::npos);
  const TemporaryFolder folder;
  std::string text = plan_text("quick");
  text.replace(text.find("distance_error"), 14, "length_error");
  EXPECT_NE(message_of<InputError>([&] { read_plan(folder.write("p.toml", text)); }).find("known: diameter_error"),
            std::string::npos);
}

TEST(Plans, WithSeveralCapturesOfAPositionAreChecked) {
  const TemporaryFolder folder;
  const auto refusal = [&](const std::string& from, const std::string& to) {
    std::string text = plan_text("vdi2634-2");
    text.replace(text.find(from), from.size(), to);
    return message_of<InputError>([&] { read_plan(folder.write("p.toml", text)); });
  };
  EXPECT_NE(refusal("captures = 35", "captures = 34").find("not a multiple"), std::string::npos);
  EXPECT_NE(refusal("captures_per_position = 5", "captures_per_position = 0").find("give 1 to 26"), std::string::npos);
  EXPECT_NE(refusal("captures_per_position = 5", "captures_per_position = 7").find("7 entries where 5"),
            std::string::npos);
  EXPECT_NE(refusal("captures_per_position = 5", "captures_per_position = 5\nrepeats = true").find("leave"),
            std::string::npos);
}

CaptureResult capture_of(int capture, double diameter) {
  FeatureResult f{.artefact = "sphere30", .diameter_mm = diameter, .u_noise_mm = 0.001, .u_calibration_mm = 0.002};
  f.range_mm = 0.17;
  f.shell_95_mm = 0.11;
  f.sd_mm = 0.028 + 0.001 * capture;
  f.n_points = 4000;
  return {capture, {f}, {}};
}

TEST(CaptureResult, SurvivesTheWayThroughItsFile) {
  const auto result = capture_of(3, 30.002);
  const auto again = capture_result_from(parse_json(to_json(to_value(result)), "x"), "x");
  EXPECT_EQ(to_json(to_value(again)), to_json(to_value(result)));
}

Plan plan_with(Measurand measurand) {
  Plan plan{.name = "test"};
  plan.series = {{.scene = "probing", .artefacts = {"sphere30"}, .captures = 4}};
  plan.series[0].quantities = {{measurand, "S", "name", Limits{-0.05, 0.05}}};
  return plan;
}

// Mean of 30.000, 30.002, 30.004, 30.006 is 30.003, s = 0.002582; error +0.002; u^2 = s^2 / 4 + 0.0005^2 (20 degC, no
// u(t)); nu_eff = u^4 / ((s^2 / 4)^2 / 3).
TEST(EvaluateSeries, GivesTheMeanWithItsBudget) {
  const auto plan = plan_with(Measurand::mean_diameter_error);
  std::vector<CaptureResult> results;
  for (int i = 0; i < 4; ++i) results.push_back(capture_of(i, 30.0 + 0.002 * i));
  const auto quantities = evaluate_series(plan, plan.series[0], {sphere30()}, results, {.environment = {20, 0, {}}});
  ASSERT_EQ(quantities.size(), 1u);
  const auto& q = quantities[0];
  const double s2_mean = (9 + 1 + 1 + 9) * 1e-6 / 3 / 4, u2 = s2_mean + 0.25e-6;
  EXPECT_NEAR(q.value, 0.002, 1e-12);
  EXPECT_NEAR(q.uncertainty.u, std::sqrt(u2), 1e-12);
  EXPECT_EQ(q.uncertainty.nu, std::floor(u2 * u2 / (s2_mean * s2_mean / 3)));
  EXPECT_EQ(q.position, "mean of 4");
  ASSERT_TRUE(q.judgement);
  EXPECT_EQ(q.judgement->verdict, Verdict::pass);
  // Of a later single measurement: the reference, the repeatability and the calibration.
  EXPECT_NEAR(*q.u_of_later_measurements, std::sqrt(0.25e-6 + 4 * s2_mean + 4e-6), 1e-12);
}

TEST(EvaluateSeries, GivesOneRowForEachPosition) {
  const auto plan = plan_with(Measurand::diameter_error);
  const auto quantities = evaluate_series(plan, plan.series[0], {sphere30()},
                                          {capture_of(1, 30.1), capture_of(0, 30.001)}, {.environment = {20, 0, {}}});
  ASSERT_EQ(quantities.size(), 2u);
  EXPECT_EQ(quantities[0].position, "1");
  EXPECT_NEAR(quantities[0].value, 0, 1e-12);
  EXPECT_EQ(quantities[1].judgement->verdict, Verdict::fail);
  // A test value holds the reference's uncertainty, not the scanner's own noise.
  EXPECT_NEAR(quantities[0].uncertainty.u, 0.0005, 1e-12);
}

// Errors -0.003, 0, +0.003 at three places: s = 0.003; the captures' own noise is 0.001 each, so sqrt(8) 0.001 is left for
// the places. As repeats at one place the whole scatter is repeatability.
TEST(GaugeSummary, SeparatesRepeatabilityFromThePlaces) {
  auto plan = plan_with(Measurand::diameter_error);
  const std::vector<CaptureResult> results = {capture_of(0, 29.998), capture_of(1, 30.001), capture_of(2, 30.004)};
  const auto places = summaries_of(plan.series[0], {sphere30()}, results, {20, 0, {}});
  ASSERT_EQ(places.size(), 1u);
  EXPECT_NEAR(places[0].mean_mm, 0, 1e-12);
  EXPECT_NEAR(places[0].repeatability_mm, 0.001, 1e-12);
  EXPECT_NEAR(places[0].reproducibility_mm, std::sqrt(8.0) * 0.001, 1e-12);
  plan.series[0].repeats = true;
  const auto repeats = summaries_of(plan.series[0], {sphere30()}, results, {20, 0, {}});
  EXPECT_NEAR(repeats[0].repeatability_mm, 0.003, 1e-12);
  EXPECT_EQ(repeats[0].reproducibility_mm, 0);
}

Plan plan_of_two_captures_at_two_positions() {
  Plan plan = plan_with(Measurand::diameter_error);
  plan.series[0].captures = 4;
  plan.series[0].captures_per_position = 2;
  return plan;
}

// Two positions of two captures: within them +-0.001 about the mean, s^2 = 4 (0.001)^2 / (4 - 2); the means are -0.002 and
// +0.004 off 30.001, their variance 0.000018, of which half of s^2 is repeatability.
TEST(GaugeSummary, TakesRepeatabilityFromTheCapturesOfAPosition) {
  const Plan plan = plan_of_two_captures_at_two_positions();
  const std::vector<CaptureResult> results = {capture_of(0, 29.998), capture_of(1, 30.000), capture_of(2, 30.004),
                                              capture_of(3, 30.006)};
  const auto summary = summaries_of(plan.series[0], {sphere30()}, results, {20, 0, {}}).front();
  EXPECT_EQ(summary.captures, 4);
  EXPECT_NEAR(summary.mean_mm, 0.001, 1e-12);
  EXPECT_NEAR(summary.repeatability_mm, std::sqrt(2.0) * 0.001, 1e-12);
  EXPECT_NEAR(summary.reproducibility_mm, std::sqrt(0.000018 - 0.000001), 1e-12);
}

// Noise 0.001 of each of two captures, 0.001 / sqrt(2) of their mean; the calibration's 0.002 and the certificate's 0.0005 are
// the same in both.
TEST(EvaluateSeries, AveragesTheCapturesOfAPositionAndOnlyWhatIsNewInEach) {
  Plan plan = plan_of_two_captures_at_two_positions();
  const std::vector<CaptureResult> results = {capture_of(3, 30.006), capture_of(1, 30.000), capture_of(2, 30.004),
                                              capture_of(0, 29.998)};
  const EvaluateOptions options{.environment = {20, 0, {}}};
  const auto quantities = evaluate_series(plan, plan.series[0], {sphere30()}, results, options);
  ASSERT_EQ(quantities.size(), 2u);
  EXPECT_EQ(quantities[0].position, "1, mean of 2");
  EXPECT_EQ(quantities[1].position, "2, mean of 2");
  EXPECT_NEAR(quantities[0].value, -0.002, 1e-12);
  EXPECT_NEAR(quantities[1].value, 0.004, 1e-12);
  EXPECT_EQ(quantities[0].n_points, 8000);
  EXPECT_NEAR(quantities[0].uncertainty.u, 0.0005, 1e-12) << "the scanner's noise is what is tested";
  EXPECT_NEAR(*quantities[0].u_of_later_measurements,
              std::sqrt(std::pow(0.0005, 2) + std::pow(0.001, 2) / 2 + std::pow(0.002, 2)), 1e-12);
  plan.series[0].quantities[0].measurand = Measurand::form_range;
  const auto forms = evaluate_series(plan, plan.series[0], {sphere30()}, results, options);
  ASSERT_EQ(forms.size(), 2u);
  EXPECT_EQ(forms[1].position, "2, largest of 2");
  EXPECT_NEAR(forms[1].value, 0.17, 1e-12);
}

TEST(EvaluateSeries, TakesTheLargestFormStandardDeviation) {
  const auto plan = plan_with(Measurand::form_sd);
  const auto quantities = evaluate_series(plan, plan.series[0], {sphere30()}, {capture_of(0, 30), capture_of(2, 30)},
                                          {.environment = {20, 0, {}}});
  ASSERT_EQ(quantities.size(), 1u);
  EXPECT_NEAR(quantities[0].value, 0.030, 1e-12);
  EXPECT_NEAR(quantities[0].uncertainty.u, std::hypot(0.0002, 0.0001), 1e-12);  // eq. 5
}

// Coverage: 1000 verifications drawn from the model. The scanner's systematic error at this place is the measurand; the
// readings scatter about it, the artefact's true diameter about its certificate, its temperature about the reading. 95.45 %
// of the intervals must hold the truth; standard error of 1000: 0.66 %, so 93 .. 97 % is three of them and more.
TEST(EvaluateSeries, StatesAnUncertaintyThatCoversTheTruth) {
  const auto plan = plan_with(Measurand::mean_diameter_error);
  std::mt19937 generator(11);
  const auto uniform = [&] { return (static_cast<double>(generator()) + 0.5) / 4294967296.0; };
  const auto normal = [&] { return std::sqrt(-2 * std::log(uniform())) * std::cos(2 * M_PI * uniform()); };
  constexpr int kRuns = 1000;
  constexpr double kNoise = 0.003, kUTemperature = 1.0, kError = -0.0042;
  int covered = 0;
  for (int run = 0; run < kRuns; ++run) {
    Gauge gauge = sphere30();
    const double true_diameter = gauge.diameter_mm[0] + 0.0005 * normal();
    const double true_alpha = gauge.expansion_per_K + gauge.u_expansion_per_K * normal();
    const Environment stated{24, kUTemperature, {}};
    const double true_t = stated.temperature_degC + kUTemperature * std::sqrt(3.0) * (2 * uniform() - 1);
    const double now = true_diameter * (1 + true_alpha * (true_t - 20));
    std::vector<CaptureResult> results;
    for (int i = 0; i < 5; ++i) results.push_back(capture_of(i, now + kError + kNoise * normal()));
    const auto q =
        evaluate_series(plan, plan.series[0], {gauge}, results, {.environment = stated, .monte_carlo_trials = 0})
            .front();
    if (std::abs(q.value - kError) <= q.uncertainty.U) ++covered;
  }
  EXPECT_GE(covered, 930);
  EXPECT_LE(covered, 970);
}

TEST(Verification, SurvivesTheWayThroughItsFileAndRefusesAnAlteredVerdict) {
  const auto plan = plan_with(Measurand::mean_diameter_error);
  Verification v{.plan = "test", .scanner = "S", .begun = "2026-11-22T00:00:00Z", .ended = "2026-11-22T00:10:00Z"};
  v.quantities = evaluate_series(plan, plan.series[0], {sphere30()}, {capture_of(0, 30), capture_of(1, 30.001)},
                                 {.environment = {20, 0.1, {}}});
  v.artefacts = {used(sphere30(), false)};
  v.summaries = summaries_of(plan.series[0], {sphere30()}, {capture_of(0, 30), capture_of(1, 30.001)}, v.environment);
  v.diagnosis = Diagnosis{.health = Health::degraded, .causes = {{"warm room", 0.9, 3, {{"warmer by", "K", 8, 0.5}}}}};
  v.provenance = {.program = "fringecal", .version = "0", .date = v.ended, .inputs = {{"scanner", "00"}}};
  const std::string text = to_json(to_value(v));
  EXPECT_EQ(to_json(to_value(verification_from(parse_json(text, "v"), "v"))), text);
  std::string altered = text;
  const auto at = altered.rfind("\"verdict\": \"pass\"");
  ASSERT_NE(at, std::string::npos);
  altered.replace(at, 17, "\"verdict\": \"fail\"");
  EXPECT_NE(message_of<InputError>([&] { verification_from(parse_json(altered, "v"), "v"); }).find("altered"),
            std::string::npos);
}

}  // namespace
}  // namespace fringecal::metrology

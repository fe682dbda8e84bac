// The alignment against frames made from the formulas of paper.md.
#include "calib/align.h"

#include "calib/align_jumps.h"
#include "core/error.h"
#include "tests/calib/alignment_frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::calib {
namespace {

using test::GratingCase;
using test::misaligned_capture;
using ::testing::HasSubstr;

Result<Misalignment> measure(const GratingCase& c) {
  return measure_misalignment(
      misaligned_capture(c), {.pattern_pitch_mm = c.pitch_mm, .gray_slots = c.gray_slots, .phase_slots = c.phase_slots},
      c.axis);
}

// Without placement errors what is left is noise: u_noise of a bit is below 0.06 um in these small frames and the
// shortest lever that decides is 36 mm, so 0.06 um / 36 mm = 1.7 urad for a single bit; three of that.
constexpr double kNoiseRad = 5e-6;

TEST(MeasureMisalignment, FindsSizeAndSignOfTheAngleOverItsRange) {
  for (const double theta : {-1.5e-3, -0.8e-3, -0.1e-3, 0.0, 0.02e-3, 0.5e-3, 1.5e-3}) {
    const auto result = measure({.theta_rad = theta});
    ASSERT_TRUE(result) << result.error().sentence;
    EXPECT_NEAR(result->theta_rad.value, theta, kNoiseRad);
    // Finest jumping bit of seven is bit 5: four pitches of 12 mm. [paper.md, conventions]
    EXPECT_NEAR(result->delta_mm.value, 4 * 12.0 * std::sin(theta), 48 * kNoiseRad);
    EXPECT_EQ(result->bits.front().bit, 5);
  }
}

TEST(MeasureMisalignment, GivesEachBitItsOwnDistanceAlongTheSlide) {
  const auto result = measure({.theta_rad = 1.5e-3});
  ASSERT_TRUE(result);
  for (const auto& bit : result->bits) {
    EXPECT_DOUBLE_EQ(bit.lever_mm, (7 + 2 - bit.bit) * 12.0);
    // Coarse bits are off by more than half a period here (0.675 p for bit 0). 0.0005 p: five times the largest
    // u_noise.
    EXPECT_NEAR(bit.fraction_of_period, (7 + 2 - bit.bit) * 12.0 * std::sin(1.5e-3) / 0.24, 5e-4) << bit.bit;
  }
}

TEST(MeasureMisalignment, WorksWithFiveToTenBitsAndBothKindsOfGrating) {
  for (int n = 5; n <= 10; ++n) {
    for (const int stripes : {1, 2}) {
      GratingCase c{.theta_rad = -1.2e-3, .gray_bits = n, .stripes_per_period = stripes, .lines = 40};
      if (n == 5 && stripes == 2) c.pixels_per_period = 60;  // 16 periods only: 12 of them fill the line
      const auto result = measure(c);
      ASSERT_TRUE(result) << n << " bits, " << stripes << ": " << result.error().sentence;
      EXPECT_NEAR(result->theta_rad.value, -1.2e-3, kNoiseRad) << n << " bits, " << stripes;
      EXPECT_EQ(result->bits.front().bit, stripes == 2 ? n - 2 : n - 1);
    }
  }
}

TEST(MeasureMisalignment, DoesNotDependOnTheDirectionOfUOrTheAxis) {
  for (const double direction : {1.0, -1.0}) {
    for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
      const auto result = measure({.theta_rad = 0.6e-3, .axis = axis, .direction = direction});
      ASSERT_TRUE(result) << result.error().sentence;
      EXPECT_NEAR(result->theta_rad.value, 0.6e-3, kNoiseRad);
    }
  }
}

TEST(MeasureMisalignment, TakesTheOrderOfThePatternsOnTheSlide) {
  const auto result = measure({.theta_rad = 0.8e-3, .gray_slots = {4, 5, 6, 7, 8, 9, 10}, .phase_slots = {0, 1, 2, 3}});
  ASSERT_TRUE(result) << result.error().sentence;
  EXPECT_NEAR(result->theta_rad.value, 0.8e-3, kNoiseRad);
  EXPECT_LT(result->delta_mm.value, 0.0);  // the Gray patterns now lie beyond the phase patterns
}

TEST(MeasureMisalignment, ServesThreeStepsAsWell) {
  const auto result = measure({.theta_rad = 0.8e-3, .phase_steps = 3});
  ASSERT_TRUE(result) << result.error().sentence;
  EXPECT_NEAR(result->theta_rad.value, 0.8e-3, kNoiseRad);
}

// Placement errors as drawn for 60 instruments: the normalised errors have standard deviation 1 within the scatter of
// an estimate from 60 values, 1/sqrt(2 * 59) = 0.092; three of that.
TEST(MeasureMisalignment, ReportsTheUncertaintyThatPlacementErrorsCause) {
  double sum = 0, sum_delta = 0;
  constexpr int kSeeds = 60;
  GratingLayout straight;  // the slide of these drawings is: nothing but independent places is drawn
  straight.pattern_pitch_mm = 12;
  straight.straightness_mm = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    GratingCase c{.theta_rad = 0.3e-3, .lines = 24, .placement_mm = {}, .seed = seed};
    std::mt19937_64 random(1000 + seed);
    std::normal_distribution<double> placement(0.0, 0.00036);
    for (int j = 0; j < 11; ++j) c.placement_mm.push_back(placement(random));
    const auto result = measure_misalignment(misaligned_capture(c), straight);
    ASSERT_TRUE(result) << result.error().sentence;
    sum += std::pow((result->theta_rad.value - c.theta_rad) / result->theta_rad.u, 2);
    sum_delta += std::pow((result->delta_mm.value - 48.0 * std::sin(c.theta_rad)) / result->delta_mm.u, 2);
    // delta to 0.001 p, one sigma, from one stack; on a slide with the default straightness.
    if (seed == 1) {
      EXPECT_LT(measure(c)->delta_mm.u, 0.001 * c.period_mm);
    }
  }
  EXPECT_NEAR(std::sqrt(sum / kSeeds), 1.0, 0.28);
  EXPECT_NEAR(std::sqrt(sum_delta / kSeeds), 1.0, 0.28);
}

TEST(MeasureMisalignment, WidensItsUncertaintyWhereTheBitsContradictOneAngle) {
  GratingCase c{.theta_rad = 0.3e-3, .placement_mm = std::vector<double>(11, 0.0)};
  c.placement_mm[3] = 0.008;  // one pattern 8 um off: twenty times the prior
  const auto result = measure(c);
  ASSERT_TRUE(result);
  EXPECT_GT(result->chi2_per_dof, 10.0);
  EXPECT_THAT(result->remarks, ::testing::Contains(HasSubstr("contradict")));
  EXPECT_NEAR(result->theta_rad.value, 0.3e-3, 3 * result->theta_rad.u);
}

// Steps' angle: noise of q is 0.01 sqrt(2 / 46000) = 0.07 mrad, 0.3 urad of theta, and 2 % of theta is allowed for the
// third harmonic; 1.5 urad more for the 24 pixels of a period.
TEST(MeasureMisalignment, FindsTheSameAngleInThePhaseStepsAlone) {
  for (const double theta : {-0.8e-3, -0.1e-3, 0.0, 0.3e-3, 1.5e-3}) {
    for (const int stripes : {1, 2}) {
      const auto result = measure({.theta_rad = theta, .stripes_per_period = stripes});
      ASSERT_TRUE(result && result->theta_from_steps_rad);
      EXPECT_NEAR(result->theta_from_steps_rad->value, theta, 2e-6 + 0.02 * std::abs(theta)) << theta;
      EXPECT_THAT(result->remarks, ::testing::Not(::testing::Contains(HasSubstr("another angle"))));
    }
  }
}

TEST(MeasureMisalignment, ReportsASecondAngleThatDisagreesInsteadOfAveragingIt) {
  // The phase patterns are made as if the angle were 0.4 mrad larger than the Gray patterns' slots say; the wrap (PS1
  // and PS3) stays: PS0 and PS2 move by 0.4e-3 * 12 mm each, opposite ways about it.
  GratingCase c{.theta_rad = 0.2e-3, .placement_mm = std::vector<double>(11, 0.0)};
  for (int k = 0; k < 4; ++k) c.placement_mm[static_cast<std::size_t>(7 + k)] = (2 - k) * 12.0 * 0.4e-3;
  const auto result = measure(c);
  ASSERT_TRUE(result && result->theta_from_steps_rad);
  EXPECT_NEAR(result->theta_rad.value, 0.2e-3, kNoiseRad);
  EXPECT_NEAR(result->theta_from_steps_rad->value, 0.6e-3, 2e-6 + 0.02 * 0.6e-3);
  EXPECT_THAT(result->remarks, ::testing::Contains(HasSubstr("another angle")));
}

TEST(MeasureMisalignment, SaysThatAPatternLiesAskew) {
  GratingCase c{.theta_rad = 0.2e-3, .lines = 160};
  c.askew_slot = 3;
  c.askew_mm = 0.004;
  const auto result = measure(c);
  ASSERT_TRUE(result) << result.error().sentence;
  EXPECT_THAT(result->remarks, ::testing::Contains(HasSubstr("bit 3 grows")));
  for (const auto& bit : result->bits) {
    // Noise of a tilt: sqrt(12) of the delta's, below 0.06 um; five of that.
    EXPECT_NEAR(bit.tilt_mm.value, bit.bit == 3 ? 0.004 : 0.0, 1e-3) << bit.bit;
  }
  // The middle line's delta is untouched by the tilt.
  EXPECT_NEAR(result->theta_rad.value, 0.2e-3, 2 * kNoiseRad);
}

TEST(MeasureMisalignment, SaysWhatTheBitsDetermineAndLeaveOpen) {
  const auto result = measure({.theta_rad = 0.2e-3});
  ASSERT_TRUE(result);
  EXPECT_THAT(result->remarks, ::testing::Contains(HasSubstr("5 bits, 48 to 108 mm")));
}

TEST(AverageOf, LessensWhatIsNewInEveryStackAndKeepsWhatTheGlassHas) {
  const GratingLayout layout{.pattern_pitch_mm = 12, .gray_slots = {}, .phase_slots = {}};
  std::vector<Misalignment> stacks;
  FringeCode code;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Capture capture = misaligned_capture({.theta_rad = 0.1e-3, .lines = 24, .seed = seed});
    code = *capture.info.plan.x;
    stacks.push_back(*measure_misalignment(capture, layout));
  }
  const Misalignment mean = average_of(stacks, layout, code);
  EXPECT_EQ(mean.stacks, 4);
  EXPECT_NEAR(mean.u_noise_rad, stacks.front().u_noise_rad / 2, 0.1 * stacks.front().u_noise_rad);
  EXPECT_LT(mean.theta_rad.u, stacks.front().theta_rad.u);
  EXPECT_GT(mean.theta_rad.u, 0.5 * stacks.front().theta_rad.u);
  EXPECT_NEAR(mean.theta_rad.value, 0.1e-3, kNoiseRad);
}

TEST(MeasureMisalignment, PutsThePapersPixelCountBesideItsOwn) {
  const auto result = measure({.theta_rad = 0.8e-3});
  ASSERT_TRUE(result);
  for (const auto& bit : result->bits) {
    // Whole pixels, and the ripple of the pixel's own threshold moves the count by up to 0.04 p (about one pixel)
    // more.
    EXPECT_NEAR(bit.jump_px / bit.period_px, bit.fraction_of_period, 2.0 / 24.0) << bit.bit;
    EXPECT_NEAR(bit.period_px, 24.0, 5.0);
  }
}

TEST(CountJumps, RefusesAMapWithTheRedundancyCorrectionBecauseItHidesDelta) {
  const Capture capture = misaligned_capture({.theta_rad = 0.4e-3});
  decode::DecodeOptions options;
  options.edges = decode::EdgeRule::redundant;
  const auto corrected = decode::decode_phase(capture, CodeAxis::x, options);
  const auto refused = count_jumps(corrected);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().sentence, HasSubstr("plain"));

  // It hides delta: called by the other name the corrected map shows no jump. The plain one shows delta of bit 5, which
  // is 4 * 12 mm * 0.4 mrad / 0.24 mm = 0.08 of 24 px, to the pixel.
  auto disguised = corrected;
  disguised.edges = decode::EdgeRule::plain;
  options.edges = decode::EdgeRule::plain;
  const auto hidden = count_jumps(disguised);
  const auto shown = count_jumps(decode::decode_phase(capture, CodeAxis::x, options));
  ASSERT_TRUE(hidden && shown);
  ASSERT_FALSE(hidden->empty() || shown->empty());
  for (const auto& bit : *hidden) EXPECT_EQ(bit.jump_px, 0) << bit.bit;
  EXPECT_NEAR(shown->back().jump_px, 0.08 * 24, 1.0);
  EXPECT_EQ(shown->back().bit, 5);
}

TEST(MeasureMisalignment, RefusesABoardThatIsNotFlat) {
  const auto result = measure({.bump_periods = 0.5});
  ASSERT_FALSE(result);
  EXPECT_THAT(result.error().sentence, HasSubstr("not flat"));
}

TEST(MeasureMisalignment, RefusesABoardPartlyOutOfTheField) {
  const auto result = measure({.covered = 0.3});
  ASSERT_FALSE(result);
  EXPECT_THAT(result.error().sentence, HasSubstr("out of the field"));
}

TEST(MeasureMisalignment, RefusesTooLittleModulation) {
  const auto result = measure({.light = 10});
  ASSERT_FALSE(result);
  EXPECT_THAT(result.error().sentence, HasSubstr("modulation"));
}

TEST(MeasureMisalignment, RefusesSaturatedFrames) {
  const auto result = measure({.ambient = 200});
  ASSERT_FALSE(result);
  EXPECT_THAT(result.error().sentence, HasSubstr("saturated"));
}

TEST(MeasureMisalignment, RefusesAPlanThatNamesTheWrongStripesPerPeriod) {
  Capture capture = misaligned_capture({.theta_rad = 0.1e-3, .stripes_per_period = 2});
  capture.info.plan.x->stripes_per_period = 1;
  const auto result = measure_misalignment(capture, {.pattern_pitch_mm = 12});
  ASSERT_FALSE(result);
  EXPECT_THAT(result.error().sentence, HasSubstr("stripes_per_period"));
}

TEST(MeasureMisalignment, RefusesAPlanWithoutWhatItCompares) {
  const Capture capture = misaligned_capture({.lines = 8});
  EXPECT_THROW(measure_misalignment(capture, {.pattern_pitch_mm = 12}, CodeAxis::y), InputError);
  EXPECT_THROW(measure_misalignment(capture, {.pattern_pitch_mm = 0}), InputError);
  EXPECT_THROW(measure_misalignment(capture, {.pattern_pitch_mm = 12, .gray_slots = {0, 1}}), InputError);
  Capture display = capture;
  display.info.plan.x->unit = "px";
  EXPECT_THROW(measure_misalignment(display, {.pattern_pitch_mm = 12}), InputError);
}

TEST(AlignmentProfile, ShowsTheStepsAndTheJumpsOfOneRow) {
  const Capture capture = misaligned_capture({.theta_rad = 0.8e-3, .lines = 16});
  const auto profile = alignment_profile(capture, CodeAxis::x, 8);
  EXPECT_EQ(profile.row, 8);
  ASSERT_GT(profile.column.size(), 700u);
  ASSERT_EQ(profile.column.size(), profile.phase_rad.size());
  // 30 periods of 2 stripes in the line; the Gray number climbs by one per stripe.
  EXPECT_NEAR(profile.gray_number.back() - profile.gray_number.front(), 60, 3);
  int jumps = 0;
  for (std::size_t i = 1; i < profile.phase_rad.size(); ++i) {
    jumps += std::abs(profile.phase_rad[i] - profile.phase_rad[i - 1]) > std::numbers::pi ? 1 : 0;
  }
  EXPECT_GE(jumps, 2 * 25);  // there and back at nearly each of the 30 boundaries
  EXPECT_THROW(alignment_profile(capture, CodeAxis::x, 16), InputError);
}

}  // namespace
}  // namespace fringecal::calib

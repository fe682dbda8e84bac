#include "calib/align_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fringecal::calib {
namespace {

using ::testing::HasSubstr;

constexpr double kPeriod = 0.24;

Misalignment reading_of(double theta, double u) {
  Misalignment m;
  m.theta_rad = {theta, u};
  for (int b = 5; b >= 0; --b) {
    BitMisalignment bit;
    bit.bit = b;
    bit.lever_mm = (9 - b) * 12.0;
    m.bits.push_back(bit);
  }
  return m;
}

AlignmentStep step_of(std::vector<AlignmentReading> history) {
  return next_step(history, reading_of(history.back().theta_rad.value, history.back().theta_rad.u), kPeriod);
}

TEST(NextStep, JudgesByTheCoarsestBitBecauseItJumpsMost) {
  // Bit 0: 108 mm. 2.4 um / 108 mm = 22.2 urad, less 2 u = 7.2 urad: aligned up to 15.0 urad.
  const auto near = step_of({{{14.9e-6, 3.6e-6}, 0}}), far = step_of({{{15.1e-6, 3.6e-6}, 0}});
  EXPECT_EQ(near.decision, AlignmentDecision::aligned);
  EXPECT_EQ(near.bit, 0);
  EXPECT_DOUBLE_EQ(near.tolerance_mm, 0.0024);
  EXPECT_EQ(far.decision, AlignmentDecision::turn);
  EXPECT_EQ(near.turn_rad, 0.0);
}

TEST(NextStep, TurnsAgainstTheAngleAndSaysTheDirection) {
  const auto plus = step_of({{{-0.8e-3, 3.6e-6}, 0}});
  EXPECT_EQ(plus.decision, AlignmentDecision::turn);
  EXPECT_GT(plus.turn_rad, 0.0);
  EXPECT_THAT(plus.sentence, HasSubstr("turn the adjuster +0.7"));
  EXPECT_THAT(plus.sentence, HasSubstr("(clockwise)"));
  EXPECT_THAT(step_of({{{0.8e-3, 3.6e-6}, 0}}).sentence, HasSubstr("(anticlockwise)"));
}

TEST(NextStep, LearnsTheGainFromTheMovesMade) {
  // The adjuster moves 1.06 of what it is asked: after one move of 1 mrad the gain is known to about backlash / move.
  const auto step = step_of({{{1.0e-3, 3.6e-6}, 0}, {{-0.06e-3, 3.6e-6}, -1.0e-3}});
  EXPECT_NEAR(step.gain.value, 1.06, 2 * step.gain.u);
  EXPECT_LT(step.gain.u, 0.04);
  EXPECT_NEAR(step.turn_rad, 0.06e-3, 0.035e-3);  // 0.06/1.06 and the backlash of the reversal, 0.03 by its prior
}

TEST(NextStep, RecognisesAnAdjusterThatCountsTheOtherWay) {
  const auto step = step_of({{{0.5e-3, 3.6e-6}, 0}, {{0.95e-3, 3.6e-6}, -0.45e-3}});
  EXPECT_LT(step.gain.value, -0.9);
  EXPECT_GT(step.turn_rad, 0.0);
}

TEST(NextStep, SaysWhenTurningDoesNotHelp) {
  const auto step = step_of({{{0.50e-3, 3.6e-6}, 0},
                             {{0.49e-3, 3.6e-6}, -0.45e-3},
                             {{0.50e-3, 3.6e-6}, -0.45e-3},
                             {{0.50e-3, 3.6e-6}, -0.45e-3}});
  EXPECT_EQ(step.decision, AlignmentDecision::not_improving);
  EXPECT_EQ(step.turn_rad, 0.0);
  EXPECT_THAT(step.sentence, HasSubstr("clamped"));
}

TEST(NextStep, AsksForMoreFramesWhereNoiseHidesTheAnswer) {
  const auto step = step_of({{{10e-6, 20e-6}, 0}});
  EXPECT_EQ(step.decision, AlignmentDecision::needs_more_frames);
}

TEST(ReadSetting, TakesMoreCapturesByItselfWhereNoiseLimits) {
  const GratingLayout layout{.pattern_pitch_mm = 12};
  const FringeCode code{.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = kPeriod, .unit = "mm"};
  // Edges that scatter by 0.9 um and more from stack to stack: u(theta) is 10 urad alone, 6 urad from nine.
  const auto take = [&](int i) -> Result<Misalignment> {
    Misalignment m = reading_of(0.0, 14e-6);
    for (auto& bit : m.bits) {
      bit.u_noise_mm = 0.0014;
      bit.delta_mm.value = bit.lever_mm * (i % 2 == 0 ? 3e-6 : -3e-6);
      bit.n_edges = 100;
    }
    return m;
  };
  const auto reading = read_setting(take, {}, {.layout = layout, .code = code, .loop = {.max_captures = 9}});
  ASSERT_TRUE(reading);
  EXPECT_EQ(reading->step.decision, AlignmentDecision::aligned) << reading->step.sentence;
  EXPECT_GT(reading->measured.stacks, 1);
  // A tolerance below what the glass allows is never proved: the reason is said.
  const auto never = read_setting(
      take, {}, {.layout = layout, .code = code, .loop = {.tolerance_of_period = 0.001, .max_captures = 3}});
  ASSERT_TRUE(never);
  EXPECT_EQ(never->step.decision, AlignmentDecision::needs_more_frames);
  EXPECT_EQ(never->measured.stacks, 3);
  EXPECT_THAT(never->step.sentence, HasSubstr("would stay with any number"));
}

// The adjuster of virtual-instrument.md: scale error 3 % rms, backlash 0.05 mrad, resolution 0.005 mrad, read with
// 3.6 urad.
TEST(NextStep, AlignsWithinThreeTurnsFromAnywhere) {
  int within = 0, turns_total = 0;
  constexpr int kSeeds = 300;
  std::vector<int> turns_of;
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    double theta = std::uniform_real_distribution<double>(-1.5e-3, 1.5e-3)(random);
    const double gain = 1.0 + 0.03 * normal(random), backlash = 0.05e-3;
    double slack = std::uniform_real_distribution<double>(0, backlash)(random);  // 0: engaged for positive turns
    std::vector<AlignmentReading> history;
    double turn = 0;
    AlignmentStep step;
    int turns = 0;
    for (; turns < 10; ++turns) {
      history.push_back({{theta + 3.6e-6 * normal(random), 3.6e-6}, turn});
      step = step_of(history);
      if (step.decision != AlignmentDecision::turn) break;
      turn = std::round(step.turn_rad / 5e-6) * 5e-6;
      const double moved = turn > 0 ? std::max(0.0, turn - slack) : std::min(0.0, turn + (backlash - slack));
      slack = turn > 0 ? std::max(0.0, slack - turn) : std::min(backlash, slack - turn);
      theta += gain * moved;
    }
    EXPECT_EQ(step.decision, AlignmentDecision::aligned) << seed << ": " << step.sentence;
    within += std::abs(theta) <= 0.02e-3 ? 1 : 0;
    turns_total += turns;
    turns_of.push_back(turns);
  }
  std::sort(turns_of.begin(), turns_of.end());
  EXPECT_GE(within, kSeeds * 95 / 100);
  EXPECT_LE(turns_of[kSeeds / 2], 2);
  EXPECT_LE(turns_of.back(), 3) << "mean " << turns_total / static_cast<double>(kSeeds);
}

}  // namespace
}  // namespace fringecal::calib

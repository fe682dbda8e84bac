// The reported u(phi) against the scatter of the phases, and order errors under noise.
#include "calib/decode/decode.h"
#include "tests/calib/synthetic_fringes.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace fringecal::decode {
namespace {

using test::FringeScene;
using test::render;
using test::true_u_over_p;

constexpr DecodeOptions kPlain{.edges = EdgeRule::plain, .sigma_gray_levels = {}};

FringeScene noisy_scene(int steps, int per_period, double read_sd, double gain) {
  FringeScene s;
  s.code = {.gray_bits = 7, .phase_steps = steps, .stripes_per_period = per_period, .period = 0.24, .unit = "mm"};
  s.start = 0.5;
  s.read_sd = read_sd;
  s.gain = gain;
  return s;
}

struct Scatter {
  double sd = 0;  // of (phase - truth) / u
  std::size_t wrong = 0, valid = 0;
};

Scatter scatter_of(const FringeScene& s, const PhaseMap& map) {
  Scatter out;
  double sum = 0;
  for (int y = 0; y < map.height(); ++y) {
    for (int x = 0; x < map.width(); ++x) {
      if (!map.valid(x, y)) continue;
      const double truth = 2 * std::numbers::pi * true_u_over_p(s, x) - std::numbers::pi;
      const double error = map.phase_rad(x, y) - truth;
      ++out.valid;
      if (std::abs(error) > std::numbers::pi) {
        ++out.wrong;
        continue;
      }
      const double normalised = error / map.u_phase_rad(x, y);
      sum += normalised * normalised;
    }
  }
  out.sd = std::sqrt(sum / static_cast<double>(out.valid - out.wrong));
  return out;
}

// 120000 pixels give the scatter to 1 / sqrt(2 n) = 0.2 %; the noise is estimated from 30000 second differences or
// more, to 0.7 % at 95 %; at B = 60 the terms of second order, (sigma / B)^2, stay below 0.2 %: together 1.5 %, allowed
// are 3 %.
TEST(PhaseUncertainty, IsTheScatterForAnyNumberOfSteps) {
  for (const int steps : {3, 4, 5, 8}) {
    for (const double sd : {0.6, 1.0, 2.0}) {
      const FringeScene s = noisy_scene(steps, 2, sd, 0);
      const Scatter scatter = scatter_of(s, decode_phase(render(s), CodeAxis::x));
      EXPECT_GT(scatter.sd, 0.97) << steps << " steps, sigma " << sd;
      EXPECT_LT(scatter.sd, 1.03) << steps << " steps, sigma " << sd;
      EXPECT_EQ(scatter.valid, 120000u);
      EXPECT_EQ(scatter.wrong, 0u);
    }
  }
}

TEST(PhaseUncertainty, IsTheScatterUnderTextureFixedPatternAndShotNoise) {
  // Fixed-pattern gain of 0.5 % is half a grey level at 100, as large as half the noise: it must not be counted,
  // because it moves all steps of a pixel together. The same limits as above, and in the dark and the light half by
  // themselves.
  FringeScene s = noisy_scene(4, 2, 0.7, 0.005);
  s.fixed_pattern = 0.005;
  s.albedo = [](int, int a) { return a < 150 ? 1.0 : 0.4 + 0.1 * std::sin(a * 0.3); };
  s.along = 800;
  const PhaseMap map = decode_phase(render(s), CodeAxis::x);
  EXPECT_NEAR(scatter_of(s, map).sd, 1.0, 0.03);
  for (const bool light : {false, true}) {
    PhaseMap half = map;
    for (int y = 0; y < 300; ++y) {
      for (int x = 0; x < 800; ++x) {
        if ((y < 150) != light) half.validity(x, y) = 1;
      }
    }
    EXPECT_NEAR(scatter_of(s, half).sd, 1.0, 0.03) << (light ? "light" : "dark");
  }
}

TEST(PhaseUncertainty, IsNotRaisedByStepErrorsAndTiltedFringes) {
  // A step error of 0.05 rad leaves up to 0.05 B / 2 = 1.5 grey levels in the residual, smooth along the fringes: the
  // second difference takes it out. (The phase itself has a ripple then, which is not noise.)
  FringeScene s = noisy_scene(4, 2, 1.0, 0);
  const double plain = decode_phase(render(s), CodeAxis::x).noise.sigma(100);
  s.step_error_rad = {0.05, -0.05, 0.05, -0.05};
  const double with_errors = decode_phase(render(s), CodeAxis::x).noise.sigma(100);
  EXPECT_NEAR(with_errors / plain, 1.0, 0.02);  // two estimates of 0.4 % each, 95 %
}

TEST(NoiseModel, FindsReadNoiseAndGain) {
  // Variance read^2 + 1/12 + gain I; two halves at 40 and 160 grey levels give each level's sigma to 0.5 % (30000
  // samples).
  FringeScene s = noisy_scene(4, 2, 0.8, 0.01);
  s.albedo = [](int, int a) { return a < 150 ? 1.2 : 0.3; };
  s.along = 800;
  const NoiseModel noise = decode_phase(render(s), CodeAxis::x).noise;
  for (const double level : {30.0, 120.0}) {
    EXPECT_NEAR(noise.sigma(level), std::sqrt(0.64 + 1 / 12.0 + 0.01 * level), 0.03) << level;
  }
  EXPECT_NE(noise.source.find("estimated"), std::string::npos);
}

TEST(NoiseModel, OfTooFewPixelsIsAssumedAndSaysSo) {
  FringeScene s = noisy_scene(4, 2, 1.0, 0);
  s.along = 10;
  s.across = 6;
  const NoiseModel noise = decode_phase(render(s), CodeAxis::x).noise;
  EXPECT_EQ(noise.sigma(100), 1.0);
  EXPECT_NE(noise.source.find("assumed"), std::string::npos);
}

TEST(OrderErrors, VanishWithRedundancyAtLowModulation) {
  // B = 20, sigma = 2: u(phi) / 2 pi = 0.011 p, a Gray level is 15.7 / 2.2 = 7 deviations from its threshold. Plain
  // decoding fails at the edges themselves. With two stripes per period an error needs an edge p / 8 out of place, 11
  // u. With one, a full bit passes for a small one 3.7 s_t = 4 deviations low (gray.h, eq. 5): 3e-5 of the outer quarter
  // is one pixel, and some more at the wrap, where the phase is on the wrong side and the bit 3 deviations off: 12 in all
  // are four standard deviations above four.
  for (const int per_period : {1, 2}) {
    FringeScene s = noisy_scene(4, per_period, 2.0, 0);
    s.modulation = 20;
    s.gray_amplitude = 15.7;
    s.blur = 0.15;
    const Capture capture = render(s);
    const Scatter plain = scatter_of(s, decode_phase(capture, CodeAxis::x, kPlain));
    const Scatter redundant = scatter_of(s, decode_phase(capture, CodeAxis::x));
    EXPECT_GT(plain.wrong, 100u) << per_period;
    EXPECT_LE(redundant.wrong, per_period == 2 ? 0u : 12u);
    RecordProperty(fmt::format("wrong_{}", per_period), fmt::format("{} of {} plain", redundant.wrong, plain.wrong));
    EXPECT_LT(60 * redundant.wrong, plain.wrong) << per_period;
    EXPECT_GT(redundant.valid, 119900u) << per_period;
  }
}

TEST(OrderErrors, StayRareAtTheLimitOfModulation) {
  // B = 4 sigma, the default limit for one grey level of noise: of the pixels that are called valid less than 1 in 500
  // may have a wrong order (three coarse bits whose level, 3.1 sigma, crosses sigma on the other side: 4.1 / 1.12 = 3.7
  // deviations, 1e-4 each; and the phase's own 0.18 rad against p / 8).
  FringeScene s = noisy_scene(4, 2, 1.0, 0);
  s.modulation = 4.5;
  s.gray_amplitude = 4.5 * std::numbers::pi / 4;
  s.blur = 0.1;
  const Scatter redundant = scatter_of(s, decode_phase(render(s), CodeAxis::x));
  EXPECT_GT(redundant.valid, 60000u);
  EXPECT_LT(static_cast<double>(redundant.wrong) / static_cast<double>(redundant.valid), 0.002);
}

}  // namespace
}  // namespace fringecal::decode

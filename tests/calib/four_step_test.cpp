// The pass for four steps and a Gray code: equal to the general path, the same bytes on every width of vectors, and what
// it makes of a whole noisy picture.
#include "calib/decode/four_step.h"

#include "calib/decode/decode.h"
#include "tests/calib/synthetic_fringes.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstring>

namespace fringecal::decode {
namespace {

using test::FringeScene;
using test::render;
using test::true_u_over_p;

/// A picture with everything in it: light, shadow, little modulation, saturation, misplaced and blurred Gray edges.
FringeScene varied_scene(int per_period) {
  FringeScene s;
  s.code = {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = per_period, .period = 0.24, .unit = "mm"};
  s.start = 0.5;
  s.read_sd = 1.0;
  s.gray_shift = 0.03;
  s.blur = 0.2;
  s.along = 413;  // no multiple of any vector
  s.across = 201;
  s.albedo = [](int, int a) { return a < 30 ? 0.0 : a < 60 ? 0.06 : a < 90 ? 1.7 : a < 120 ? 0.15 : 1.0; };
  return s;
}

Capture widened(Capture capture, std::size_t first, std::size_t last) {
  for (std::size_t k = first; k < last; ++k) {
    const Image8 narrow = std::get<Image8>(capture.frames[k]);
    Image16 wide(narrow.width(), narrow.height());
    std::copy(narrow.values().begin(), narrow.values().end(), wide.values().begin());
    capture.frames[k] = std::move(wide);
  }
  return capture;
}

void expect_same_bytes(const Image<float>& a, const Image<float>& b, const char* what) {
  ASSERT_EQ(a.size(), b.size()) << what;
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0) << what;
}
void expect_same_bytes(const PhaseMap& a, const PhaseMap& b) {
  EXPECT_EQ(a.validity.values(), b.validity.values());
  expect_same_bytes(a.phase_rad, b.phase_rad, "phase");
  expect_same_bytes(a.wrapped_rad, b.wrapped_rad, "wrapped");
  expect_same_bytes(a.modulation, b.modulation, "modulation");
  expect_same_bytes(a.mean, b.mean, "mean");
  expect_same_bytes(a.u_phase_rad, b.u_phase_rad, "u");
}

TEST(FourStep, EqualsTheGeneralPath) {
  for (const int per_period : {1, 2}) {
    for (const EdgeRule edges : {EdgeRule::plain, EdgeRule::redundant}) {
      const Capture capture = render(varied_scene(per_period));
      const DecodeOptions options{.edges = edges, .sigma_gray_levels = {}};
      const PhaseMap fast = decode_phase(capture, CodeAxis::x, options);
      // Frames of two depths take the general path.
      const PhaseMap general = decode_phase(widened(capture, 0, 1), CodeAxis::x, options);
      const auto counts = count_validity(fast);
      for (const std::size_t reason : {0u, 1u, 2u, 3u}) EXPECT_GT(counts[reason], 1000u) << reason;
      EXPECT_EQ(counts[4] > 50u, edges == EdgeRule::redundant);
      EXPECT_EQ(fast.validity.values(), general.validity.values());
      expect_same_bytes(fast.modulation, general.modulation, "modulation");
      expect_same_bytes(fast.mean, general.mean, "mean");
      expect_same_bytes(fast.u_phase_rad, general.u_phase_rad, "u");
      for (std::size_t i = 0; i < fast.validity.size(); ++i) {
        // 3e-7 of the polynomial and half a unit of the last place of either below pi, 1.2e-7; then one unit of the sum.
        const float a = fast.wrapped_rad.values()[i], b = general.wrapped_rad.values()[i];
        ASSERT_NEAR(a, b, 5.4e-7);
        if (fast.validity.values()[i] == 0) {
          const float phase = general.phase_rad.values()[i];
          ASSERT_NEAR(fast.phase_rad.values()[i], phase, 5.4e-7 + 0x1p-23 * std::abs(phase));
        }
      }
    }
  }
}

TEST(FourStep, EqualsTheArcTangentForEveryDifferenceOfGreyLevels) {
  // All pairs (S, C) of 8 bit. Moshier's polynomial is good to 1.9e-7 relative up to pi / 8; three roundings below pi.
  Image8 frames[5] = {Image8(511, 511), Image8(511, 511), Image8(511, 511), Image8(511, 511), Image8(511, 511, 255)};
  for (int s = -255; s <= 255; ++s) {
    for (int c = -255; c <= 255; ++c) {
      const int x = c + 255, y = s + 255;
      frames[0](x, y) = static_cast<std::uint8_t>(std::max(c, 0));
      frames[2](x, y) = static_cast<std::uint8_t>(std::max(-c, 0));
      frames[1](x, y) = static_cast<std::uint8_t>(std::max(s, 0));
      frames[3](x, y) = static_cast<std::uint8_t>(std::max(-s, 0));
    }
  }
  Image<float> phase(511, 511), wrapped(511, 511);
  Image8 validity(511, 511);
  FourStepTask task{.bits = 1, .rule = OrderRule::plain, .phase_rad = phase.data(), .validity = validity.data()};
  for (std::size_t k = 0; k < 4; ++k) task.phase[k] = frames[k].data();
  task.gray[0] = frames[4].data();
  task.wrapped_rad = wrapped.data();
  decode_four_step(task, 0, wrapped.size());
  double worst = 0;
  for (int s = -255; s <= 255; ++s) {
    for (int c = -255; c <= 255; ++c) {
      worst = std::max(worst, std::abs(wrapped(c + 255, s + 255) - std::atan2(double(s), double(c))));
    }
  }
  EXPECT_LT(worst, 4.2e-7);  // 3e-7 and half a unit of the last place below pi
}

TEST(FourStep, GivesTheSameBytesForFramesOfEightAndSixteenBits) {
  for (const int per_period : {1, 2}) {
    const Capture capture = render(varied_scene(per_period));
    expect_same_bytes(decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = 2.0}),
                      decode_phase(widened(capture, 0, 11), CodeAxis::x, {.sigma_gray_levels = 2.0}));
  }
}

TEST(FourStep, GivesTheSameBytesOnEveryWidthOfVectorsAndHoweverItIsCut) {
  for (const bool wide : {false, true}) {
    for (const OrderRule rule : {OrderRule::plain, OrderRule::half_stripe, OrderRule::whole_stripe}) {
      Capture capture = render(varied_scene(rule == OrderRule::whole_stripe ? 1 : 2));
      if (wide) capture = widened(std::move(capture), 0, 11);
      const std::size_t pixels = 413 * 201;
      const auto decode = [&](std::size_t cut) {
        std::vector<float> out(5 * pixels);
        std::vector<std::uint8_t> validity(pixels);
        FourStepTask task{.wide = wide,
                          .rule = rule,
                          .stripes_per_period = rule == OrderRule::whole_stripe ? 1 : 2,
                          .read_variance = 1.0f,
                          .gain = 0.02f,
                          .shadow_modulation_per_sigma = 2.6f,
                          .phase_rad = out.data(),
                          .validity = validity.data(),
                          .wrapped_rad = &out[pixels],
                          .modulation = &out[2 * pixels],
                          .mean = &out[3 * pixels],
                          .u_phase_rad = &out[4 * pixels]};
        for (std::size_t k = 0; k < 11; ++k) {
          const void* data =
              std::visit([](const auto& i) { return static_cast<const void*>(i.data()); }, capture.frames[k]);
          (k < 7 ? task.gray[k] : task.phase[k - 7]) = data;
        }
        for (std::size_t first = 0; first < pixels; first += cut) {
          decode_four_step(task, first, std::min(cut, pixels - first));
        }
        out.insert(out.end(), validity.begin(), validity.end());
        return out;
      };
      const auto best = decode(pixels);
      const auto same = [&](const std::vector<float>& other) {
        return std::memcmp(best.data(), other.data(), best.size() * sizeof(float)) == 0;
      };
      for (const std::size_t cut : {1009u, 64u, 7u}) EXPECT_TRUE(same(decode(cut))) << cut;
      int targets = 0;
      for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        hwy::GetChosenTarget().Update(hwy::SupportedTargets());
        EXPECT_TRUE(same(decode(5000))) << hwy::TargetName(target);
        ++targets;
      }
      hwy::SetSupportedTargetsForTest(0);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      EXPECT_GE(targets, 1);
    }
  }
}

TEST(FourStep, GivesOnlyTheMapsAskedForInTheMemoryOfAnEarlierOne) {
  const Capture capture = render(varied_scene(2));
  const PhaseMap all = decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = 2.0});
  PhaseMap least = decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = 2.0, .detail = Detail::phase});
  EXPECT_TRUE(least.wrapped_rad.empty() && least.modulation.empty() && least.mean.empty() && least.u_phase_rad.empty());
  expect_same_bytes(least.phase_rad, all.phase_rad, "phase");
  EXPECT_EQ(least.validity.values(), all.validity.values());
  const float* const memory = least.phase_rad.data();
  std::fill(least.phase_rad.values().begin(), least.phase_rad.values().end(), -1.0f);
  const PhaseMap again =
      decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = 2.0, .detail = Detail::measuring}, std::move(least));
  EXPECT_EQ(again.phase_rad.data(), memory);
  expect_same_bytes(again.phase_rad, all.phase_rad, "phase");
  expect_same_bytes(again.modulation, all.modulation, "modulation");
  expect_same_bytes(again.u_phase_rad, all.u_phase_rad, "u");
}

/// The paper's camera at one grey level of noise, blurred Gray edges 0.03 p out of place.
FringeScene whole_picture(int per_period) {
  FringeScene s;
  s.code = {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = per_period, .period = 0.24, .unit = "mm"};
  s.along = 1392;
  s.across = 1040;
  s.start = 0.5;
  s.read_sd = 1.0;
  s.blur = 0.15;
  s.gray_shift = 0.03;
  s.px_per_period = 1392 / 61.7;
  return s;
}

TEST(FourStep, PhaseNoiseIsTheCramerRaoBound) {
  // u = sqrt(2 / N) sigma / B with sigma^2 = 1 + 1/12 (rounding). 1.4 million pixels give the scatter to 0.06 %, terms of
  // second order are (sigma / B)^2 = 0.03 %.
  const FringeScene s = whole_picture(2);
  const PhaseMap map = decode_phase(render(s), CodeAxis::x, {.sigma_gray_levels = 1.0});
  double sum = 0;
  std::size_t n = 0;
  for (int y = 0; y < s.across; ++y) {
    for (int x = 0; x < s.along; ++x) {
      if (!map.valid(x, y)) continue;
      const double error = map.phase_rad(x, y) - 2 * std::numbers::pi * true_u_over_p(s, x) + std::numbers::pi;
      sum += error * error;
      ++n;
    }
  }
  EXPECT_GT(n, 1392u * 1040u * 99 / 100);
  const double bound = std::sqrt(0.5) * std::sqrt(1.0 + 1.0 / 12.0) / s.modulation;
  const double ratio = std::sqrt(sum / static_cast<double>(n)) / bound;
  RecordProperty("ratio", fmt::format("{:.5f}", ratio));
  EXPECT_NEAR(ratio, 1.0, 0.01);
}

TEST(FourStep, OrderErrorsAreRarerThanOneInFiftyThousand) {
  // Light that falls off to B = 9. The limit is what is asked of the decoder at one grey level of noise; with one stripe per
  // period the side of an edge hangs on two bits alone (gray.h, eq. 5), and 2e-5 is what they can tell here.
  for (const int per_period : {1, 2}) {
    FringeScene s = whole_picture(per_period);
    s.albedo = [](int, int a) { return 0.15 + 0.85 * a / 1039.0; };
    const PhaseMap map = decode_phase(render(s), CodeAxis::x, {.sigma_gray_levels = 1.0});
    std::size_t wrong = 0, valid = 0;
    for (int y = 0; y < s.across; ++y) {
      for (int x = 0; x < s.along; ++x) {
        if (!map.valid(x, y)) continue;
        ++valid;
        const double error = map.phase_rad(x, y) - 2 * std::numbers::pi * true_u_over_p(s, x) + std::numbers::pi;
        wrong += std::abs(error) > std::numbers::pi ? 1 : 0;
      }
    }
    EXPECT_GT(valid, 1392u * 1040u * 99 / 100) << per_period;
    RecordProperty(fmt::format("wrong_{}", per_period), fmt::format("{} of {}", wrong, valid));
    EXPECT_LE(static_cast<double>(wrong), 2e-5 * static_cast<double>(valid)) << per_period << ": " << wrong;
  }
}

}  // namespace
}  // namespace fringecal::decode

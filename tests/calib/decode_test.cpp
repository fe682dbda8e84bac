#include "calib/decode/decode.h"

#include "calib/decode/gray.h"
#include "calib/decode/picture.h"
#include "tests/calib/synthetic_fringes.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::decode {
namespace {

using test::FringeScene;
using test::render;
using test::true_u_over_p;

constexpr DecodeOptions kPlain{.edges = EdgeRule::plain, .sigma_gray_levels = {}};
using testing::HasSubstr;

/// How the orders of the valid pixels compare with the truth.
struct Orders {
  std::size_t valid = 0, wrong = 0;
};

/// Calls visit(c, a, x, y) for every pixel: c along u, a along the fringes.
template <class Visit>
void for_each_pixel(const FringeScene& s, const Visit& visit) {
  for (int a = 0; a < s.across; ++a) {
    for (int c = 0; c < s.along; ++c) s.axis == CodeAxis::x ? visit(c, a, c, a) : visit(c, a, a, c);
  }
}

double true_phase(const FringeScene& s, int c) { return 2 * std::numbers::pi * true_u_over_p(s, c) - std::numbers::pi; }

/// A wrong order is half a period or more of error.
Orders orders_of(const FringeScene& s, const PhaseMap& map) {
  Orders out;
  for_each_pixel(s, [&](int c, int, int x, int y) {
    if (!map.valid(x, y)) return;
    ++out.valid;
    if (std::abs(map.phase_rad(x, y) - true_phase(s, c)) > std::numbers::pi) ++out.wrong;
  });
  return out;
}

FringeScene scene_of(int bits, int steps, int per_period) {
  FringeScene s;
  s.code = {.gray_bits = bits, .phase_steps = steps, .stripes_per_period = per_period, .period = 0.24, .unit = "mm"};
  return s;
}

/// Without noise at 16 bit every pixel must come out. Rounding to integers moves S and C by at most N / 2 each, so
/// |error| <= (2 / (N B)) sqrt(2) N / 2 = 1.42 / B; the sum 2 pi m + phi' in float adds half a unit of its last place,
/// and 2 pi m another.
void expect_exact(const FringeScene& s, EdgeRule edges) {
  const Capture capture = render(s);
  ASSERT_EQ(defect_of(capture.info.plan), "");
  const PhaseMap map = decode_phase(capture, s.axis, {.edges = edges, .sigma_gray_levels = {}});
  std::size_t wrong = 0;
  double worst = 0;
  for_each_pixel(s, [&](int c, int, int x, int y) {
    const double truth = true_phase(s, c);
    const double error = map.valid(x, y) ? std::abs(map.phase_rad(x, y) - truth) : HUGE_VAL;
    const double limit = 1.42 / s.modulation + std::abs(truth) * 0x1p-23 + 1e-6;
    worst = std::max(worst, error);
    wrong += error > limit ? 1 : 0;
  });
  EXPECT_EQ(wrong, 0u) << "n " << s.code.gray_bits << ", N " << s.code.phase_steps << ", spp "
                       << s.code.stripes_per_period << ", worst " << worst;
}

FringeScene exact_scene(int bits, int steps, int per_period) {
  FringeScene s = scene_of(bits, steps, per_period);
  s.bits = 16;
  s.mean = 30000;
  s.modulation = s.gray_amplitude = 20000;
  const int periods = s.code.stripes() / per_period;
  s.px_per_period = 1990.0 / periods;
  // Between the centres of two pixels at each edge of the pattern, and of most edges within it.
  s.start = 0.371 / s.px_per_period;
  s.blur = std::min(0.05, 1 / s.px_per_period);
  s.along = 1990;
  s.across = 3;
  return s;
}

TEST(DecodePhase, IsExactForEveryCodeWithoutNoise) {
  for (const int steps : {3, 4, 5, 8}) {
    for (const int per_period : {1, 2}) {
      for (const int bits : {5, 7, 8}) {
        for (const EdgeRule edges : {EdgeRule::plain, EdgeRule::redundant}) {
          expect_exact(exact_scene(bits, steps, per_period), edges);
        }
      }
    }
  }
}

TEST(DecodePhase, IsExactAlongYAndWithEachReference) {
  for (const bool inverses : {false, true}) {
    for (const bool white_and_black : {false, true}) {
      FringeScene s = exact_scene(6, 4, 2);
      s.axis = CodeAxis::y;
      s.inverses = inverses;
      s.white_and_black = white_and_black;
      expect_exact(s, EdgeRule::redundant);
    }
  }
}

TEST(DecodePhase, TenBitsNumberAThousandStripes) {
  for (const int per_period : {1, 2}) {
    FringeScene s = exact_scene(10, 4, per_period);
    s.along = 8000;
    s.px_per_period = 8000.0 / (1024 / per_period);
    s.start = 0.371 / s.px_per_period;
    expect_exact(s, EdgeRule::redundant);
  }
}

TEST(DecodePhase, WithoutGrayBitsThePhaseStaysWrapped) {
  FringeScene s = exact_scene(5, 4, 2);
  s.code.gray_bits = 0;
  const PhaseMap map = decode_phase(render(s), CodeAxis::x);
  for_each_pixel(s, [&](int c, int, int x, int y) {
    ASSERT_TRUE(map.valid(x, y));
    EXPECT_EQ(map.phase_rad(x, y), map.wrapped_rad(x, y));
    // 1.42 / B as above; 1e-5 for float arithmetic.
    EXPECT_NEAR(std::remainder(map.phase_rad(x, y) - true_phase(s, c), 2 * std::numbers::pi), 0, 1.42 / 20000 + 1e-5);
  });
}

TEST(DecodePhase, WithoutPhasePatternsGivesTheMiddleOfTheStripe) {
  for (const bool inverses : {false, true}) {
    FringeScene s = exact_scene(6, 0, 1);
    s.code.unit = "px";
    s.code.period = 3.0;
    s.inverses = inverses;
    s.white_and_black = !inverses;
    const PhaseMap map = decode_phase(render(s), CodeAxis::x);
    for_each_pixel(s, [&](int c, int, int x, int y) {
      ASSERT_TRUE(map.valid(x, y));
      const double middle = (std::floor(true_u_over_p(s, c)) + 0.5) * 3.0;
      EXPECT_NEAR(map.u_at(x, y), middle, 192 * 0x1p-22);  // float: two roundings of a phase of 64 periods
      EXPECT_NEAR(map.u_phase_rad(x, y), 2 * std::numbers::pi / std::sqrt(12.0), 1e-6);
    });
  }
}

TEST(DecodePhase, RefusesAnAxisThatIsNotCoded) {
  const Capture capture = render(exact_scene(5, 4, 2));
  EXPECT_THAT(test::message_of<InputError>([&] { decode_phase(capture, CodeAxis::y); }), HasSubstr("no code along y"));
}

TEST(DecodePhase, PlainShowsAMisplacedGrayEdgeInFullWidth) {
  // Every period edge has one Gray edge of the bits 0 .. n-2, displaced by 0.05 p: between the two m is one too small.
  // 19 full periods and an edge count known to one pixel in about 20: the share is 0.05 to +- 10 %.
  FringeScene s = scene_of(7, 4, 2);
  s.gray_shift = 0.05;
  s.px_per_period = 200.37;
  s.along = 4000;
  s.across = 4;
  const Orders plain = orders_of(s, decode_phase(render(s), CodeAxis::x, kPlain));
  EXPECT_EQ(plain.valid, 16000u);
  EXPECT_NEAR(static_cast<double>(plain.wrong) / 16000, 0.05, 0.005);
}

TEST(DecodePhase, RedundantMendsMisplacedGrayEdges) {
  for (const double shift : {-0.12, -0.05, 0.0, 0.05, 0.12}) {
    FringeScene s = scene_of(7, 4, 2);
    s.start = 0.5;  // so that no displaced edge leaves the pattern's ends
    s.gray_shift = shift;
    s.read_sd = 0.3;
    const Orders orders = orders_of(s, decode_phase(render(s), CodeAxis::x));
    // p / 8 = 0.125 is the limit; noise of u(phi) / 2 pi = 0.0006 p leaves nothing beyond it.
    EXPECT_EQ(orders.valid, 400u * 300u) << shift;
    EXPECT_EQ(orders.wrong, 0u) << shift;
  }
}

TEST(DecodePhase, RedundantWithOneStripePerPeriodUsesTheBitNearItsThreshold) {
  // Blur over 0.2 p: t grows to full, 60 grey levels, within 0.1 p of the edge. A displacement of 0.04 p puts every pixel
  // that is on the wrong side within 0.04 p of a Gray edge, |t| <= 24, and the own bit at 60 with s_t = 4.3: L >= 34.
  for (const double shift : {-0.04, 0.04}) {
    FringeScene s = scene_of(6, 4, 1);
    s.start = 0.5;
    s.gray_shift = shift;
    s.blur = 0.2;
    s.read_sd = 1;
    const Capture capture = render(s);
    const Orders plain = orders_of(s, decode_phase(capture, CodeAxis::x, kPlain));
    const Orders redundant = orders_of(s, decode_phase(capture, CodeAxis::x));
    EXPECT_GT(plain.wrong, 2000u);  // 0.04 of 120000 are 4800
    EXPECT_EQ(redundant.wrong, 0u);
    EXPECT_EQ(redundant.valid, 120000u);
  }
}

TEST(DecodePhase, AnEdgeTooFarOutIsFlaggedAndNotGuessed) {
  // Displaced by 0.3 p: the pixels between p / 8 and 0.3 p on the wrong side are inconsistent, 0.175 of every half
  // period.
  FringeScene s = scene_of(7, 4, 2);
  s.start = 0.5;
  s.gray_shift = 0.3;
  const PhaseMap map = decode_phase(render(s), CodeAxis::x);
  const Orders orders = orders_of(s, map);
  EXPECT_EQ(orders.wrong, 0u);
  const double flagged = static_cast<double>(count_validity(map)[4]) / 120000;
  EXPECT_NEAR(flagged, 0.35, 0.05);  // one pixel is 0.049 p
}

TEST(DecodePhase, EveryReasonIsGivenWhereItHolds) {
  FringeScene s = scene_of(5, 4, 2);
  s.read_sd = 1;
  // Six bands across the fringes: normal, no light, B = 3, overexposed, and a coarse bit lost in a gloss.
  s.albedo = [](int, int a) { return a < 50 ? 1.0 : a < 100 ? 0.0 : a < 150 ? 0.05 : a < 200 ? 1.7 : 1.0; };
  Capture capture = render(s);
  auto& bit_0 = std::get<Image8>(capture.frames[0]);
  for (int y = 250; y < 300; ++y) {
    for (int x = 100; x < 200; ++x) bit_0(x, y) = 100;  // at A; bit 0 of 16 periods toggles in their middle only
  }
  s.start = 0.013;
  const PhaseMap map = decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = 1.0});
  const auto share = [&](int y0, int y1, int x0, int x1, Validity v) {
    double n = 0;
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) n += map.validity(x, y) == static_cast<std::uint8_t>(v) ? 1 : 0;
    }
    return n / ((y1 - y0) * (x1 - x0));
  };
  constexpr int kInside = 320;  // 320 px are 15.7 of the 16 periods: the rest of the row is beyond the pattern
  EXPECT_GE(share(0, 50, 0, kInside, Validity::valid), 0.9999);
  // Of pure noise 1 in 1000 passes for light; 20000 pixels: 20 +- 4.5. Clipping at black makes it less.
  EXPECT_GE(share(50, 100, 0, 400, Validity::shadow), 0.998);
  // B = 3 with a deviation of 0.75 (noise 1, rounding 0.29), 5 levels above black: between the shadow limit of
  // 3.7 / sqrt(2) = 2.62 and 4 lie 60 %.
  EXPECT_NEAR(share(100, 150, 0, 400, Validity::low_modulation), 0.60, 0.05);
  // 170 + 102 cos: above 254.5 for |phase - 2 pi k / 4| < 0.59 rad, which one of four steps has in 0.75 of all phases.
  EXPECT_NEAR(share(150, 200, 0, kInside, Validity::saturated), 0.75, 0.03);
  EXPECT_GE(share(250, 300, 100, 130, Validity::inconsistent_code), 0.6);  // |t| <= sigma; t has 1.12: 63 %
  for (int y = 0; y < 300; ++y) {
    for (int x = 0; x < 400; ++x) {
      EXPECT_EQ(std::isnan(map.phase_rad(x, y)), !map.valid(x, y));
      EXPECT_TRUE(std::isfinite(map.modulation(x, y)));
    }
  }
  EXPECT_STREQ(name_of(Validity::low_modulation), "low modulation");
}

TEST(DecodePhase, BeyondThePatternsEndThePixelIsInconsistent) {
  FringeScene s = scene_of(5, 4, 2);
  s.start = 15.6;  // of 16 periods; beyond the end the code's stripe stays the last one's neighbour
  s.along = 20;
  const PhaseMap map = decode_phase(render(s), CodeAxis::x, {.sigma_gray_levels = 0.5});
  // 0.4 periods are 8 px. The bits 0 .. 4 repeat beyond the end as the code mirrors: stripe 31 again, phase of a 17th
  // period.
  for (int y = 0; y < 300; ++y) {
    EXPECT_TRUE(map.valid(4, y));
    EXPECT_FALSE(map.valid(12, y));
  }
}

TEST(SummaryOf, HasTheMediansOfTheValidPixels) {
  FringeScene s = scene_of(5, 4, 2);
  s.along = 300;
  const PhaseMap map = decode_phase(render(s), CodeAxis::x, {.sigma_gray_levels = 1.0});
  const DecodeSummary summary = summary_of(map);
  EXPECT_EQ(summary.counts[0], 300u * 300u);
  // sigma / (sqrt(2) B) with B = 60; rounding to integers moves B by 0.35 at most.
  EXPECT_NEAR(*summary.median_u_phase_rad, 1 / (std::sqrt(2.0) * 60), 1e-4);
  EXPECT_NEAR(*summary.median_modulation, 60, 0.36);
  EXPECT_NEAR(*summary.median_u_pattern, 0.24 * *summary.median_u_phase_rad / (2 * std::numbers::pi), 1e-9);
}

TEST(Picture, InvalidPixelsAreGreyAndValidOnesAreNot) {
  FringeScene s = scene_of(5, 4, 2);
  s.along = 300;
  s.albedo = [](int, int a) { return a < 150 ? 1.0 : 0.0; };
  const auto picture = picture_of_phase(decode_phase(render(s), CodeAxis::x, {.sigma_gray_levels = 1.0}));
  const auto is_grey = [&](int x, int y) {
    return picture(x, y)[0] == picture(x, y)[1] && picture(x, y)[1] == picture(x, y)[2];
  };
  for (int x = 0; x < 300; x += 7) {
    EXPECT_FALSE(is_grey(x, 50));
    EXPECT_TRUE(is_grey(x, 200));
  }
}

}  // namespace
}  // namespace fringecal::decode

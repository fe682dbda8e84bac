// The corrections of the periodic phase errors, on the virtual scanner, against its truth.
#include "calib/linearise.h"

#include "core/file.h"
#include "tests/calib/alignment_frames.h"
#include "tests/calib/flat_board_truth.h"
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

namespace fringecal::calib {
namespace {

using decode::Correct;
using test::periodic_error;
using test::true_phase;
using ::testing::HasSubstr;

/// The table of an aligned instrument, from three flat stacks.
model::PhaseLinearisation table_of(const virt::VirtualScanner& instrument, std::uint64_t seed) {
  LinearisationFit fit(CodeAxis::x);
  for (std::uint64_t i = 0; i < 3; ++i) {
    const auto added = fit.add(instrument.capture(instrument.standard_scene("alignment"), {}, seed + i), "flat", "");
    if (!added) throw std::runtime_error(added.error().sentence);
  }
  // The phase's own ripple of 1 and 2 cycles after the modulation's was taken off: what the second order leaves.
  EXPECT_LE(fit.left_over_rad(), 0.5e-3);
  return fit.table();
}

// FRINGECAL_LONG=1: 12 instruments, else 2. The limit of 2 mrad is the one that was asked for. The flat stacks and the
// measured one have errors of their own, and the board stands elsewhere.
TEST(Corrections, LeaveTwoMilliradOfEachPeriodicErrorOnAFlatBoard) {
  const std::uint64_t seeds = std::getenv("FRINGECAL_LONG") ? 12 : 2;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const virt::VirtualScanner instrument("chen2008", seed, {.theta_mrad = 0.01});
    const auto table = table_of(instrument, 100 * seed);
    const auto scene = instrument.standard_scene("plane 0");
    const Capture capture = instrument.capture(scene, {}, 100 * seed + 50);
    const auto truth = true_phase(instrument, scene, {});
    const auto off = decode::decode_for_measuring(capture, CodeAxis::x, &table,
                                                  {.linearisation = Correct::no, .stack = Correct::no});
    const auto on = decode::decode_for_measuring(capture, CodeAxis::x, &table);
    const auto before = periodic_error(off.map, truth, {0, 0, 1392, 1040});
    const auto after = periodic_error(on.map, truth, {0, 0, 1392, 1040});
    Eigen::Vector3d worst = Eigen::Vector3d::Zero();
    double least_scatter = 10, most_scatter = 0;
    // 24 px of margin: the coded field ends at the picture's left, and the blur mixes its edge into a few columns.
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 4; ++i) {
        const auto tile = periodic_error(on.map, truth, {24 + 336 * i, 24 + 330 * j, 360 + 336 * i, 354 + 330 * j});
        worst = worst.cwiseMax(tile.amplitude_rad);
        least_scatter = std::min(least_scatter, tile.scatter);
        most_scatter = std::max(most_scatter, tile.scatter);
      }
    }
    const auto mrad = [](const Eigen::Vector3d& v) {
      return fmt::format("{:.2f} {:.2f} {:.2f}", 1e3 * v[0], 1e3 * v[1], 1e3 * v[2]);
    };
    fmt::print("seed {}: 1, 2, 4 cycles before {}, after {}, worst of 12 tiles {} mrad; scatter / u {:.4f} to {:.4f}\n",
               seed, mrad(before.amplitude_rad), mrad(after.amplitude_rad), mrad(worst), least_scatter, most_scatter);
    EXPECT_GT(before.amplitude_rad[2], 10e-3);
    EXPECT_LE(worst.maxCoeff(), 2e-3);
    // The reported noise is the scatter that is left, to 2 %.
    EXPECT_NEAR(least_scatter, 1.0, 0.02);
    EXPECT_NEAR(most_scatter, 1.0, 0.02);
    // And it is sigma / (sqrt(2) B), sigma^2 = 0.5 + 0.5 I / 127.5 of the preset and 1/12 of the digits.
    for (const int x : {200, 700, 1200}) {
      const double sigma = std::sqrt(0.5 + 0.5 * on.map.mean(x, 520) / 127.5 + 1.0 / 12.0);
      EXPECT_NEAR(on.map.u_phase_rad(x, 520) * std::sqrt(2.0) * off.map.modulation(x, 520) / sigma, 1.0, 0.02) << x;
    }
  }
}

TEST(Corrections, EachTakesAwayItsOwnErrorAndLeavesTheOther) {
  const virt::VirtualScanner instrument("chen2008", 2, {.theta_mrad = 0.01});
  const auto table = table_of(instrument, 200);
  const auto scene = instrument.standard_scene("plane 1");
  const Capture capture = instrument.capture(scene, {}, 251);
  const auto truth = true_phase(instrument, scene, {});
  const auto error = [&](Correct linearisation, Correct stack) {
    const auto map = decode::decode_for_measuring(capture, CodeAxis::x, &table, {linearisation, stack});
    return periodic_error(map.map, truth, {0, 0, 1392, 1040}).amplitude_rad;
  };
  const auto only_stack = error(Correct::no, Correct::yes), only_table = error(Correct::yes, Correct::no);
  EXPECT_LE(only_stack.head<2>().maxCoeff(), 0.5e-3);
  EXPECT_GT(only_stack[2], 10e-3);
  EXPECT_LE(only_table[2], 0.5e-3);
  EXPECT_GT(only_table.head<2>().maxCoeff(), 0.5e-3);
}

// Steps displaced by e_k: q = (i / 4) sum (-1)^k e_k to first order (stack_errors.h, eq. 2), here i 6.5 mrad. u = 0.01
// sqrt(2 / 46000) = 0.07 mrad of noise, and 0.3 mrad for the second order and the third harmonic.
TEST(StackErrors, ShowTheStepsOfEitherGratingWithFewOrManyBitsAlongEitherAxis) {
  for (const int bits : {5, 7, 10}) {
    for (const int stripes : {1, 2}) {
      for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
        test::GratingCase c{.gray_bits = bits, .stripes_per_period = stripes, .axis = axis};
        if (bits == 5 && stripes == 2) c.pixels_per_period = 60;
        const double e_mrad[4] = {10, -6, 3, -7};
        c.placement_mm.assign(static_cast<std::size_t>(bits + 4), 0.0);
        double expected_mrad = 0;
        for (int k = 0; k < 4; ++k) {
          c.placement_mm[static_cast<std::size_t>(bits + k)] = 1e-3 * e_mrad[k] * c.period_mm / (2 * std::numbers::pi);
          expected_mrad += (k % 2 == 0 ? 0.25 : -0.25) * e_mrad[k];
        }
        const Capture capture = test::misaligned_capture(c);
        const auto errors = decode::estimate_stack_errors(capture, decode::decode_phase(capture, axis));
        ASSERT_TRUE(errors) << errors.error().sentence;
        EXPECT_NEAR(1e3 * errors->ellipse.conjugate.imag(), expected_mrad, 0.5) << bits << " bits, " << stripes;
        EXPECT_NEAR(1e3 * errors->ellipse.conjugate.real(), 0.0, 0.5) << bits << " bits, " << stripes;
        EXPECT_NEAR(1e3 * std::abs(errors->ellipse.offset), 0.0, 0.7) << bits << " bits, " << stripes;
      }
    }
  }
}

TEST(StackErrors, AreRefusedWhereTooFewPixelsShowThem) {
  const Capture capture = test::misaligned_capture({.length = 60, .lines = 10});
  const auto errors = decode::estimate_stack_errors(capture, decode::decode_phase(capture, CodeAxis::x));
  ASSERT_FALSE(errors);
  EXPECT_THAT(errors.error().sentence, HasSubstr("pixels have a whole period"));
  const auto map = decode::decode_for_measuring(capture, CodeAxis::x, nullptr);
  EXPECT_FALSE(map.stack);
  EXPECT_FALSE(map.remarks.empty());
}

TEST(Corrections, ServeASceneThatIsMostlyEmptyAndOneWithABoldTexture) {
  const virt::VirtualScanner instrument("chen2008", 3, {.theta_mrad = 0.01});
  // The same stack errors for every scene, by the seed; the flat board tells them best.
  const auto errors = [&](const std::string& scene) {
    const Capture capture = instrument.capture(instrument.standard_scene(scene), {}, 77);
    return decode::estimate_stack_errors(capture, decode::decode_phase(capture, CodeAxis::x));
  };
  const auto flat = errors("plane 0");
  ASSERT_TRUE(flat);
  for (const char* scene : {"spheres 0", "cylinder 0", "calibration 3"}) {
    const auto other = errors(scene);
    ASSERT_TRUE(other) << scene << ": " << other.error().sentence;
    fmt::print("{}: {} pixels, off by {:.3f} and {:.3f} mrad\n", scene, other->n_pixels,
               1e3 * std::abs(other->ellipse.offset - flat->ellipse.offset),
               1e3 * std::abs(other->ellipse.conjugate - flat->ellipse.conjugate));
    // Half of the 2 mrad that were asked for; shading and silhouettes take part in it, not only noise.
    EXPECT_LE(std::abs(other->ellipse.offset - flat->ellipse.offset), 1e-3) << scene;
    EXPECT_LE(std::abs(other->ellipse.conjugate - flat->ellipse.conjugate), 1e-3) << scene;
  }
}

TEST(Linearisation, SurvivesTheScannerFileAndIsRefusedForAnotherGrating) {
  model::PhaseLinearisation table;
  table.period = 0.24;
  table.width_px = 40;
  table.height_px = 30;
  table.columns = 3;
  table.rows = 2;
  for (int i = 0; i < 6; ++i) {
    table.ripple_rad.emplace_back(1e-3 * i, -2e-3 * i);
    table.u_ripple_rad.push_back(1e-5);
  }
  table.fixed = {
      .offset = {1e-3, 2e-3}, .conjugate = {3e-3, 4e-3}, .u_offset = 1e-4, .u_conjugate = 2e-4, .third = -0.01};
  table.stacks = 3;
  table.inputs = {{"flat", "abc"}};
  const test::TemporaryFolder folder;
  write_atomically(folder.path() / "table.json", to_json(model::to_value(table)));
  Fields fields(read_json(folder.path() / "table.json"), "table.json");
  EXPECT_EQ(to_json(model::to_value(model::phase_linearisation_from(fields))), to_json(model::to_value(table)));
  // Bilinear: half-way between the four nodes of the first cell.
  EXPECT_NEAR(table.ripple_at(39.0 / 4, 29.0 / 2).real(), 1e-3 * (0 + 1 + 3 + 4) / 4, 1e-15);
  EXPECT_NEAR(table.ripple_at(39, 29).imag(), -10e-3, 1e-15);

  const virt::VirtualScanner instrument("chen2008", 1);
  const Capture capture = instrument.capture(instrument.standard_scene("plane 0"), {}, 1);
  EXPECT_THROW(decode::decode_for_measuring(capture, CodeAxis::x, &table), InputError);  // 40 x 30 pixels
  table.width_px = 1392;
  table.height_px = 1040;
  table.period = 0.3;
  EXPECT_THROW(decode::decode_for_measuring(capture, CodeAxis::x, &table), InputError);
}

TEST(Linearisation, RefusesACurvedScene) {
  const virt::VirtualScanner instrument("chen2008", 1, {.theta_mrad = 0.0});
  LinearisationFit fit(CodeAxis::x);
  const auto added = fit.add(instrument.capture(instrument.standard_scene("spheres 0"), {}, 1), "spheres", "");
  ASSERT_FALSE(added);
  EXPECT_THAT(added.error().sentence, HasSubstr("spheres: "));
}

}  // namespace
}  // namespace fringecal::calib

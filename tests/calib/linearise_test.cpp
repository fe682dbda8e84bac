// The corrections of the periodic phase errors, on the virtual scanner, against its truth.
#include "calib/linearise.h"

#include "tests/calib/flat_board_truth.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::calib {
namespace {

using test::periodic_error;
using test::true_phase;

TEST(Corrections, LeaveTwoMilliradOfEachPeriodicErrorOnAFlatBoard) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const virt::VirtualScanner instrument("chen2008", seed, {.theta_mrad = 0.01});
    const virt::InstrumentState state;
    LinearisationFit fit(CodeAxis::x);
    for (std::uint64_t i = 0; i < 3; ++i) {
      const auto added =
          fit.add(instrument.capture(instrument.standard_scene("alignment"), state, 100 * seed + i), "flat", "");
      ASSERT_TRUE(added) << added.error().sentence;
    }
    const auto table = fit.table();
    const auto scene = instrument.standard_scene("plane 0");
    const Capture capture = instrument.capture(scene, state, 100 * seed + 50);
    const auto truth = true_phase(instrument, scene, state);
    const auto off =
        decode::decode_for_measuring(capture, CodeAxis::x, &table, {decode::Correct::no, decode::Correct::no});
    const auto only_table =
        decode::decode_for_measuring(capture, CodeAxis::x, &table, {decode::Correct::yes, decode::Correct::no});
    const auto only_stack =
        decode::decode_for_measuring(capture, CodeAxis::x, &table, {decode::Correct::no, decode::Correct::yes});
    const auto on = decode::decode_for_measuring(capture, CodeAxis::x, &table);
    fmt::print("seed {} left over {:.3f} mrad, sd {:.2f} {:.2f}; {}\n", seed, 1e3 * fit.left_over_rad(),
               1e3 * table.sd_offset, 1e3 * table.sd_conjugate, decode::words_for(on));
    for (const auto* m : {&off, &only_table, &only_stack, &on}) {
      Eigen::Vector3d worst = Eigen::Vector3d::Zero();
      for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 4; ++i) {
          worst = worst.cwiseMax(periodic_error(m->map, truth, {348 * i, 346 * j, 348 * (i + 1), 346 * (j + 1)}));
        }
      }
      const Eigen::Vector3d all = periodic_error(m->map, truth, {0, 0, 1392, 1040});
      fmt::print("  all {:.2f} {:.2f} {:.2f}  worst tile {:.2f} {:.2f} {:.2f} mrad\n", 1e3 * all[0], 1e3 * all[1],
                 1e3 * all[2], 1e3 * worst[0], 1e3 * worst[1], 1e3 * worst[2]);
      if (m == &on) {
        EXPECT_LE(worst.maxCoeff(), 2e-3);
      }
    }
  }
}

}  // namespace
}  // namespace fringecal::calib

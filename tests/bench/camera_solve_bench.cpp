// A camera from views of a board, k1 and k2, set-up and start included: ours, mrcal (k1, k2, p1, p2: it has no radial
// model) and cv::calibrateCamera (its default of 30 iterations), side by side. px_from_tight: how far our solution's corners
// lie at most from those of a solve to the rounding (tests/calib/tight_camera_solve.h).
// Then how a calibration grows with the number of boards: the camera alone (100 corners each), and the whole scanner
// (63 corners each, with their phases); items per second are boards per second.
#include "calib/calibrate.h"
#include "calib/other_solvers.h"
#include "tests/calib/synthetic_board_views.h"
#include "tests/calib/tight_camera_solve.h"

#include <benchmark/benchmark.h>

#include <cstdlib>
#include <opencv2/core/utility.hpp>

namespace fringecal {
namespace {

struct Size {
  int boards, side;
  double pitch_mm;
};
Size size_of(const benchmark::State& state) { return state.range(0) == 20 ? Size{20, 10, 22.0} : Size{100, 20, 11.0}; }
std::vector<calib::PlanarView> views_of(const Size& s) {
  return test::planar_views(s.boards, s.side, s.side, s.pitch_mm, 0.1);
}

void BM_Ours(benchmark::State& state) {
  const auto views = views_of(size_of(state));
  ::setenv("FRINGECAL_THREADS", state.range(1) == 1 ? "1" : "2", 1);
  for (auto _ : state) {
    auto found = calib::solve_camera(views, 1392, 1040, {});
    if (!found) state.SkipWithError(found.error().sentence.c_str());
    benchmark::DoNotOptimize(found);
  }
  const auto found = calib::solve_camera(views, 1392, 1040, {});
  const auto tight = test::tight_camera_solve(views, 1392, 1040);
  if (found && tight) state.counters["px_from_tight"] = test::distance_px(*found, *tight, views);
}
void BM_Mrcal(benchmark::State& state) {
  const Size s = size_of(state);
  const auto views = views_of(s);
  cv::setNumThreads(static_cast<int>(state.range(1)));
  for (auto _ : state) {
    auto found = calib::solve_with_mrcal(views, 1392, 1040, calib::DistortionTerms::radial_tangential);
    benchmark::DoNotOptimize(found);
  }
}
void BM_OpenCv(benchmark::State& state) {
  const auto views = views_of(size_of(state));
  cv::setNumThreads(static_cast<int>(state.range(1)));
  for (auto _ : state) {
    auto found = calib::solve_with_opencv(views, 1392, 1040, calib::DistortionTerms::radial, 30);
    benchmark::DoNotOptimize(found);
  }
}
// Arguments: boards (20 of 100 corners, 100 of 400), threads.
#define FRINGECAL_SIZES \
  ->Args({20, 1})->Args({20, 2})->Args({100, 1})->Args({100, 2})->Unit(benchmark::kMillisecond)->UseRealTime()
BENCHMARK(BM_Ours) FRINGECAL_SIZES;
BENCHMARK(BM_Mrcal) FRINGECAL_SIZES;
BENCHMARK(BM_OpenCv) FRINGECAL_SIZES;

void BM_CameraGrowth(benchmark::State& state) {
  const auto views = test::planar_views(static_cast<int>(state.range(0)), 10, 10, 22.0, 0.1);
  ::setenv("FRINGECAL_THREADS", "1", 1);
  for (auto _ : state) {
    auto found = calib::solve_camera(views, 1392, 1040, {});
    if (!found) state.SkipWithError(found.error().sentence.c_str());
    benchmark::DoNotOptimize(found);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
void BM_ScannerGrowth(benchmark::State& state) {
  const model::Board board = test::known_board();
  const auto seen = test::views(test::known_scanner(), board, static_cast<int>(state.range(0)), {});
  ::setenv("FRINGECAL_THREADS", "1", 1);
  for (auto _ : state) {
    auto found = calib::calibrate(seen, board, 1392, 1040, test::known_plan(), {});
    if (!found) state.SkipWithError(found.error().sentence.c_str());
    benchmark::DoNotOptimize(found);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_CameraGrowth)->RangeMultiplier(2)->Range(10, 320)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ScannerGrowth)->RangeMultiplier(2)->Range(5, 80)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fringecal

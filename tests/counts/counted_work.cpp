// One fixed piece of work whose instructions are counted (check_count.cmake): counted_work decode|reconstruct|fit|solve.
// What is made up before it does not count. Vectors of one width on every x86 machine: SSE4.
#include "calib/camera_solve.h"
#include "calib/decode/decode.h"
#include "fitting/fit.h"
#include "metrology/reconstruct.h"
#include "tests/calib/synthetic_board_views.h"
#include "tests/calib/synthetic_fringes.h"
#include "tests/metrology/exact_phase_map.h"

#include <hwy/targets.h>

#include <cstdio>
#include <functional>
#include <string>

/// The name that callgrind is told.
extern "C" __attribute__((noinline)) void counted_work(const std::function<void()>* work) { (*work)(); }

namespace fringecal {
namespace {

std::function<void()> prepared(const std::string& name) {
  if (name == "decode") {  // 11 frames, noise estimated, all maps
    test::FringeScene s;
    s.code = {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
    s.start = 0.5;
    s.read_sd = 1.0;
    return [capture = test::render(s)] { decode::decode_phase(capture, CodeAxis::x); };
  }
  if (name == "reconstruct") {  // tables, points, edges, normals
    return [map = test::exact_map(test::sample_scanner(), test::sphere({10, 5, 30}, 60))] {
      metrology::reconstruct(map, test::sample_scanner());
    };
  }
  if (name == "fit") {  // a sphere, robust
    std::vector<Eigen::Vector3d> points;
    std::mt19937_64 random(7);
    const auto part = [&] { return static_cast<double>(random() >> 11) * 0x1p-52 - 1.0; };
    for (int i = 0; i < 20000; ++i) {
      const Eigen::Vector3d direction = Eigen::Vector3d(part(), part(), 1.0).normalized();
      points.push_back(Eigen::Vector3d(10, 20, 1000) + (25 + 0.03 * part()) * direction);
    }
    return [points] {
      (void)fitting::fit_sphere(points);
      (void)fitting::fit_sphere(points, {.rejection = fitting::Rejection::robust});
    };
  }
  if (name == "solve") {  // a camera from 20 boards of 100 corners
    return [views = test::planar_views(20, 10, 10, 22.0, 0.1)] { (void)calib::solve_camera(views, 1392, 1040, {}); };
  }
  return {};
}

}  // namespace
}  // namespace fringecal

int main(int argc, char** argv) {
  const auto work = fringecal::prepared(argc > 1 ? argv[1] : "");
  if (!work) {
    std::fprintf(stderr, "counted_work decode|reconstruct|fit|solve\n");
    return 2;
  }
#ifdef HWY_SSE4
  if (hwy::SupportedTargets() & HWY_SSE4) {
    hwy::SetSupportedTargetsForTest(HWY_SSE4);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
#endif
  counted_work(&work);
  return 0;
}

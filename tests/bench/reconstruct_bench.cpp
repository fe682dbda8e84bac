// Phase map -> points with their uncertainty, in points per second, beside one pixel after the other (triangulate(),
// central differences), and its growth from 0.3 to 50 megapixels; memory beyond the map and the rays.
//   bench_reconstruct [rounds]      FRINGECAL_THREADS=1 or 2
#include "calib/model/triangulate.h"
#include "calib/model/triangulate_span.h"
#include "core/parallel.h"
#include "metrology/reconstruct.h"
#include "tests/bench/timing.h"
#include "tests/metrology/exact_phase_map.h"

#include <fmt/format.h>

#include <cstdlib>
#include <fstream>

namespace fringecal::bench {
namespace {

/// The sample scanner with a camera of another size on the same field.
model::Scanner scanner_of(int width, int height) {
  model::Scanner s = test::sample_scanner();
  const double scale = width / 320.0;
  model::Camera& c = s.camera;
  c.width_px = width;
  c.height_px = height;
  c.fx_px *= scale, c.fy_px *= scale, c.cx_px *= scale, c.cy_px *= scale;
  return s;
}

long peak_kb() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    long kb = 0;
    if (word == "VmHWM:" && status >> kb) return kb;
  }
  return 0;
}

void one_size(int width, int height, int rounds, bool peers) {
  const model::Scanner scanner = scanner_of(width, height);
  const auto map = test::exact_map(scanner, test::plane({0, 0, 10}, Eigen::Vector3d(0.1, 0.05, 1).normalized()));
  const auto pixels = static_cast<double>(map.validity.size());
  metrology::Reconstructor reconstruct(scanner);
  metrology::Reconstruction cloud, with_normals;
  {
    std::ofstream("/proc/self/clear_refs") << "5";  // resets the high-water mark
  }
  const long before = peak_kb();
  cloud = reconstruct(map, {.normals = false}, std::move(cloud));
  const double mb = static_cast<double>(peak_kb() - before) / 1024.0;
  std::vector<Contender> contenders{
      {"points, edges left out", [&] { cloud = reconstruct(map, {.normals = false}, std::move(cloud)); }},
  };
  if (peers) {
    contenders.push_back(
        {"the same with normals", [&] { with_normals = reconstruct(map, {}, std::move(with_normals)); }});
    std::vector<Eigen::Vector3d> points(map.validity.size());
    std::vector<double> slopes(points.size());
    auto task = model::span_task(scanner.projector, scanner.proj_from_cam, CodeAxis::x);
    const auto rays = std::make_shared<model::RayTable>(model::ray_table(scanner.camera));
    task.ray_x = rays->x.data();
    task.ray_y = rays->y.data();
    task.phase_rad = map.phase_rad.data();
    contenders.push_back(
        {"triangulation alone", [=, &map, points = std::move(points), slopes = std::move(slopes)]() mutable {
           auto t = task;
           t.points_mm = points.data();
           t.du_per_mm = slopes.data();
           (void)rays;
           parallel_for(map.height(), [&](int y) {
             model::triangulate_span(t, map.validity.index(0, y), static_cast<std::size_t>(map.width()));
           });
         }});
    contenders.push_back({"one pixel after the other", [&] {
                            parallel_for(map.height(), [&](int y) {
                              double sum = 0;
                              for (int x = 0; x < map.width(); ++x) {
                                const auto p =
                                    model::triangulate(scanner.camera, scanner.projector, scanner.proj_from_cam,
                                                       CodeAxis::x, Eigen::Vector2d(x, y), map.u_at(x, y));
                                if (!p) continue;
                                const auto slope = model::du_per_mm(scanner.projector, scanner.proj_from_cam,
                                                                    CodeAxis::x, *p, Eigen::Vector3d(p->normalized()));
                                sum += slope.value_or(0.0);
                              }
                              volatile double keep = sum;
                              (void)keep;
                            });
                          }});
  }
  const bool one = thread_count() == 1;
  race(contenders, rounds, one ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC);
  const double megabytes = static_cast<double>(cloud.cloud.points.size() * sizeof(metrology::CloudPoint)) / 1048576.0;
  fmt::print("  {} x {} on {} thread(s), {}; {:.0f} MB of points, {:.2f} times as much at the peak of the first\n",
             width, height, thread_count(), one ? "processor time" : "clock", megabytes, mb / megabytes);
  for (const Contender& c : contenders) {
    const double ms = median(c.times_ms);
    fmt::print("    {:<30}{:>10.2f} ms{:>8.1f} million pixels per second{:>8.2f} x\n", c.name, ms, pixels / ms / 1e3,
               ms / median(contenders[0].times_ms));
  }
  std::fflush(stdout);
}

}  // namespace
}  // namespace fringecal::bench

int main(int argc, char** argv) {
  const int rounds = argc > 1 && std::atoi(argv[1]) > 0 ? std::atoi(argv[1]) : 9;
  fringecal::bench::one_size(1392, 1040, rounds, true);
  for (const auto& [width, height] : {std::pair{640, 480}, {2592, 1944}, {8192, 6144}}) {
    fringecal::bench::one_size(width, height, 3, false);
  }
  return 0;
}

// Ours beside its peers: one run, one thread each, the same points; the peers are given the true surface disturbed by
// 1 % as their start, ours nothing. Medians of repeats, in milliseconds of this thread's processor time, which other
// programs on the machine disturb less than the clock on the wall. Ours gives the distance of every point and marks the
// rejected, the peers give the surface alone; CGAL's plane is compared with ours without distances. Also: two threads against one, and the memory.
//   bench_peers [repeats] [plane | sphere | cylinder | threads]
#include "fitting/fit.h"
#include "tests/bench/peers.h"

#include <fmt/format.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <vector>

namespace fringecal::bench {
namespace {

using fitting::DistancesWanted;
using fitting::Points;
using fitting::Rejection;

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

double median_ms(int repeats, const std::function<void()>& work) {
  std::vector<double> times;
  double total = 0;
  for (int i = 0; i < repeats && (i < 3 || total < 4000.0); ++i) {
    const double start = cpu_ms();
    work();
    times.push_back(cpu_ms() - start);
    total += times.back();
  }
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
  return times[times.size() / 2];
}

/// The bound of every fit: the points read once, with as many sums as hide the latency of an addition.
double reading_ms(const Cloud& cloud, int repeats) {
  double sums[12] = {};
  const double ms = median_ms(repeats, [&] {
    const double* p = cloud[0].data();
    for (std::size_t i = 0; i + 12 <= 3 * cloud.size(); i += 12) {
      for (std::size_t k = 0; k < 12; ++k) sums[k] += p[i + k];
    }
  });
  volatile double keep = sums[0] + sums[5] + sums[11];
  (void)keep;
  return ms;
}

void row(const std::string& name, double ms, double ours_ms, double error_mm) {
  fmt::print("    {:<34}{:>10.3f} ms{:>9.1f} x   {:.1e} mm\n", name, ms, ms / ours_ms, error_mm);
}

Cloud contaminated(Cloud cloud) {
  std::mt19937_64 random(8);
  Eigen::Vector3d low = cloud[0], high = cloud[0];
  for (const auto& p : cloud) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  std::uniform_real_distribution<double> part(-0.25, 1.25);
  for (std::size_t i = 0; i < cloud.size(); i += 20) {
    const Eigen::Vector3d u{part(random), part(random), part(random)};
    cloud[i] = low + u.cwiseProduct(high - low);
  }
  return cloud;
}

/// The sphere's figures that peers and ours share: centre and radius; for a cylinder a point, direction and radius.
double deviation(Shape shape, const Answer& a, const Answer& b) {
  if (shape == Shape::plane) return std::abs(b.direction.dot(a.place - b.place));
  if (shape == Shape::sphere) return std::max((a.place - b.place).norm(), std::abs(a.radius - b.radius));
  return std::max(b.direction.cross(a.place - b.place).norm(), std::abs(a.radius - b.radius));
}

Answer ours(Shape shape, const Cloud& cloud, Rejection rejection, DistancesWanted wanted = DistancesWanted::all) {
  const fitting::FitOptions options{.rejection = rejection, .distances = wanted};
  if (shape == Shape::plane) {
    const auto fit = fitting::fit_plane(cloud, options);
    return fit ? Answer{fit->point_mm, fit->normal, 0} : Answer{};
  }
  if (shape == Shape::sphere) {
    const auto fit = fitting::fit_sphere(cloud, options);
    return fit ? Answer{fit->center_mm, {}, 0.5 * fit->diameter_mm} : Answer{};
  }
  const auto fit = fitting::fit_cylinder(cloud, options);
  return fit ? Answer{fit->axis_point_mm, fit->axis_direction, 0.5 * fit->diameter_mm} : Answer{};
}

void compare(Shape shape, const Cloud& cloud, const Cloud& inliers, Rejection rejection, int repeats) {
  const Answer best = ours(shape, inliers, Rejection::none);
  const Answer start = disturbed(shape);
  Answer answer;
  const double our_ms = median_ms(std::max(repeats, 9), [&] { answer = ours(shape, cloud, rejection); });
  row("fringecal", our_ms, our_ms, deviation(shape, answer, best));
  double compared_ms = our_ms;
  if (shape == Shape::plane && rejection == Rejection::none) {
    // What CGAL gives too: the plane and how good it is (CGAL: a ratio of variances; ours: scatter and uncertainties).
    compared_ms =
        median_ms(std::max(repeats, 9), [&] { answer = ours(shape, cloud, rejection, DistancesWanted::none); });
    row("fringecal, no distances written", compared_ms, compared_ms, deviation(shape, answer, best));
  }
  for (const Peer& peer : peers(shape, rejection == Rejection::robust)) {
    const double ms = median_ms(repeats, [&] { answer = peer.fit(cloud, start); });
    row(peer.name, peer.reported_ms ? *peer.reported_ms : ms, compared_ms, deviation(shape, answer, best));
  }
}

long resident_kb() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word == "VmHWM:") {
      long kb = 0;
      status >> kb;
      return kb;
    }
  }
  return 0;
}

void threads_and_memory(Shape shape) {
  const Cloud cloud = points_of(shape, 1000000);
  {
    std::ofstream("/proc/self/clear_refs") << "5";  // resets the high-water mark
  }
  const long before = resident_kb();
  ours(shape, cloud, Rejection::none);
  const long after = resident_kb();
  std::vector<double> times;
  for (int i = 0; i < 15; ++i) {
    const auto start = std::chrono::steady_clock::now();
    ours(shape, cloud, Rejection::none);
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  std::sort(times.begin(), times.end());
  fmt::print(
      "  {:<10} 1000000 points on {} threads: median {:.2f} ms, fastest {:.2f} ms (clock); {:.1f} MB beyond the "
      "points\n",
      name_of(shape), std::getenv("FRINGECAL_THREADS") ? std::getenv("FRINGECAL_THREADS") : "all",
      times[times.size() / 2], times.front(), static_cast<double>(after - before) / 1024.0);
}

}  // namespace
}  // namespace fringecal::bench

int main(int argc, char** argv) {
  using namespace fringecal::bench;
  using fringecal::fitting::Rejection;
  const int repeats = argc > 1 && std::atoi(argv[1]) > 0 ? std::atoi(argv[1]) : 5;
  const std::string only = argc > 2 ? argv[2] : "";
  if (only == "threads") {
    for (const Shape shape : {Shape::plane, Shape::sphere, Shape::cylinder}) threads_and_memory(shape);
    return 0;
  }
  setenv("FRINGECAL_THREADS", "1", 1);  // before the first fit reads it
  fmt::print("{}", peers_left_out());
  for (const Shape shape : {Shape::plane, Shape::sphere, Shape::cylinder}) {
    if (!only.empty() && only != name_of(shape)) continue;
    for (const std::size_t n : {10000u, 100000u, 1000000u}) {
      const Cloud clean = points_of(shape, n);
      fmt::print("  {} of {} points{:>24}{:>12}   from the optimum\n", name_of(shape), n, "time", "ratio");
      fmt::print("    {:<34}{:>10.3f} ms\n", "reading the points once", reading_ms(clean, std::max(repeats, 9)));
      compare(shape, clean, clean, Rejection::none, repeats);
      const Cloud dirty = contaminated(clean);
      Cloud inliers;
      for (std::size_t i = 0; i < n; ++i) {
        if (i % 20 != 0) inliers.push_back(clean[i]);
      }
      fmt::print("  the same with 5 % outliers\n");
      compare(shape, dirty, inliers, Rejection::robust, repeats);
      std::fflush(stdout);
    }
  }
  return 0;
}

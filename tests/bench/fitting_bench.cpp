// How the fits grow: 1e3 to 1e7 points on a sector with noise; items per second are points per second.
#include "fitting/fit.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <random>
#include <vector>

namespace fringecal::fitting {
namespace {

enum class Shape { plane, sphere, cylinder };

std::vector<Eigen::Vector3d> points_of(Shape shape, std::size_t n) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> part(-1.0, 1.0);
  std::normal_distribution<double> noise(0.0, 0.03);
  std::vector<Eigen::Vector3d> out;
  out.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double a = part(random), b = part(random), d = noise(random);
    switch (shape) {
      case Shape::plane:
        out.emplace_back(200 * a, 150 * b, 1000 + d);
        break;
      case Shape::sphere: {
        const Eigen::Vector3d direction = Eigen::Vector3d(a, b, 1.0).normalized();
        out.push_back(Eigen::Vector3d(10, 20, 1000) + (25 + d) * direction);
        break;
      }
      case Shape::cylinder:
        out.emplace_back((60 + d) * std::sin(a), 100 * b, 1000 + (60 + d) * std::cos(a));
        break;
    }
  }
  return out;
}

template <class Fit>
void run(benchmark::State& state, Shape shape, Fit fit) {
  const auto points = points_of(shape, static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) benchmark::DoNotOptimize(fit(points));
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

void BM_Plane(benchmark::State& state) {
  run(state, Shape::plane, [](Points p) { return fit_plane(p); });
}
void BM_Sphere(benchmark::State& state) {
  run(state, Shape::sphere, [](Points p) { return fit_sphere(p); });
}
void BM_Cylinder(benchmark::State& state) {
  run(state, Shape::cylinder, [](Points p) { return fit_cylinder(p); });
}
BENCHMARK(BM_Plane)->RangeMultiplier(10)->Range(1000, 10000000)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Sphere)->RangeMultiplier(10)->Range(1000, 10000000)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Cylinder)->RangeMultiplier(10)->Range(1000, 10000000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fringecal::fitting

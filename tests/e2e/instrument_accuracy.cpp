#include "tests/e2e/instrument_accuracy.h"

#include "calib/decode/corrections.h"
#include "cli/virtual_verification.h"
#include "metrology/acceptance.h"
#include "metrology/artefact.h"
#include "metrology/reconstruct.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <stdexcept>

namespace fringecal::test {
namespace {

using metrology::ArtefactKind;
using metrology::ArtefactMeasurement;

struct Measured {
  decode::PhaseMap map;
  metrology::PointCloud cloud;
};

Measured measured(const cli::VirtualVerification& v, const model::Scanner& scanner, const std::string& plan,
                  const std::string& scene, int place, int again = 0) {
  const auto& table = scanner.linearisation;
  auto map = decode::decode_for_measuring(v.capture(plan, fmt::format("{} {}", scene, place), 1, again), CodeAxis::x,
                                          table ? &*table : nullptr)
                 .map;
  auto cloud = metrology::reconstruct(map, scanner, {.normals = false}).cloud;
  return {std::move(map), std::move(cloud)};
}

double true_length(const Value& truth, const std::string& name) {
  const Value* artefact = truth.find("artefacts")->find(name);
  return *artefact->find(name == "bar" ? "distance_mm" : "diameter_mm")->if_real();
}

/// The cloud's points behind a measurement's kept ones: both are row by row.
std::vector<const metrology::CloudPoint*> behind(const metrology::PointCloud& cloud, const ArtefactMeasurement& m) {
  std::vector<const metrology::CloudPoint*> out;
  for (const auto& p : cloud.points) {
    if (out.size() < m.points_mm.size() && p.position_mm == m.points_mm[out.size()]) out.push_back(&p);
  }
  if (out.size() != m.points_mm.size()) throw std::logic_error("kept points are not in the order of the cloud");
  return out;
}

struct Deviations {
  std::vector<double> along_normal;  // signed
  std::vector<Eigen::Vector3d> normals;
};

Deviations deviations_of(const ArtefactMeasurement& m) {
  Deviations out;
  if (m.kind == ArtefactKind::plane) {
    const auto fit = fitting::fit_plane(m.points_mm);
    out.along_normal.assign(fit->quality.distances_mm.begin(), fit->quality.distances_mm.end());
    out.normals.assign(m.points_mm.size(), fit->normal);
    return out;
  }
  const bool sphere = m.kind == ArtefactKind::sphere;
  Eigen::Vector3d place, axis = Eigen::Vector3d::Zero();
  if (sphere) {
    const auto fit = fitting::fit_sphere(m.points_mm);
    out.along_normal.assign(fit->quality.distances_mm.begin(), fit->quality.distances_mm.end());
    place = fit->center_mm;
  } else {
    const auto fit = fitting::fit_cylinder(m.points_mm);
    out.along_normal.assign(fit->quality.distances_mm.begin(), fit->quality.distances_mm.end());
    place = fit->axis_point_mm;
    axis = fit->axis_direction;
  }
  for (const auto& p : m.points_mm) {
    const Eigen::Vector3d d = p - place;
    out.normals.push_back((d - d.dot(axis) * axis).normalized());
  }
  return out;
}

/// Eq. 1.
double bound_of(const std::vector<const metrology::CloudPoint*>& points, const Deviations& deviations,
                const Eigen::Vector3d& camera) {
  double squares = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d ray = (points[i]->position_mm - camera).normalized();
    const double u = points[i]->u_along_ray_mm * ray.dot(deviations.normals[i]);
    squares += u * u / static_cast<double>(points.size());
  }
  return std::sqrt(squares);
}

/// Eq. 2.
double ripple_of(const std::vector<const metrology::CloudPoint*>& points, const Deviations& deviations,
                 const decode::PhaseMap& map, ArtefactKind kind) {
  const int columns = kind == ArtefactKind::plane ? 4 : 1, rows = kind == ArtefactKind::plane ? 3 : 1;
  struct Tile {
    std::array<std::complex<double>, 4> sums{};
    double n = 0;
  };
  std::vector<Tile> tiles(static_cast<std::size_t>(columns * rows));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int x = points[i]->pixel_x, y = points[i]->pixel_y;
    auto& tile = tiles[static_cast<std::size_t>(y * rows / map.height() * columns + x * columns / map.width())];
    for (std::size_t h = 0; h < 4; ++h) {
      tile.sums[h] += std::polar(deviations.along_normal[i], -static_cast<double>(h + 1) * map.phase_rad(x, y));
    }
    ++tile.n;
  }
  double largest = 0;
  for (const auto& tile : tiles) {
    if (tile.n < 1000) continue;  // a tile that the surface barely touches says nothing but noise
    for (const auto& sum : tile.sums) largest = std::max(largest, 2 * std::abs(sum) / tile.n);
  }
  return largest;
}

class MeanOfBoards {
 public:
  MeanOfBoards(int width, int height) : sum_(width, height, 0.0), count_(width, height, 0) {}

  void add(const std::vector<const metrology::CloudPoint*>& points, const Deviations& deviations) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      sum_(points[i]->pixel_x, points[i]->pixel_y) += deviations.along_normal[i];
      ++count_(points[i]->pixel_x, points[i]->pixel_y);
    }
    ++n_;
  }

  /// Eq. 3: over the pixels that every board has.
  double flatness() const {
    constexpr int kBlock = 32;
    double low = 0, high = 0;
    for (int y0 = 0; y0 + kBlock <= sum_.height(); y0 += kBlock) {
      for (int x0 = 0; x0 + kBlock <= sum_.width(); x0 += kBlock) {
        double sum = 0;
        int n = 0;
        for (int y = y0; y < y0 + kBlock; ++y) {
          for (int x = x0; x < x0 + kBlock; ++x) {
            if (count_(x, y) != n_) continue;
            sum += sum_(x, y) / n_;
            ++n;
          }
        }
        if (n < kBlock * kBlock / 2) continue;
        low = std::min(low, sum / n);
        high = std::max(high, sum / n);
      }
    }
    return high - low;
  }

 private:
  Image<double> sum_;
  Image<int> count_;
  int n_ = 0;
};

void add_scene(InstrumentAccuracy& out, const cli::VirtualVerification& v, const model::Scanner& scanner,
               const std::string& scene, const std::vector<metrology::NominalArtefact>& nominals, int repeats) {
  const Eigen::Vector3d camera = scanner.world_from_cam().translation_mm;
  std::vector<ArtefactAccuracy> found;
  for (const auto& nominal : nominals) found.push_back({.name = nominal.name});
  MeanOfBoards mean(scanner.camera.width_px, scanner.camera.height_px);
  for (int r = 0; r < repeats; ++r) {
    const auto one = measured(v, scanner, "paper", scene, r);
    const auto artefacts = metrology::measure_artefacts(one.cloud, scanner, nominals);
    if (!artefacts) throw std::runtime_error(scene + ": " + artefacts.error().sentence);
    for (std::size_t k = 0; k < nominals.size(); ++k) {
      const auto& m = (*artefacts)[k];
      auto& a = found[k];
      const auto points = behind(one.cloud, m);
      const auto deviations = deviations_of(m);
      if (m.kind == ArtefactKind::plane) mean.add(points, deviations);
      a.worst_form_sd_mm = std::max(a.worst_form_sd_mm, m.form_standard_deviation_mm);
      a.worst_sd_over_bound =
          std::max(a.worst_sd_over_bound, m.form_standard_deviation_mm / bound_of(points, deviations, camera));
      a.ripple_mm = std::max(a.ripple_mm, ripple_of(points, deviations, one.map, m.kind));
      if (m.diameter_mm) a.mean_diameter_error_mm = a.mean_diameter_error_mm.value_or(0) + *m.diameter_mm / repeats;
    }
  }
  for (auto& a : found) {
    if (a.mean_diameter_error_mm) *a.mean_diameter_error_mm -= true_length(v.truth(), a.name);
    out.artefacts.push_back(a);
  }
  if (nominals.front().kind == ArtefactKind::plane) out.flatness_of_mean_mm = mean.flatness();
}

void add_bars(InstrumentAccuracy& out, const cli::VirtualVerification& v, const model::Scanner& scanner, int bars) {
  auto plan = metrology::read_plan("vdi2634-2");
  auto& series = plan.series.at(1);
  series.captures = bars * series.captures_per_position;
  series.quantities.push_back({metrology::Measurand::diameter_error, "PS", "probing error, size", {}});
  std::vector<metrology::CaptureResult> results;
  for (int i = 0; i < series.captures; ++i) {
    const auto one =
        measured(v, scanner, "bars", series.scene, series.position_of(i), i % series.captures_per_position);
    auto result = metrology::evaluate_capture(plan, series, i, v.gauges(), one.cloud, scanner);
    if (!result) throw std::runtime_error("ball bar: " + result.error().sentence);
    results.push_back(*std::move(result));
  }
  const auto gauge = metrology::gauge_named(v.gauges(), series.artefacts.front());
  for (const auto& q : metrology::evaluate_series(plan, series, v.gauges(), results, {.monte_carlo_trials = 0})) {
    if (!q.u_of_later_measurements) continue;  // a form
    const bool distance = q.symbol == "SD", first = q.position.ends_with("A");
    const double certified = distance ? *gauge.distance_mm : gauge.diameter_mm[first ? 0 : 1];
    const double truth = true_length(v.truth(), distance ? "bar" : first ? "bar_a" : "bar_b");
    out.lengths.push_back(
        {q.symbol, q.value, q.uncertainty.U, q.value + certified - truth, *q.u_of_later_measurements});
  }
}

}  // namespace

InstrumentAccuracy accuracy_of(const std::filesystem::path& commissioning, int repeats, int bars) {
  const cli::VirtualVerification v(commissioning);
  const auto scanner = model::read_scanner(v.scanner_file());
  InstrumentAccuracy out;
  add_scene(out, v, scanner, "plane", {{"plane", ArtefactKind::plane, 0}}, repeats);
  add_scene(out, v, scanner, "spheres",
            {{"sphere50", ArtefactKind::sphere, 50},
             {"sphere38", ArtefactKind::sphere, 38},
             {"sphere30", ArtefactKind::sphere, 30}},
            repeats);
  add_scene(out, v, scanner, "cylinder", {{"cylinder", ArtefactKind::cylinder, 119.85}}, repeats);
  add_bars(out, v, scanner, bars);
  return out;
}

}  // namespace fringecal::test

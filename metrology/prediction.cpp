#include "metrology/prediction.h"

#include "core/parallel.h"
#include "fitting/fit.h"
#include "metrology/multi_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace fringecal::metrology {
namespace {

constexpr double kFlatHalfWidth_mm = 100, kFlatHalfHeight_mm = 70, kCylinderHalfLength_mm = 100;
constexpr double kStepHalfWidth_mm = 30, kStepHalfHeight_mm = 40;  // of each of its planes, which lie side by side

/// An ideal surface where it stands.
struct Placed {
  ArtefactKind kind = ArtefactKind::sphere;
  double diameter = 0;
  Rigid3 world_from_part;
  double half_width = kFlatHalfWidth_mm, half_height = kFlatHalfHeight_mm;  // of a plane

  struct Hit {
    double way;
    Eigen::Vector3d normal;
  };
  std::optional<Hit> hit(const Eigen::Vector3d& from, const Eigen::Vector3d& along) const {
    const Rigid3 part_from_world = world_from_part.inverse();
    const Eigen::Vector3d o = part_from_world * from, d = part_from_world.rotation * along;
    if (kind == ArtefactKind::plane) {
      const double way = -o.z() / d.z();
      const Eigen::Vector3d p = o + way * d;
      if (!(way > 0) || std::abs(p.x()) > half_width || std::abs(p.y()) > half_height) return std::nullopt;
      return Hit{way, world_from_part.rotation * Eigen::Vector3d(0, 0, d.z() < 0 ? 1 : -1)};
    }
    Eigen::Vector3d across(1, 1, kind == ArtefactKind::sphere ? 1 : 0);
    const Eigen::Vector3d oc = o.cwiseProduct(across), dc = d.cwiseProduct(across);
    const double a = dc.squaredNorm(), b = oc.dot(dc), c = oc.squaredNorm() - 0.25 * diameter * diameter;
    const double root = b * b - a * c;
    if (!(root > 0)) return std::nullopt;
    const double way = (-b - std::sqrt(root)) / a;
    const Eigen::Vector3d p = o + way * d;
    if (!(way > 0) || (kind == ArtefactKind::cylinder && std::abs(p.z()) > kCylinderHalfLength_mm)) return std::nullopt;
    return Hit{way, world_from_part.rotation * p.cwiseProduct(across).normalized()};
  }
};

Rigid3 pose_of(const std::array<double, 6>& place) {
  return {rotation_from_vector(std::numbers::pi / 180 * Eigen::Vector3d(place[3], place[4], place[5])),
          Eigen::Vector3d(place[0], place[1], place[2])};
}

void add_placed(const Gauge& gauge, const Rigid3& pose, std::vector<Placed>& out) {
  if (gauge.kind == GaugeKind::flat) {
    out.push_back({ArtefactKind::plane, 0, pose});
  } else if (gauge.kind == GaugeKind::step) {
    for (const int part : {0, 1}) {
      const Rigid3 aside{Eigen::Quaterniond::Identity(),
                         {(part == 0 ? -1 : 1) * kStepHalfWidth_mm, 0, part == 0 ? 0 : *gauge.distance_mm}};
      out.push_back({ArtefactKind::plane, 0, pose * aside, kStepHalfWidth_mm, kStepHalfHeight_mm});
    }
  } else if (gauge.kind == GaugeKind::sphere_plate) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const auto& c : gauge.centres_mm) middle += c / static_cast<double>(gauge.centres_mm.size());
    for (std::size_t k = 0; k < gauge.centres_mm.size(); ++k) {
      const Rigid3 there{Eigen::Quaterniond::Identity(), gauge.centres_mm[k] - middle};
      out.push_back({ArtefactKind::sphere, gauge.diameter_mm[k], pose * there});
    }
  } else if (gauge.kind == GaugeKind::ball_bar) {
    for (const int part : {0, 1}) {
      const Rigid3 along{Eigen::Quaterniond::Identity(), {(part == 0 ? -0.5 : 0.5) * *gauge.distance_mm, 0, 0}};
      out.push_back({ArtefactKind::sphere, gauge.diameter_mm[static_cast<std::size_t>(part)], pose * along});
    }
  } else {
    out.push_back({gauge.kind == GaugeKind::sphere ? ArtefactKind::sphere : ArtefactKind::cylinder,
                   gauge.diameter_mm.front(), pose});
  }
}

std::vector<Placed> references_of(const SeriesViews& views) {
  std::vector<Placed> out;
  for (const auto& p : views.references_mm) {
    out.push_back({ArtefactKind::sphere, views.reference_diameter_mm, pose_of({p[0], p[1], p[2], 0, 0, 0})});
  }
  return out;
}

/// What stands in the field in that capture, as the first view has it.
Result<std::vector<Placed>> placed_of(const Series& series, int capture, const std::vector<Gauge>& gauges) {
  const auto places = series.places_of(capture);
  if (places.size() != series.artefacts.size()) {
    return unanswerable(fmt::format("the series {} has no places in its plan; add `places` to it", series.scene));
  }
  std::vector<Placed> placed;
  for (std::size_t k = 0; k < places.size(); ++k) {
    add_placed(gauge_named(gauges, series.artefacts[k]), pose_of(places[k]), placed);
  }
  return placed;
}

/// draw: which draw of the noise.
PointCloud seen(const std::vector<Placed>& placed, std::uint64_t draw, const model::Scanner& scanner,
                const PredictOptions& options) {
  const CodeAxis axis = scanner.projector.main_axis();
  const auto& code = scanner.projector.axis(axis)->code;
  const double field = code.stripes() * code.stripe_width();
  const Rigid3 world_from_cam = scanner.world_from_cam(), proj_from_world = scanner.world_from_proj().inverse();
  const Eigen::Vector3d camera = world_from_cam.translation_mm, light = scanner.world_from_proj().translation_mm;
  std::vector<std::vector<CloudPoint>> rows(static_cast<std::size_t>(scanner.camera.height_px));
  parallel_for(scanner.camera.height_px, [&](int y) {
    std::mt19937_64 generator(static_cast<std::uint64_t>(y) + 100'000 * draw);
    std::normal_distribution<double> normal;
    for (int x = 0; x < scanner.camera.width_px; ++x) {
      const auto ray_in_cam = scanner.camera.ray({x, y});
      if (!ray_in_cam) continue;
      const Eigen::Vector3d ray = (world_from_cam.rotation * *ray_in_cam).normalized();
      std::optional<Placed::Hit> nearest;
      for (const auto& surface : placed) {
        const auto hit = surface.hit(camera, ray);
        if (hit && (!nearest || hit->way < nearest->way)) nearest = hit;
      }
      if (!nearest) continue;
      const Eigen::Vector3d p = camera + nearest->way * ray;
      const double cosine = nearest->normal.dot((light - p).normalized());
      const auto u = scanner.projector.project(axis, proj_from_world * p);
      const auto further = scanner.projector.project(axis, proj_from_world * (p + 0.1 * ray));
      if (!(cosine > 0.1) || !u || !further || *u < 0 || *u > field) continue;
      const double slope = std::abs(*further - *u) / 0.1;
      if (!(slope > 0)) continue;
      const double u_along = code.period / (2 * std::numbers::pi) * options.u_phase_rad / cosine / slope;  // eq. 1
      rows[static_cast<std::size_t>(y)].push_back({.position_mm = p + u_along * normal(generator) * ray,
                                                   .u_along_ray_mm = u_along,
                                                   .modulation = static_cast<float>(cosine),
                                                   .pixel_x = static_cast<std::uint16_t>(x),
                                                   .pixel_y = static_cast<std::uint16_t>(y)});
    }
  });
  PointCloud out;
  for (const auto& row : rows) out.points.insert(out.points.end(), row.begin(), row.end());
  return out;
}

}  // namespace

Result<PointCloud> predicted_cloud(const Series& series, int capture, const std::vector<Gauge>& gauges,
                                   const model::Scanner& scanner, const PredictOptions& options) {
  const auto placed = placed_of(series, capture, gauges);
  if (!placed) return tl::unexpected(placed.error());
  return seen(*placed, static_cast<std::uint64_t>(capture + 1), scanner, options);
}

Result<std::vector<PointCloud>> predicted_views(const Series& series, int capture, const std::vector<Gauge>& gauges,
                                                const model::Scanner& scanner, const PredictOptions& options) {
  if (!series.views) {
    auto one = predicted_cloud(series, capture, gauges, scanner, options);
    if (!one) return tl::unexpected(one.error());
    return std::vector<PointCloud>{*std::move(one)};
  }
  auto placed = placed_of(series, capture, gauges);
  if (!placed) return tl::unexpected(placed.error());
  for (auto& reference : references_of(*series.views)) placed->push_back(std::move(reference));
  std::vector<PointCloud> out;
  for (const auto& t : series.views->turns_deg) {
    auto turned = *placed;
    for (auto& one : turned) one.world_from_part = pose_of({0, 0, 0, t[0], t[1], t[2]}) * one.world_from_part;
    out.push_back(seen(turned, static_cast<std::uint64_t>(100 * (capture + 1)) + out.size(), scanner, options));
  }
  return out;
}

namespace {

std::vector<Eigen::Vector3d> outline_of(const Placed& p) {
  std::vector<Eigen::Vector3d> line;
  const double r = 0.5 * p.diameter;
  if (p.kind == ArtefactKind::sphere) {
    for (int i = 0; i <= 36; ++i) {  // around X and Y, then around X and Z: a circle in both drawings
      const double turn = i * std::numbers::pi / 18;
      line.push_back(p.world_from_part.translation_mm + r * Eigen::Vector3d(std::cos(turn), std::sin(turn), 0));
    }
    for (int i = 0; i <= 36; ++i) {
      const double turn = i * std::numbers::pi / 18;
      line.push_back(p.world_from_part.translation_mm + r * Eigen::Vector3d(std::cos(turn), 0, std::sin(turn)));
    }
    return line;
  }
  const bool flat = p.kind == ArtefactKind::plane;
  const double x = flat ? p.half_width : r;
  for (const auto& [sx, sy] : {std::pair(-1, -1), {1, -1}, {1, 1}, {-1, 1}, {-1, -1}}) {
    line.push_back(p.world_from_part * (flat ? Eigen::Vector3d(sx * x, sy * p.half_height, 0)
                                             : Eigen::Vector3d(sx * x, 0, sy * kCylinderHalfLength_mm)));
  }
  return line;
}

}  // namespace

std::vector<std::vector<Eigen::Vector3d>> outlines_of(const Series& series, int capture,
                                                      const std::vector<Gauge>& gauges) {
  std::vector<std::vector<Eigen::Vector3d>> out;
  const auto places = series.places_of(capture);
  for (std::size_t k = 0; k < places.size(); ++k) {
    std::vector<Placed> placed;
    add_placed(gauge_named(gauges, series.artefacts[k]), pose_of(places[k]), placed);
    for (const auto& p : placed) out.push_back(outline_of(p));
    for (std::size_t i = 1; i < placed.size(); ++i) {  // what carries the spheres of a bar or a plate
      if (placed[i].kind != ArtefactKind::sphere) continue;
      out.push_back({placed[i - 1].world_from_part.translation_mm, placed[i].world_from_part.translation_mm});
    }
  }
  if (series.views && capture == 0) {
    for (const auto& p : references_of(*series.views)) out.push_back(outline_of(p));
  }
  return out;
}

Fields3d fields_of(const Plan& plan, const model::Scanner& scanner) {
  double low = 0, high = 0;
  for (const auto& series : plan.series) {
    for (const auto& place : series.places) {
      low = std::min(low, place[2]);
      high = std::max(high, place[2]);
    }
  }
  const Rigid3 world_from_cam = scanner.world_from_cam(), proj_from_world = scanner.world_from_proj().inverse();
  const double width = scanner.camera.width_px - 1, height = scanner.camera.height_px - 1;
  const CodeAxis axis = scanner.projector.main_axis();
  const auto& code = scanner.projector.axis(axis)->code;
  Fields3d out;
  for (const double z : {low, 0.5 * (low + high), high}) {
    std::vector<Eigen::Vector3d> corners;
    for (const auto& [x, y] : {std::pair(0.0, 0.0), {width, 0.0}, {width, height}, {0.0, height}}) {
      const auto ray = scanner.camera.ray({x, y});
      if (!ray) continue;
      const Eigen::Vector3d along = world_from_cam.rotation * *ray, from = world_from_cam.translation_mm;
      corners.push_back(from + (z - from.z()) / along.z() * along);
    }
    out.camera.push_back(corners);
    // Where the code begins and ends across the fringes, by bisection along world X (u grows with X; scanner.h), at the
    // upper and lower edge of what the camera sees.
    const auto edge = [&](double u, double y) {
      double left = -0.4 * scanner.working_distance_mm, right = -left;  // beyond, a polynomial of distortion turns over
      for (int i = 0; i < 50; ++i) {
        const double middle = 0.5 * (left + right);
        const auto found = scanner.projector.project(axis, proj_from_world * Eigen::Vector3d(middle, y, z));
        (found && *found < u ? left : right) = middle;
      }
      return Eigen::Vector3d(0.5 * (left + right), y, z);
    };
    double top = 0, bottom = 0;
    for (const auto& c : corners) {
      top = std::max(top, c.y());
      bottom = std::min(bottom, c.y());
    }
    const double end = code.stripes() * code.stripe_width();
    out.code.push_back({edge(0, bottom), edge(end, bottom), edge(end, top), edge(0, top)});
  }
  return out;
}

Result<std::vector<PredictedSeries>> predict(const Plan& plan, const std::vector<Gauge>& gauges,
                                             const model::Scanner& scanner, const PredictOptions& options) {
  std::vector<PredictedSeries> out;
  for (const auto& series : plan.series) {
    PredictedSeries one{.scene = series.scene};
    std::vector<CaptureResult> results;
    for (int i = 0; i < series.captures; ++i) {
      const auto clouds = predicted_views(series, i, gauges, scanner, options);
      if (!clouds) return tl::unexpected(clouds.error());
      auto result = series.views ? evaluate_views(plan, series, i, gauges, *clouds, scanner)
                                 : evaluate_capture(plan, series, i, gauges, clouds->front(), scanner);
      if (result) {
        results.push_back(*std::move(result));
      } else {
        one.problems.push_back(fmt::format("{}: {}", capture_name(series, i), result.error().sentence));
      }
    }
    if (!results.empty()) {
      one.quantities =
          evaluate_series(plan, series, gauges, results, {.environment = options.environment, .monte_carlo_trials = 0});
    }
    out.push_back(std::move(one));
  }
  return out;
}

}  // namespace fringecal::metrology

#include "metrology/artefact.h"

#include "core/statistics.h"
#include "fitting/any_shape.h"
#include "metrology/calibration_uncertainty.h"
#include "metrology/segment.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace fringecal::metrology {
namespace {

constexpr std::size_t kThinned = 5000;  // enough to know a shape; the robust search costs points x trials

using Surface = fitting::AnyShape;

Result<Surface> fit_surface(ArtefactKind kind, std::span<const Eigen::Vector3d> points, fitting::Rejection rejection) {
  constexpr fitting::ShapeKind kKinds[] = {fitting::ShapeKind::plane, fitting::ShapeKind::sphere,
                                           fitting::ShapeKind::cylinder};
  return fitting::fit_any(kKinds[static_cast<int>(kind)], points, {.rejection = rejection});
}

/// 1.4826 times the median absolute deviation from the median.
double robust_sd(std::vector<double> values) {
  const double middle = median(values);
  for (double& v : values) v = std::abs(v - middle);
  return 1.4826 * median(std::move(values));
}

struct Places {
  Eigen::Vector3d camera, projector;  // the pupils
};

/// Rules 3 to 5 on one segment, from a first surface.
Result<ArtefactMeasurement> refine(const PointCloud& cloud, const std::vector<std::size_t>& segment, Surface surface,
                                   const Places& places, const ArtefactOptions& options) {
  const double min_cosine = std::cos(options.max_incidence_deg * std::numbers::pi / 180.0);
  ArtefactMeasurement m;
  std::vector<std::size_t> kept, before;
  std::vector<double> distances;
  // The kept set depends on the surface only through its normals; it settles in two or three rounds.
  for (int round = 0; round < 10; ++round) {
    std::vector<std::size_t> facing;
    distances.clear();
    for (const std::size_t i : segment) {
      const Eigen::Vector3d& p = cloud.points[i].position_mm;
      const Eigen::Vector3d to_camera = (places.camera - p).normalized(),
                            to_light = (places.projector - p).normalized();
      Eigen::Vector3d normal = surface.outward(p).normalized();
      if (surface.kind == fitting::ShapeKind::plane && normal.dot(to_camera) < 0) normal = -normal;
      if (!(normal.dot(to_camera) >= min_cosine && normal.dot(to_light) >= min_cosine)) continue;  // eq. 2
      facing.push_back(i);
      distances.push_back(surface.distance(p));
    }
    if (facing.size() < options.min_points) {
      return unanswerable(fmt::format("only {} points face both camera and projector within {} degrees; {} are needed",
                                      facing.size(), options.max_incidence_deg, options.min_points));
    }
    const double limit = 6.0 * robust_sd(distances);
    kept.clear();
    m.points_mm.clear();
    for (std::size_t k = 0; k < facing.size(); ++k) {
      if (!(std::abs(distances[k]) <= limit)) continue;
      kept.push_back(facing[k]);
      m.points_mm.push_back(cloud.points[facing[k]].position_mm);
    }
    m.n_grazing = segment.size() - facing.size();
    m.n_gross = facing.size() - kept.size();
    const auto fitted = fitting::fit_any(surface.kind, m.points_mm, {});
    if (!fitted) return tl::unexpected(fitted.error());
    surface = *fitted;
    if (kept == before) break;
    before = kept;
  }
  m.n_points = kept.size();
  m.place_mm = surface.place_mm;
  m.form_standard_deviation_mm = surface.quality.standard_deviation_mm;
  if (surface.kind != fitting::ShapeKind::plane) {
    m.diameter_mm = surface.diameter_mm;
    m.u_diameter_noise_mm = surface.u_diameter_mm;
  }
  int left = std::numeric_limits<int>::max(), top = left, right = 0, bottom = 0;
  for (const std::size_t i : kept) {
    left = std::min<int>(left, cloud.points[i].pixel_x);
    right = std::max<int>(right, cloud.points[i].pixel_x);
    top = std::min<int>(top, cloud.points[i].pixel_y);
    bottom = std::max<int>(bottom, cloud.points[i].pixel_y);
  }
  m.deviation_mm = Image<float>(right - left + 1, bottom - top + 1, std::numeric_limits<float>::quiet_NaN());
  for (const std::size_t i : kept) {
    const auto& p = cloud.points[i];
    m.deviation_mm(p.pixel_x - left, p.pixel_y - top) = static_cast<float>(surface.distance(p.position_mm));
  }
  return m;
}

struct Candidate {
  std::size_t segment = 0;
  Surface surface;
};

/// The free segment whose size is nearest to the nominal's; for a plane, which has no size, the largest.
std::optional<Candidate> best_segment(const NominalArtefact& nominal,
                                      const std::vector<std::vector<Eigen::Vector3d>>& segment_points,
                                      const std::vector<bool>& taken, fitting::Rejection rejection,
                                      const ArtefactOptions& options, std::string& seen) {
  std::optional<Candidate> best;
  double best_error = options.max_size_error;
  seen.clear();
  for (std::size_t s = 0; s < segment_points.size(); ++s) {
    if (taken[s]) continue;
    const auto surface = fit_surface(nominal.kind, segment_points[s], rejection);
    if (!surface) continue;
    if (nominal.kind == ArtefactKind::plane) return Candidate{s, *surface};  // segments come by falling size
    seen += fmt::format(" {:.2f} mm;", surface->diameter_mm);
    const double error = std::abs(surface->diameter_mm / nominal.diameter_mm - 1.0);
    if (error <= best_error) {
      best = Candidate{s, *surface};
      best_error = error;
    }
  }
  return best;
}

}  // namespace

std::vector<Eigen::Vector3d> thinned(std::span<const Eigen::Vector3d> points, std::size_t at_most) {
  const std::size_t step = std::max<std::size_t>(1, (points.size() + at_most - 1) / at_most);
  std::vector<Eigen::Vector3d> out;
  for (std::size_t i = 0; i < points.size(); i += step) out.push_back(points[i]);
  return out;
}

const char* name_of(ArtefactKind kind) {
  static constexpr const char* kNames[] = {"plane", "sphere", "cylinder"};
  return kNames[static_cast<int>(kind)];
}

Result<std::vector<ArtefactMeasurement>> measure_artefacts(const PointCloud& cloud, const model::Scanner& scanner,
                                                           std::span<const NominalArtefact> nominals,
                                                           const ArtefactOptions& options) {
  const Rigid3 world_from_proj = scanner.world_from_proj(), world_from_cam = scanner.world_from_cam();
  const Places places{world_from_cam.translation_mm, world_from_proj.translation_mm};
  const auto segments = segments_of(cloud, options.max_gap_mm, options.min_points);

  std::vector<std::vector<Eigen::Vector3d>> segment_points;  // thinned
  for (const auto& segment : segments) {
    std::vector<Eigen::Vector3d> points;
    points.reserve(segment.size());
    for (const std::size_t i : segment) points.push_back(cloud.points[i].position_mm);
    segment_points.push_back(thinned(points, kThinned));
  }
  std::vector<ArtefactMeasurement> out;
  std::vector<bool> taken(segments.size(), false);
  for (const auto& nominal : nominals) {
    std::string seen;
    // A clean segment is its artefact and shows so at once; the search in a contaminated one (a post, a base) costs a
    // thousand times as much and is made only where no clean segment serves.
    auto best = best_segment(nominal, segment_points, taken, fitting::Rejection::none, options, seen);
    if (!best) best = best_segment(nominal, segment_points, taken, fitting::Rejection::robust, options, seen);
    if (!best) {
      return unanswerable(
          fmt::format("{} is not in the cloud: none of its {} segments of at least {} points is a {} of "
                      "{} mm within {} %{}{}",
                      nominal.name, segments.size(), options.min_points, name_of(nominal.kind), nominal.diameter_mm,
                      100 * options.max_size_error, seen.empty() ? "" : "; found diameters:", seen));
    }
    taken[best->segment] = true;
    auto measurement = refine(cloud, segments[best->segment], best->surface, places, options);
    if (!measurement) return unanswerable(fmt::format("{}: {}", nominal.name, measurement.error().sentence));
    measurement->name = nominal.name;
    measurement->kind = nominal.kind;
    out.push_back(std::move(*measurement));
  }
  return out;
}

std::vector<ArtefactMeasurement> measure_all(const PointCloud& cloud, const model::Scanner& scanner,
                                             const NominalArtefact& nominal, const ArtefactOptions& options) {
  const Places places{scanner.world_from_cam().translation_mm, scanner.world_from_proj().translation_mm};
  std::vector<ArtefactMeasurement> out;
  for (const auto& segment : segments_of(cloud, options.max_gap_mm, options.min_points)) {
    std::vector<Eigen::Vector3d> points;
    points.reserve(segment.size());
    for (const std::size_t i : segment) points.push_back(cloud.points[i].position_mm);
    const auto surface = fit_surface(nominal.kind, thinned(points, kThinned), fitting::Rejection::none);
    if (!surface || std::abs(surface->diameter_mm / nominal.diameter_mm - 1.0) > options.max_size_error) continue;
    auto measurement = refine(cloud, segment, *surface, places, options);
    if (!measurement) continue;
    measurement->name = nominal.name;
    measurement->kind = nominal.kind;
    out.push_back(std::move(*measurement));
  }
  return out;
}

namespace {

constexpr std::size_t kForUncertainty = 2000;

Result<double> diameter_of(const ArtefactMeasurement& measurement, std::span<const Eigen::Vector3d> moved) {
  const auto surface = fit_surface(measurement.kind, moved, fitting::Rejection::none);
  if (!surface) return tl::unexpected(surface.error());
  return surface->diameter_mm;
}

}  // namespace

Result<double> u_diameter_from_calibration(const ArtefactMeasurement& measurement, const model::Scanner& scanner) {
  require(measurement.diameter_mm.has_value(), "u of a diameter is asked of an artefact that has one");
  return u_from_calibration(thinned(measurement.points_mm, kForUncertainty), scanner,
                            [&](std::span<const Eigen::Vector3d> moved) { return diameter_of(measurement, moved); });
}

Result<double> u_diameter_from_phase_offset(const ArtefactMeasurement& measurement, const model::Scanner& scanner) {
  require(measurement.diameter_mm.has_value(), "u of a diameter is asked of an artefact that has one");
  const auto u = u_from_phase_offset({thinned(measurement.points_mm, kForUncertainty)}, scanner,
                                     [&](const PointGroups& moved) -> Result<std::vector<double>> {
                                       const auto diameter = diameter_of(measurement, moved.front());
                                       if (!diameter) return tl::unexpected(diameter.error());
                                       return std::vector<double>{*diameter};
                                     });
  if (!u) return tl::unexpected(u.error());
  return u->front();
}

RepeatStatistics statistics_of(std::span<const RepeatValue> repeats) {
  RepeatStatistics s{.n = static_cast<int>(repeats.size())};
  require(!repeats.empty(), "statistics need at least one repeat");
  double sum = 0;
  bool all_have_diameter = true;
  for (const auto& r : repeats) {
    s.max_form_sd_mm = std::max(s.max_form_sd_mm, r.form_sd_mm);
    s.mean_form_sd_mm += r.form_sd_mm / s.n;
    all_have_diameter = all_have_diameter && r.diameter_mm.has_value();
    sum += r.diameter_mm.value_or(0.0);
  }
  if (!all_have_diameter) return s;
  const double mean = sum / s.n;
  s.mean_diameter_mm = mean;
  if (s.n > 1) {
    double squares = 0;
    for (const auto& r : repeats) squares += (*r.diameter_mm - mean) * (*r.diameter_mm - mean);
    s.repeatability_sd_mm = std::sqrt(squares / (s.n - 1));
  }
  return s;
}

double u_of_error_mm(const RepeatStatistics& s, double u_calibration_mm, double u_certificate_mm) {
  const double scatter = s.repeatability_sd_mm.value_or(0.0);
  return std::sqrt(scatter * scatter / s.n + u_calibration_mm * u_calibration_mm +
                   u_certificate_mm * u_certificate_mm);  // eq. 3
}

}  // namespace fringecal::metrology

#include "metrology/multi_view.h"

#include "core/error.h"
#include "metrology/calibration_uncertainty.h"
#include "metrology/feature.h"
#include "metrology/registration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
namespace {

constexpr double kSameSphere_mm = 2;      // far above any registration's error, far below a sphere's radius
constexpr double kLeastDifference = 0.1;  // of sizes: ArtefactOptions::max_size_error
constexpr std::size_t kReferencePoints = 150,
                      kArtefactPoints = 400;  // of each sphere in each view, for the calibration's part

using Points = std::vector<Eigen::Vector3d>;

/// One view: its references, and the artefact's spheres with the part that each is.
struct SeenView {
  std::vector<ArtefactMeasurement> references, spheres;
  std::vector<std::size_t> part_of;  // of spheres
};

Result<Registration> join(const std::vector<std::vector<Eigen::Vector3d>>& centres, const Series& series, int capture) {
  std::vector<View> views;
  for (std::size_t v = 0; v < centres.size(); ++v) {
    views.push_back({.name = view_name(series, capture, static_cast<int>(v)), .cloud = {}, .spheres_mm = centres[v]});
  }
  return register_views(views, {.refine = false});
}

/// Rule 3: which sphere is which, by where it lies in `part`. Returns how many there are.
std::size_t tell_apart(std::vector<SeenView>& views, const Registration& registration) {
  std::vector<Eigen::Vector3d> known;
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (const auto& m : views[v].spheres) {
      const Eigen::Vector3d x = registration.part_from_view[v] * m.place_mm;
      const auto same = std::find_if(known.begin(), known.end(),
                                     [&](const Eigen::Vector3d& k) { return (k - x).norm() <= kSameSphere_mm; });
      views[v].part_of.push_back(static_cast<std::size_t>(same - known.begin()));
      if (same == known.end()) known.push_back(x);
    }
  }
  return known.size();
}

/// All views' points of each part in `part`, with the diameter and place of a fit to them.
Result<std::vector<ArtefactMeasurement>> unite(const std::vector<SeenView>& views, const Registration& registration,
                                               std::size_t parts, const Gauge& gauge) {
  std::vector<ArtefactMeasurement> out(parts);
  std::vector<int> seen_by(parts, 0);
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (std::size_t k = 0; k < views[v].spheres.size(); ++k) {
      const auto& from = views[v].spheres[k];
      auto& to = out[views[v].part_of[k]];
      ++seen_by[views[v].part_of[k]];
      to.n_grazing += from.n_grazing;
      to.n_gross += from.n_gross;
      for (const auto& p : from.points_mm) to.points_mm.push_back(registration.part_from_view[v] * p);
    }
  }
  for (std::size_t k = 0; k < parts; ++k) {
    if (seen_by[k] < 2) return unanswerable(fmt::format("{}: only one view sees one of its spheres", gauge.name));
    const auto fit = fitting::fit_sphere(out[k].points_mm);
    if (!fit) return unanswerable(fmt::format("{}: {}", gauge.name, fit.error().sentence));
    out[k].name = gauge.name;
    out[k].kind = ArtefactKind::sphere;
    out[k].diameter_mm = fit->diameter_mm;
    out[k].place_mm = fit->center_mm;
    out[k].n_points = out[k].points_mm.size();
  }
  return out;
}

/// Where each part of the certificate is among the united ones: of a bar as their sizes say, of a plate as their distances.
Result<std::vector<std::size_t>> order_of(const std::vector<ArtefactMeasurement>& parts, const Gauge& gauge,
                                          const Eigen::Vector3d& camera_mm) {
  std::vector<std::size_t> out(parts.size());
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = k;
  if (gauge.kind == GaugeKind::ball_bar) {
    const auto off = [&](std::size_t a, std::size_t b) {
      return std::abs(*parts[a].diameter_mm - gauge.diameter_mm[0]) +
             std::abs(*parts[b].diameter_mm - gauge.diameter_mm[1]);
    };
    if (off(1, 0) < off(0, 1)) std::swap(out[0], out[1]);
  } else if (gauge.kind == GaugeKind::sphere_plate) {
    const auto ordered = in_certified_order(gauge, parts, camera_mm);
    if (!ordered) return tl::unexpected(ordered.error());
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto found = std::find_if(parts.begin(), parts.end(), [&](const ArtefactMeasurement& m) {
        return m.place_mm == (*ordered)[k].place_mm;
      });
      out[k] = static_cast<std::size_t>(found - parts.begin());
    }
  }
  return out;
}

/// The groups that the calibration moves: view after view its references, then its spheres; and of which view each is.
struct ViewGroups {
  PointGroups points_mm;
  std::vector<int> view;
};
ViewGroups groups_of(const std::vector<SeenView>& views) {
  ViewGroups out;
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (const auto& m : views[v].references) out.points_mm.push_back(thinned(m.points_mm, kReferencePoints));
    for (const auto& m : views[v].spheres) out.points_mm.push_back(thinned(m.points_mm, kArtefactPoints));
    out.view.resize(out.points_mm.size(), static_cast<int>(v));
  }
  return out;
}

/// The united points of each part, of moved groups joined anew.
Result<std::vector<Points>> rejoined(const PointGroups& moved, const std::vector<SeenView>& views, std::size_t parts,
                                     const Series& series, int capture) {
  std::vector<Points> centres(views.size());
  std::size_t at = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (std::size_t k = 0; k < views[v].references.size(); ++k) {
      const auto fit = fitting::fit_sphere(moved[at++]);
      if (!fit) return tl::unexpected(fit.error());
      centres[v].push_back(fit->center_mm);
    }
    at += views[v].spheres.size();
  }
  const auto registration = join(centres, series, capture);
  if (!registration) return tl::unexpected(registration.error());
  std::vector<Points> out(parts);
  at = 0;
  for (std::size_t v = 0; v < views.size(); ++v) {
    at += views[v].references.size();
    for (const std::size_t part : views[v].part_of) {
      for (const auto& p : moved[at++]) out[part].push_back(registration->part_from_view[v] * p);
    }
  }
  return out;
}

/// Diameters in the certificate's order, then its distances.
Result<std::vector<double>> lengths_of(const std::vector<Points>& parts, const std::vector<std::size_t>& order,
                                       const Gauge& gauge) {
  std::vector<double> out;
  for (const std::size_t k : order) {
    const auto fit = fitting::fit_sphere(parts[k]);
    if (!fit) return tl::unexpected(fit.error());
    out.push_back(fit->diameter_mm);
  }
  for (const auto& certified : distances_of(gauge)) {
    const auto length = length_between(gauge.kind, parts[order[static_cast<std::size_t>(certified.from)]],
                                       parts[order[static_cast<std::size_t>(certified.to)]]);
    if (!length) return tl::unexpected(length.error());
    out.push_back(*length);
  }
  return out;
}

Result<std::vector<SeenView>> seen_in(std::span<const PointCloud> clouds, const Series& series, const Gauge& gauge,
                                      const model::Scanner& scanner) {
  const NominalArtefact reference{"reference sphere", ArtefactKind::sphere, series.views->reference_diameter_mm};
  const NominalArtefact sphere{gauge.name, ArtefactKind::sphere, gauge.diameter_mm.front()};
  if (!(std::abs(reference.diameter_mm / sphere.diameter_mm - 1) > 2 * kLeastDifference)) {
    return unanswerable(
        fmt::format("{} and the reference spheres have nearly the same diameter, {} and {} mm; take references "
                    "of another size",
                    gauge.name, sphere.diameter_mm, reference.diameter_mm));
  }
  std::vector<SeenView> out;
  for (const auto& cloud : clouds) {
    out.push_back({measure_all(cloud, scanner, reference), measure_all(cloud, scanner, sphere), {}});
  }
  return out;
}

}  // namespace

Result<CaptureResult> evaluate_views(const Plan& plan, const Series& series, int capture,
                                     const std::vector<Gauge>& gauges, std::span<const PointCloud> clouds,
                                     const model::Scanner& scanner) {
  require(series.views && clouds.size() == series.views->turns_deg.size(), "a cloud for each view of the series");
  const Gauge& gauge = gauge_named(gauges, series.artefacts.front());
  if (gauge.diameter_mm.empty() || gauge.kind == GaugeKind::cylinder) {
    return unanswerable(
        fmt::format("{}: views are brought together for spheres, ball bars and sphere plates, not for a {}", gauge.name,
                    name_of(gauge.kind)));
  }
  auto views = seen_in(clouds, series, gauge, scanner);
  if (!views) return tl::unexpected(views.error());
  std::vector<std::vector<Eigen::Vector3d>> centres;
  for (const auto& view : *views) {
    centres.emplace_back();
    for (const auto& m : view.references) centres.back().push_back(m.place_mm);
  }
  const auto registration = join(centres, series, capture);
  if (!registration) return tl::unexpected(registration.error());
  const std::size_t parts = tell_apart(*views, *registration);
  if (parts != gauge.diameter_mm.size()) {
    return unanswerable(fmt::format("{}: the views together show {} spheres of its size where it has {}", gauge.name,
                                    parts, gauge.diameter_mm.size()));
  }
  const auto united = unite(*views, *registration, parts, gauge);
  if (!united) return tl::unexpected(united.error());
  const auto order = order_of(*united, gauge, scanner.world_from_cam().translation_mm);
  if (!order) return tl::unexpected(order.error());

  CaptureResult out{.capture = capture};
  out.joined = JoinedViews{static_cast<int>(clouds.size()), static_cast<int>(registration->spheres_mm.size()),
                           registration->sphere_rms_mm};
  const auto lengths = [&](const PointGroups& moved) -> Result<std::vector<double>> {
    const auto points = rejoined(moved, *views, parts, series, capture);
    if (!points) return tl::unexpected(points.error());
    return lengths_of(*points, *order, gauge);
  };
  const ViewGroups groups = groups_of(*views);
  const auto u = u_from_calibration_of_groups(groups.points_mm, scanner, lengths),
             u_captures = u_from_phase_offset(groups.points_mm, scanner, lengths, groups.view);
  for (const auto* part : {&u, &u_captures}) {
    if (!*part) return unanswerable(fmt::format("{}: {}", gauge.name, part->error().sentence));
  }
  std::vector<ArtefactMeasurement> ordered;
  std::vector<Feature> features;
  for (const std::size_t k : *order) {
    ordered.push_back((*united)[k]);
    auto one = describe(ordered.back(), plan.rejection);
    if (!one) return unanswerable(fmt::format("{}: {}", gauge.name, one.error().sentence));
    one->result.part = static_cast<int>(features.size());
    one->result.u_calibration_mm = (*u)[features.size()];
    one->result.u_noise_mm = std::hypot(one->result.u_noise_mm.value_or(0), (*u_captures)[features.size()]);
    features.push_back(*std::move(one));
  }
  for (const auto& certified : distances_of(gauge)) {
    auto distance = distance_between(gauge, certified, ordered, features);
    if (!distance) return tl::unexpected(distance.error());
    const std::size_t at = features.size() + out.distances.size();
    distance->u_calibration_mm = (*u)[at];
    distance->u_noise_mm = std::hypot(distance->u_noise_mm, (*u_captures)[at]);
    out.distances.push_back(*distance);
  }
  for (auto& feature : features) out.features.push_back(std::move(feature.result));
  return out;
}

}  // namespace fringecal::metrology

#include "metrology/feature.h"

#include "metrology/match_centres.h"
#include "metrology/step.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::metrology {
namespace {

struct FormFigures {
  double range = 0, shell_95 = 0;
};

/// Eqs. 1 and 2 over the points kept.
FormFigures form_of(const fitting::FitQuality& quality) {
  std::vector<double> kept;
  for (std::size_t i = 0; i < quality.distances_mm.size(); ++i) {
    if (!quality.rejected[i]) kept.push_back(quality.distances_mm[i]);
  }
  std::sort(kept.begin(), kept.end());
  const auto at = [&](double p) {
    return kept[static_cast<std::size_t>(std::lround(p * static_cast<double>(kept.size() - 1)))];
  };
  return {kept.back() - kept.front(), at(0.975) - at(0.025)};
}

}  // namespace

Result<Feature> describe(const ArtefactMeasurement& m, fitting::Rejection rejection) {
  Feature described{.result = {.artefact = m.name}};
  FeatureResult& out = described.result;
  const fitting::FitOptions options{.rejection = rejection};
  const auto keep = [&](const fitting::FitQuality& quality) {
    const FormFigures form = form_of(quality);
    out.range_mm = form.range;
    out.shell_95_mm = form.shell_95;
    out.sd_mm = quality.standard_deviation_mm;  // eq. 3
    out.n_points = static_cast<int>(quality.n_used);
    out.n_rejected = static_cast<int>(m.n_gross + quality.n_rejected);
    out.residuals = residual_cloud(m.points_mm, quality.distances_mm, quality.rejected);
  };
  if (m.kind == ArtefactKind::plane) {
    const auto fit = fitting::fit_plane(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->point_mm;
  } else if (m.kind == ArtefactKind::sphere) {
    const auto fit = fitting::fit_sphere(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->center_mm;
    described.u_centre_mm = fit->u_center_mm;
    out.diameter_mm = fit->diameter_mm;
    out.u_noise_mm = fit->u_diameter_mm;
  } else {
    const auto fit = fitting::fit_cylinder(m.points_mm, options);
    if (!fit) return tl::unexpected(fit.error());
    keep(fit->quality);
    out.place_mm = fit->axis_point_mm;
    out.diameter_mm = fit->diameter_mm;
    out.u_noise_mm = fit->u_diameter_mm;
  }
  return described;
}

Result<std::vector<ArtefactMeasurement>> in_certified_order(const Gauge& gauge, std::vector<ArtefactMeasurement> parts,
                                                            const Eigen::Vector3d& camera_mm) {
  if (gauge.kind == GaugeKind::step) {
    std::sort(parts.begin(), parts.end(), [&](const ArtefactMeasurement& a, const ArtefactMeasurement& b) {
      return (a.place_mm - camera_mm).norm() > (b.place_mm - camera_mm).norm();
    });
  }
  if (gauge.kind != GaugeKind::sphere_plate) return parts;
  std::vector<Eigen::Vector3d> centres;
  centres.reserve(parts.size());
  for (const auto& m : parts) centres.push_back(m.place_mm);
  const auto order = match_centres(centres, gauge.centres_mm);
  if (!order) return unanswerable(fmt::format("{}: {}", gauge.name, order.error().sentence));
  std::vector<ArtefactMeasurement> out;
  for (const std::size_t k : *order) out.push_back(std::move(parts[k]));
  return out;
}

Result<double> length_between(GaugeKind kind, std::span<const Eigen::Vector3d> from,
                              std::span<const Eigen::Vector3d> to) {
  if (kind == GaugeKind::step) {
    const auto step = fit_step(from, to);
    if (!step) return tl::unexpected(step.error());
    return step->height_mm;
  }
  const auto a = fitting::fit_sphere(from), b = fitting::fit_sphere(to);
  if (!a) return tl::unexpected(a.error());
  if (!b) return tl::unexpected(b.error());
  return (a->center_mm - b->center_mm).norm();
}

Result<DistanceResult> distance_between(const Gauge& gauge, const CertifiedDistance& certified,
                                        std::span<const ArtefactMeasurement> parts, std::span<const Feature> features) {
  const auto from = static_cast<std::size_t>(certified.from), to = static_cast<std::size_t>(certified.to);
  DistanceResult out{.artefact = gauge.name, .from = certified.from, .to = certified.to};
  if (gauge.kind == GaugeKind::step) {
    const auto step = fit_step(parts[from].points_mm, parts[to].points_mm);
    if (!step) return unanswerable(fmt::format("{}: {}", gauge.name, step.error().sentence));
    out.distance_mm = step->height_mm;
    out.u_noise_mm = step->u_noise_mm;
    return out;
  }
  const Feature &a = features[from], &b = features[to];
  const Eigen::Vector3d between = b.result.place_mm - a.result.place_mm, along = between.normalized();
  out.distance_mm = between.norm();
  out.u_noise_mm = std::hypot(a.u_centre_mm.cwiseProduct(along).norm(), b.u_centre_mm.cwiseProduct(along).norm());
  return out;
}

}  // namespace fringecal::metrology

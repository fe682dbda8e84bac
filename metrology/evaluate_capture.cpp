#include "core/error.h"
#include "metrology/acceptance.h"
#include "metrology/calibration_uncertainty.h"
#include "metrology/feature.h"

#include <fmt/format.h>

#include <cmath>

namespace fringecal::metrology {
namespace {

/// One gauge's parts as results, with what the calibration's uncertainty makes of them.
Result<bool> add_gauge(const Plan& plan, const Gauge& gauge, const std::vector<ArtefactMeasurement>& parts,
                       const model::Scanner& scanner, CaptureResult& out) {
  std::vector<Feature> features;
  for (const auto& m : parts) {
    auto one = describe(m, plan.rejection);
    if (!one) return unanswerable(fmt::format("{}: {}", m.name, one.error().sentence));
    one->result.part = static_cast<int>(features.size());
    if (m.diameter_mm) {
      const auto u = u_diameter_from_calibration(m, scanner), u_capture = u_diameter_from_phase_offset(m, scanner);
      for (const auto* part : {&u, &u_capture}) {
        if (!*part) return unanswerable(fmt::format("{}: {}", m.name, part->error().sentence));
      }
      one->result.u_calibration_mm = *u;
      one->result.u_noise_mm = std::hypot(one->result.u_noise_mm.value_or(0), *u_capture);
    }
    features.push_back(*std::move(one));
  }
  for (const auto& certified : distances_of(gauge)) {
    auto distance = distance_between(gauge, certified, parts, features);
    if (!distance) return tl::unexpected(distance.error());
    const PointGroups groups = {
        thinned(parts[static_cast<std::size_t>(certified.from)].points_mm, kPointsForCalibration),
        thinned(parts[static_cast<std::size_t>(certified.to)].points_mm, kPointsForCalibration)};
    const auto length_of = [&](const PointGroups& moved) -> Result<std::vector<double>> {
      const auto length = length_between(gauge.kind, moved[0], moved[1]);
      if (!length) return tl::unexpected(length.error());
      return std::vector<double>{*length};
    };
    const auto u = u_from_calibration_of_groups(groups, scanner, length_of);
    const auto u_capture = u_from_phase_offset(groups, scanner, length_of);
    for (const auto* part : {&u, &u_capture}) {
      if (!*part) return unanswerable(fmt::format("{}: {}", gauge.name, part->error().sentence));
    }
    distance->u_calibration_mm = u->front();
    distance->u_noise_mm = std::hypot(distance->u_noise_mm, u_capture->front());
    out.distances.push_back(*distance);
  }
  for (auto& feature : features) out.features.push_back(std::move(feature.result));
  return true;
}

}  // namespace

std::vector<NominalArtefact> nominals_of(const Gauge& gauge) {
  if (gauge.kind == GaugeKind::flat) return {{gauge.name, ArtefactKind::plane, 0}};
  if (gauge.kind == GaugeKind::step) return {2, {gauge.name, ArtefactKind::plane, 0}};
  std::vector<NominalArtefact> out;
  for (const double d : gauge.diameter_mm)
    out.push_back({gauge.name, gauge.kind == GaugeKind::cylinder ? ArtefactKind::cylinder : ArtefactKind::sphere, d});
  return out;
}

Result<CaptureResult> evaluate_capture(const Plan& plan, const Series& series, int capture,
                                       const std::vector<Gauge>& gauges, const PointCloud& cloud,
                                       const model::Scanner& scanner) {
  std::vector<NominalArtefact> nominals;
  for (const auto& name : series.artefacts) {
    for (const auto& nominal : nominals_of(gauge_named(gauges, name))) nominals.push_back(nominal);
  }
  auto found = measure_artefacts(cloud, scanner, nominals);
  if (!found) return tl::unexpected(found.error());
  CaptureResult out{.capture = capture};
  std::size_t at = 0;
  for (const auto& name : series.artefacts) {
    const Gauge& gauge = gauge_named(gauges, name);
    std::vector<ArtefactMeasurement> parts;
    for (std::size_t k = nominals_of(gauge).size(); k > 0; --k) parts.push_back(std::move((*found)[at++]));
    const auto ordered = in_certified_order(gauge, std::move(parts), scanner.world_from_cam().translation_mm);
    if (!ordered) return tl::unexpected(ordered.error());
    const auto added = add_gauge(plan, gauge, *ordered, scanner, out);
    if (!added) return tl::unexpected(added.error());
  }
  return out;
}

}  // namespace fringecal::metrology

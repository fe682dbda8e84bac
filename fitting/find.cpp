#include "fitting/find.h"

#include "core/statistics.h"
#include "fitting/rejection.h"
#include "fitting/surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::fitting {
namespace {

using Cloud = std::vector<Eigen::Vector3d>;

Result<AnyShape> fit_as(ShapeKind kind, const Cloud& points) {
  return fit_any(kind, points, {.rejection = Rejection::robust, .distances = DistancesWanted::none});
}

Cloud chosen(Points points, const std::vector<std::size_t>& index) {
  Cloud out;
  out.reserve(index.size());
  for (const std::size_t i : index) out.push_back(points[i]);
  return out;
}

/// The kind of least scatter; the hypothesis's own where another gains less than a tenth.
std::optional<AnyShape> best_kind(const Hypothesis& hypothesis, const Cloud& points) {
  std::optional<AnyShape> best;
  for (const ShapeKind kind : {ShapeKind::plane, ShapeKind::sphere, ShapeKind::cylinder}) {
    const auto fit = fit_as(kind, points);
    // A fit that lives on less than half of the points is of something else.
    if (!fit || 2 * fit->quality.n_used < points.size()) continue;
    const double s = fit->quality.standard_deviation_mm, least = best ? best->quality.standard_deviation_mm : 0.0;
    if (!best || s < 0.9 * least || (kind == hypothesis.kind && s < 1.1 * least)) {
      best = *fit;
    }
  }
  return best;
}

/// The largest angle around the point, in its tangent plane, that no neighbour on the shape fills.
double largest_gap_rad(const Eigen::Vector3d& p, const Eigen::Vector3d& normal, const Cloud& neighbours) {
  if (neighbours.size() < 3) return 2.0 * std::numbers::pi;
  const Eigen::Matrix3d axes = axes_with(normal, 2);
  std::vector<double> angles;
  for (const Eigen::Vector3d& q : neighbours)
    angles.push_back(std::atan2(axes.col(1).dot(q - p), axes.col(0).dot(q - p)));
  std::sort(angles.begin(), angles.end());
  double gap = angles.front() + 2.0 * std::numbers::pi - angles.back();
  for (std::size_t i = 1; i < angles.size(); ++i) gap = std::max(gap, angles[i] - angles[i - 1]);
  return gap;
}

/// The neighbours of a point on its shape; where stray points took places among them, theirs too, no farther than twice
/// the farthest. A stray point that happens to lie on the shape is none: beyond an edge it would fill the gap.
Cloud neighbours_on(Points points_mm, const Neighbourhood& hood, const std::vector<bool>& on, std::size_t i) {
  constexpr std::size_t kCount = Neighbourhood::kCount;
  std::vector<std::size_t> found;
  double reach_mm = 0;
  const auto add = [&](std::size_t j) {
    if (j != i && on[j] && hood.on_surface[j] && std::find(found.begin(), found.end(), j) == found.end())
      found.push_back(j);
  };
  for (std::size_t k = 0; k < kCount; ++k) {
    const std::size_t j = hood.neighbours[i * kCount + k];
    add(j);
    reach_mm = std::max(reach_mm, (points_mm[j] - points_mm[i]).norm());
  }
  const std::size_t first = found.size();
  for (std::size_t f = 0; first < kCount && f < first; ++f) {
    for (std::size_t k = 0; k < kCount; ++k) {
      const std::size_t j = hood.neighbours[found[f] * kCount + k];
      if ((points_mm[j] - points_mm[i]).norm() <= 2.0 * reach_mm) add(j);
    }
  }
  Cloud out;
  for (const std::size_t j : found) out.push_back(points_mm[j]);
  return out;
}

/// Points of `all` within the radius of a point flagged in `sources`, by steps from neighbour to neighbour.
std::vector<bool> near_to(Points points_mm, const Neighbourhood& hood, const std::vector<bool>& sources,
                          double radius_mm) {
  std::vector<bool> near(points_mm.size(), false);
  std::vector<std::pair<std::size_t, std::size_t>> open;  // point, its source
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    if (sources[i]) open.emplace_back(i, i);
  }
  for (std::size_t at = 0; at < open.size(); ++at) {
    const auto [i, source] = open[at];
    for (std::size_t k = 0; k < Neighbourhood::kCount; ++k) {
      const std::size_t j = hood.neighbours[i * Neighbourhood::kCount + k];
      if (near[j] || sources[j] || !((points_mm[j] - points_mm[source]).norm() <= radius_mm)) continue;
      near[j] = true;
      open.emplace_back(j, source);
    }
  }
  return near;
}

/// The spacing of a shape's own points: other shapes' are not as far apart, and stray points lie between.
double spacing_of(Points points_mm, const Neighbourhood& hood, const std::vector<std::size_t>& members) {
  constexpr std::size_t kSpacing = 4;  // as Neighbourhood::spacing_mm
  std::vector<bool> is_member(points_mm.size(), false);
  for (const std::size_t i : members) is_member[i] = true;
  std::vector<double> spacings_mm;
  for (const std::size_t i : members) {
    std::size_t k = 0, found = 0, j = i;
    for (; k < Neighbourhood::kCount && found < kSpacing; ++k) {
      j = hood.neighbours[i * Neighbourhood::kCount + k];
      found += is_member[j] ? 1u : 0u;
    }
    spacings_mm.push_back((points_mm[j] - points_mm[i]).norm());
  }
  return median(std::move(spacings_mm));
}

struct Cleaned {
  AnyShape fitted;
  std::vector<std::size_t> members;
  std::vector<PointReason> reasons;  // of the members
};

/// Rules 1 to 3 on the points near a first surface; repeated with the surface that follows.
std::optional<Cleaned> cleaned(Points points_mm, const Neighbourhood& hood, const std::vector<bool>& is_free,
                               AnyShape fitted, const std::vector<std::size_t>& first, const FindOptions& options,
                               double margin_mm) {
  constexpr int kRounds = 3;
  constexpr double kGap = 150.0 / 180.0 * std::numbers::pi;  // 16 neighbours at random leave it at one point in 200
  constexpr double kScatter = 0.05;                          // of the extent: more is no surface but a cloud
  std::optional<Cleaned> out;
  std::vector<std::size_t> members = first;
  for (int round = 0; round < kRounds; ++round) {
    // The members: those of the hypothesis and what grows from them on the surface, from neighbour to neighbour.
    const double limit_mm = 3.5 * std::max(fitted.quality.standard_deviation_mm, hood.noise_mm);
    std::vector<bool> on(points_mm.size(), false);
    std::vector<std::size_t> open;
    for (const std::size_t i : first) {
      if (std::abs(fitted.distance(points_mm[i])) <= 2.0 * limit_mm && is_free[i]) {
        on[i] = true;
        open.push_back(i);
      }
    }
    for (std::size_t at = 0; at < open.size(); ++at) {
      for (std::size_t k = 0; k < Neighbourhood::kCount; ++k) {
        const std::size_t j = hood.neighbours[open[at] * Neighbourhood::kCount + k];
        if (on[j] || !is_free[j] || !(std::abs(fitted.distance(points_mm[j])) <= limit_mm)) continue;
        on[j] = true;
        open.push_back(j);
      }
    }
    std::sort(open.begin(), open.end());
    members = open;
    if (members.size() < options.min_points) return out;
    std::vector<bool> beside(points_mm.size(), false), edge(points_mm.size(), false);
    for (const std::size_t i : members) {
      for (std::size_t k = 0; k < Neighbourhood::kCount; ++k) {
        const std::size_t j = hood.neighbours[i * Neighbourhood::kCount + k];
        if (on[j] || !hood.on_surface[j] || !((points_mm[j] - points_mm[i]).norm() <= margin_mm)) continue;
        if (std::abs(fitted.distance(points_mm[j])) > 2.0 * limit_mm) beside[j] = true;
      }
      edge[i] = largest_gap_rad(points_mm[i], fitted.outward(points_mm[i]).normalized(),
                                neighbours_on(points_mm, hood, on, i)) > kGap;
    }
    const std::vector<bool> in_margin = near_to(points_mm, hood, beside, margin_mm),
                            at_edge = near_to(points_mm, hood, edge, margin_mm);
    std::vector<PointReason> reasons;
    std::vector<std::size_t> kept;
    for (const std::size_t i : members) {
      const PointReason reason = in_margin[i]            ? PointReason::margin
                                 : edge[i] || at_edge[i] ? PointReason::silhouette
                                                         : PointReason::surface;
      reasons.push_back(reason);
      if (reason == PointReason::surface) kept.push_back(i);
    }
    if (kept.size() < options.min_points / 2) return out;
    const auto again = fit_as(fitted.kind, chosen(points_mm, kept));
    if (!again) return out;
    fitted = *again;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const std::size_t i : kept) mean += (points_mm[i] - points_mm[kept[0]]) / static_cast<double>(kept.size());
    mean += points_mm[kept[0]];
    double extent2 = 0.0;
    for (const std::size_t i : kept) extent2 += (points_mm[i] - mean).squaredNorm() / static_cast<double>(kept.size());
    if (!(fitted.quality.standard_deviation_mm <= kScatter * std::sqrt(extent2))) return std::nullopt;
    std::size_t next = 0;
    for (std::size_t m = 0; m < members.size(); ++m) {
      if (reasons[m] != PointReason::surface) continue;
      if (fitted.quality.rejected[next++]) reasons[m] = PointReason::beyond;
    }
    out = Cleaned{fitted, members, std::move(reasons)};
  }
  return out;
}

void match(std::vector<FoundShape>& shapes, std::span<const NominalShape> nominals, double max_error) {
  std::vector<bool> given(nominals.size(), false);
  while (true) {
    double best = max_error;
    std::size_t best_shape = shapes.size(), best_nominal = 0;
    for (std::size_t s = 0; s < shapes.size(); ++s) {
      if (!shapes[s].nominal.empty()) continue;
      for (std::size_t k = 0; k < nominals.size(); ++k) {
        if (given[k] || nominals[k].kind != shapes[s].kind) continue;
        const double error =
            shapes[s].kind == ShapeKind::plane ? 0.0 : std::abs(shapes[s].diameter_mm / nominals[k].diameter_mm - 1.0);
        if (error < best || (error == best && best_shape == shapes.size())) {
          best = error;
          best_shape = s;
          best_nominal = k;
        }
      }
    }
    if (best_shape == shapes.size()) return;
    shapes[best_shape].nominal = nominals[best_nominal].name;
    given[best_nominal] = true;
  }
}

}  // namespace

const char* name_of(ShapeKind kind) {
  static constexpr const char* kNames[] = {"plane", "sphere", "cylinder"};
  return kNames[static_cast<int>(kind)];
}

Result<FoundShapes> find_shapes(Points points_mm, std::span<const NominalShape> nominals, const FindOptions& options) {
  constexpr double kTolerance = 4.0, kGap = 6.0;  // of the noise; of the spacing
  const std::size_t n = points_mm.size(), needed = std::max(options.min_points, Neighbourhood::kCount + 1);
  if (n < needed)
    return unanswerable(fmt::format("finding a shape needs at least {} points and there are {}", needed, n));
  for (const Eigen::Vector3d& p : points_mm) {
    if (!(p.cwiseAbs().maxCoeff() <= 1e100) || !p.allFinite()) return unanswerable(why_not_finite(points_mm));
  }
  const Neighbourhood hood = neighbourhood_of(points_mm);
  if (!(hood.spacing_mm > 0.0)) return unanswerable("most points coincide with others; remove repeated points");
  const double noise_mm = std::max(hood.noise_mm, 1e-4 * hood.spacing_mm);
  std::vector<Hypothesis> hypotheses = hypotheses_of(
      points_mm, hood,
      {.min_points = options.min_points, .tolerance_mm = kTolerance * noise_mm, .gap_mm = kGap * hood.spacing_mm});
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.points.size() > b.points.size(); });
  std::vector<bool> is_free(n, true);
  std::vector<Cleaned> all;
  for (const Hypothesis& hypothesis : hypotheses) {
    std::vector<std::size_t> free_points;
    for (const std::size_t i : hypothesis.points) {
      if (is_free[i]) free_points.push_back(i);
    }
    if (free_points.size() < options.min_points) continue;
    const auto fitted = best_kind(hypothesis, chosen(points_mm, free_points));
    if (!fitted) continue;
    const auto cleaned_with = [&](double spacing_mm) {
      return cleaned(points_mm, hood, is_free, *fitted, free_points, options, options.margin_spacings * spacing_mm);
    };
    // The cloud's spacing is mostly the larger one, the safer margin; a small shape may have no points left inside it.
    auto result = cleaned_with(hood.spacing_mm);
    if (!result) result = cleaned_with(spacing_of(points_mm, hood, free_points));
    if (!result) continue;
    for (const std::size_t i : result->members) is_free[i] = false;
    all.push_back(std::move(*result));
  }
  if (all.empty()) {
    return unanswerable(
        fmt::format("no plane, sphere or cylinder of at least {} points among the {}", options.min_points, n));
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Cleaned& a, const Cleaned& b) { return a.members.size() > b.members.size(); });
  FoundShapes out;
  out.shape_of.assign(n, -1);
  out.reason.assign(n, PointReason::none);
  for (const Cleaned& c : all) {
    FoundShape shape{.kind = c.fitted.kind,
                     .place_mm = c.fitted.place_mm,
                     .direction = c.fitted.direction,
                     .diameter_mm = c.fitted.diameter_mm,
                     .u_diameter_mm = c.fitted.u_diameter_mm,
                     .standard_deviation_mm = c.fitted.quality.standard_deviation_mm};
    for (std::size_t m = 0; m < c.members.size(); ++m) {
      out.shape_of[c.members[m]] = static_cast<int>(out.shapes.size());
      out.reason[c.members[m]] = c.reasons[m];
      ++(c.reasons[m] == PointReason::surface      ? shape.n_surface
         : c.reasons[m] == PointReason::margin     ? shape.n_margin
         : c.reasons[m] == PointReason::silhouette ? shape.n_silhouette
                                                   : shape.n_beyond);
    }
    out.shapes.push_back(std::move(shape));
  }
  match(out.shapes, nominals, options.max_size_error);
  return out;
}

}  // namespace fringecal::fitting

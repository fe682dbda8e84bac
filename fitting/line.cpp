#include "fitting/associate.h"

#include <Eigen/Geometry>

namespace fringecal::fitting {

Result<LineFit> fit_line(Points points_mm) {
  const std::size_t n = points_mm.size();
  if (std::string why = why_too_few(n, 2, "line"); !why.empty()) return unanswerable(std::move(why));
  const CentredPoints points = centred(points_mm, {}, n);
  if (!points.finite) return unanswerable(why_not_finite(points_mm));
  const Eigen::Vector3d& f = points.axes.values;
  const double scale_mm = points.framed.scale_mm;
  // A round cloud is as long as it is wide, up to 4 standard deviations of the ratio of two equal variances.
  const double chance = n > 2 ? 1.0 + 8.0 / std::sqrt(static_cast<double>(n)) : 1.0;
  if (!(f[2] > f[1] * chance && std::sqrt(f[2] / points.framed.n) > 4.0 * points.rounding)) {
    return unanswerable(
        fmt::format("the {} points spread {:.3g} mm along and {:.3g} mm across, which determines no line; measure a "
                    "longer part of it",
                    n, scale_mm * std::sqrt(f[2] / points.framed.n), scale_mm * std::sqrt(f[1] / points.framed.n)));
  }
  LineFit out;
  out.point_mm = points.framed.origin_mm;
  out.direction = largest_positive(points.axes.vectors.col(2));
  FitQuality& quality = out.quality;
  double sum = 0.0;
  for (const Eigen::Vector3d& p : points_mm) {
    const double d = out.direction.cross(p - out.point_mm).norm();  // eq. 4
    quality.distances_mm.push_back(d);
    sum += d * d;
  }
  const auto [low, high] = std::minmax_element(quality.distances_mm.begin(), quality.distances_mm.end());
  quality.min_mm = *low;
  quality.max_mm = *high;
  quality.n_used = n;
  quality.rejected.assign(n, false);
  quality.rms_mm = std::sqrt(sum / static_cast<double>(n));
  quality.standard_deviation_mm = standard_deviation(sum, 2.0 * static_cast<double>(n), 4);
  out.u_point_mm = quality.standard_deviation_mm / std::sqrt(static_cast<double>(n));
  out.u_direction_rad = quality.standard_deviation_mm / (scale_mm * std::sqrt(f[2]));
  return out;
}

}  // namespace fringecal::fitting

// add_projector_coordinates: u at each corner from the phase around it.
//
// Without lens distortion a plane board carries pixels to the projector coordinate by
//   u(p) = (a0 + a . d) / (1 + b . d),  d = p - corner                                                   (1)
// b is the same for the whole board up to the choice of the origin: it comes from one fit of (1) to the corners of the
// pose, and each corner then fits a0 and a to its own window, linear in both. The window is a box of one period across
// the fringes, so what repeats with the period leaves the mean alone. Reweighted by Tukey's function.
// u(a0) is the standard error from the residual scatter, widened by the residuals' correlation between neighbours: the
// effective number of pixels of a first-order autoregressive residual is n (1 - r) / (1 + r) per direction.
// [Bartlett1946] Without phase patterns residuals are those of a staircase, wholly correlated along a stripe: n is then
// the number of stripes in the window, and the scatter that of a stripe's width, w / sqrt(12).
#include "calib/board_detection.h"
#include "core/statistics.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

struct Window {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  // inclusive
};

struct LocalFit {
  double value = 0, u = 0;
  Eigen::Vector2d gradient;  // du/dp at the corner
};

/// Correlation of the residuals of neighbours `step` apart (in the image), in [0, 0.95].
double correlation(const Image<float>& residual, const Image<std::uint8_t>& used, int dx, int dy) {
  double products = 0, squares = 0;
  int n = 0;
  for (int y = 0; y + dy < used.height(); ++y) {
    for (int x = 0; x + dx < used.width(); ++x) {
      if (!used(x, y) || !used(x + dx, y + dy)) continue;
      const double a = residual(x, y), b = residual(x + dx, y + dy);
      products += a * b;
      squares += 0.5 * (a * a + b * b);
      ++n;
    }
  }
  return n > 8 && squares > 0 ? std::clamp(products / squares, 0.0, 0.95) : 0.0;
}

/// Eq. 1 with b given, over the window. Empty: too few valid pixels, or they lie on one side of the corner.
std::optional<LocalFit> fit_window(const decode::PhaseMap& map, const Eigen::Vector2d& corner, const Window& w,
                                   const Eigen::Vector2d& b) {
  const bool staircase = map.code.phase_steps == 0;
  const double period = map.code.period, stripe = map.code.stripe_width();
  struct Sample {
    int x, y;
    Eigen::Vector3d row;
    double value, weight;
  };
  std::vector<Sample> samples;
  std::vector<double> noise;
  for (int y = w.y0; y <= w.y1; ++y) {
    for (int x = w.x0; x <= w.x1; ++x) {
      if (map.valid(x, y)) noise.push_back(map.u_phase_rad(x, y));
    }
  }
  const int area = (w.x1 - w.x0 + 1) * (w.y1 - w.y0 + 1);
  if (static_cast<int>(noise.size()) < std::max(16, area / 4)) return std::nullopt;
  const double typical = median(noise);
  std::size_t quadrant[4] = {0, 0, 0, 0};
  for (int y = w.y0; y <= w.y1; ++y) {
    for (int x = w.x0; x <= w.x1; ++x) {
      if (!map.valid(x, y)) continue;
      const Eigen::Vector2d d = Eigen::Vector2d(x, y) - corner;
      const double denominator = 1.0 + b.dot(d);
      if (!(denominator > 0.1)) continue;
      const double u_phase = map.u_phase_rad(x, y);
      // A dark square's noise lowers its weight, but never so far that one colour alone decides.
      const double weight = typical > 0 ? 2.0 * typical * typical / (u_phase * u_phase + typical * typical) : 1.0;
      samples.push_back({x, y, Eigen::Vector3d(1, d.x(), d.y()) / denominator, map.u_at(x, y), weight});
      ++quadrant[(d.x() > 0 ? 1 : 0) + (d.y() > 0 ? 2 : 0)];
    }
  }
  for (const std::size_t q : quadrant) {
    if (q < 2) return std::nullopt;
  }

  Eigen::Vector3d a = Eigen::Vector3d::Zero();
  Eigen::Matrix3d normal;
  std::vector<double> robust(samples.size(), 1.0), residual(samples.size());
  double scale = 0;
  const double origin = [&] {
    std::vector<double> values;
    values.reserve(samples.size());
    for (const Sample& s : samples) values.push_back(s.value);
    return median(values);
  }();
  for (int pass = 0; pass < 8; ++pass) {
    normal.setZero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const double weight = samples[k].weight * robust[k];
      normal += weight * samples[k].row * samples[k].row.transpose();
      // origin is taken off the coordinate itself: (u - origin) has the same form as eq. 1.
      right += weight * samples[k].row * (samples[k].value - origin);
    }
    // (u - origin)(1 + b d) = a0' + a' d with a0' = a0 - origin, a' = a - origin b.
    a = normal.ldlt().solve(right);
    if (!a.allFinite()) return std::nullopt;
    std::vector<double> sizes;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      residual[k] = samples[k].value - origin - samples[k].row.dot(a);
      sizes.push_back(std::abs(residual[k]));
    }
    scale = std::max(1.4826 * median(std::move(sizes)), 1e-6 * period);
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const double z = residual[k] / (4.685 * scale);
      robust[k] = std::abs(z) < 1 ? (1 - z * z) * (1 - z * z) : 0.0;
    }
  }

  double squares = 0, weights = 0, weights2 = 0, low = 1e300, high = -1e300;
  Image<float> map_of_residuals(w.x1 - w.x0 + 1, w.y1 - w.y0 + 1);
  Image<std::uint8_t> used(w.x1 - w.x0 + 1, w.y1 - w.y0 + 1);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const double weight = samples[k].weight * robust[k];
    if (!(weight > 0)) continue;
    squares += weight * residual[k] * residual[k];
    weights += weight;
    weights2 += weight * weight;
    low = std::min(low, samples[k].value);
    high = std::max(high, samples[k].value);
    map_of_residuals(samples[k].x - w.x0, samples[k].y - w.y0) = static_cast<float>(residual[k]);
    used(samples[k].x - w.x0, samples[k].y - w.y0) = 1;
  }
  if (!(weights > 0)) return std::nullopt;
  const double n_effective = weights * weights / weights2;
  if (n_effective < 12 || n_effective < 0.4 * static_cast<double>(samples.size())) return std::nullopt;

  LocalFit fit;
  fit.value = origin + a[0];
  fit.gradient = a.tail<2>() - a[0] * b;
  const Eigen::Matrix3d inverse = normal.inverse();
  if (staircase) {
    const double stripes = std::max(1.0, (high - low) / stripe);
    fit.u = stripe / std::sqrt(12.0 * stripes);
  } else {
    double widening = 1.0;
    for (const auto& [dx, dy] : {std::pair(1, 0), std::pair(0, 1)}) {
      const double r = correlation(map_of_residuals, used, dx, dy);
      widening *= (1 + r) / (1 - r);
    }
    // Variance of a0 for weights that are not the inverse variances: scatter times the kernel's sum of squares.
    const double variance = squares / weights * n_effective / std::max(1.0, n_effective - 3.0);
    fit.u = std::sqrt(variance * inverse(0, 0) * (weights2 / weights) * widening);
  }
  if (!std::isfinite(fit.value) || !(fit.u > 0) || !std::isfinite(fit.u)) return std::nullopt;
  return fit;
}

Window window_around(const decode::PhaseMap& map, const Eigen::Vector2d& corner, double half_x, double half_y) {
  // Symmetric about the corner's nearest pixel.
  const int x = static_cast<int>(std::lround(corner.x())), y = static_cast<int>(std::lround(corner.y()));
  const int hx = std::min({static_cast<int>(std::lround(half_x)), x, map.width() - 1 - x});
  const int hy = std::min({static_cast<int>(std::lround(half_y)), y, map.height() - 1 - y});
  return {x - hx, x + hx, y - hy, y + hy};
}

/// Distance to the nearest other corner, pixels.
double spacing_px(const model::BoardObservation& o, std::size_t k) {
  double nearest = 1e300;
  for (std::size_t i = 0; i < o.corners.size(); ++i) {
    if (i != k) nearest = std::min(nearest, (o.corners[i].pixel - o.corners[k].pixel).norm());
  }
  return nearest;
}

/// b of eq. 1 for the whole board with the origin in the image's (0, 0), from the corners' values; zero where it cannot
/// be told. Linear in (a0, a, b): u = a0 + a . p - u b . p.
Eigen::Vector2d board_denominator(const std::vector<Eigen::Vector2d>& pixels, const std::vector<double>& values) {
  if (pixels.size() < 12) return Eigen::Vector2d::Zero();
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  double mean = 0;
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    middle += pixels[k] / static_cast<double>(pixels.size());
    mean += values[k] / static_cast<double>(values.size());
  }
  double size = 0, range = 0;
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    size = std::max(size, (pixels[k] - middle).norm());
    range = std::max(range, std::abs(values[k] - mean));
  }
  if (!(size > 0) || !(range > 0)) return Eigen::Vector2d::Zero();
  Eigen::Matrix<double, 5, 1> s = Eigen::Matrix<double, 5, 1>::Zero();
  std::vector<double> robust(pixels.size(), 1.0);
  for (int pass = 0; pass < 6; ++pass) {
    Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
    std::vector<Eigen::Matrix<double, 5, 1>> rows;
    for (std::size_t k = 0; k < pixels.size(); ++k) {
      const Eigen::Vector2d p = (pixels[k] - middle) / size;
      const double v = (values[k] - mean) / range;
      Eigen::Matrix<double, 5, 1> row;
      row << 1, p.x(), p.y(), -v * p.x(), -v * p.y();
      rows.push_back(row);
      normal += robust[k] * row * row.transpose();
      right += robust[k] * row * v;
    }
    s = normal.ldlt().solve(right);
    std::vector<double> sizes;
    for (std::size_t k = 0; k < pixels.size(); ++k)
      sizes.push_back(std::abs((values[k] - mean) / range - rows[k].dot(s)));
    const double scale = std::max(1.4826 * median(sizes), 1e-12);
    for (std::size_t k = 0; k < pixels.size(); ++k) robust[k] = sizes[k] < 4 * scale ? 1.0 : 0.0;
  }
  const Eigen::Vector2d b = s.tail<2>() / size;  // origin in `middle`
  const double at_zero = 1.0 - b.dot(middle);
  if (!s.allFinite() || !(at_zero > 0.1)) return Eigen::Vector2d::Zero();
  return b / at_zero;
}

}  // namespace

void add_projector_coordinates(model::BoardObservation& observation, const decode::PhaseMap& map) {
  const bool staircase = map.code.phase_steps == 0;
  // The staircase repeats with the stripe; it takes several of them for a slope.
  const double period = staircase ? 10.0 * map.code.stripe_width() : map.code.period;
  const auto coordinate = [&](model::CornerObservation& c) -> std::optional<Uncertain>& {
    return map.axis == CodeAxis::x ? c.x : c.y;
  };
  const auto half_sides = [&](std::size_t k, const Eigen::Vector2d& gradient) {
    // 0.9 of the way to the next corner: a board's margin is usually a square wide.
    const double limit = 0.9 * spacing_px(observation, k);
    const double slope = std::max(gradient.norm(), 1e-12);
    const Eigen::Vector2d across = gradient.cwiseAbs() / slope;
    const double half_period = 0.5 * period / slope;
    // A box holds a whole period across the fringes along its longer side; along the fringes 8 px are enough.
    const double hx = across.x() >= across.y() ? half_period / across.x() : 8.0;
    const double hy = across.y() > across.x() ? half_period / across.y() : 8.0;
    return Eigen::Vector2d(std::min(limit, std::max(hx, 8.0)), std::min(limit, std::max(hy, 8.0)));
  };

  // First a small window for slope and value, then the board's denominator, then the windows proper.
  std::vector<std::optional<LocalFit>> first(observation.corners.size());
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> values;
  for (std::size_t k = 0; k < observation.corners.size(); ++k) {
    auto& c = observation.corners[k];
    coordinate(c).reset();
    if (!c.pixel.allFinite() || c.pixel.x() < 0 || c.pixel.y() < 0 || c.pixel.x() > map.width() - 1 ||
        c.pixel.y() > map.height() - 1) {
      continue;
    }
    const double half = std::min(12.0, 0.9 * spacing_px(observation, k));
    first[k] = fit_window(map, c.pixel, window_around(map, c.pixel, half, half), Eigen::Vector2d::Zero());
    if (!first[k]) continue;
    pixels.push_back(c.pixel);
    values.push_back(first[k]->value);
  }
  const Eigen::Vector2d b = board_denominator(pixels, values);
  for (std::size_t k = 0; k < observation.corners.size(); ++k) {
    auto& c = observation.corners[k];
    if (!first[k]) continue;
    const Eigen::Vector2d local = b / (1.0 + b.dot(c.pixel));
    const Eigen::Vector2d half = half_sides(k, first[k]->gradient);
    const auto fit = fit_window(map, c.pixel, window_around(map, c.pixel, half.x(), half.y()), local);
    if (fit) coordinate(c) = Uncertain{fit->value, fit->u};
  }
}

}  // namespace fringecal::calib

#include "metrology/deviation_map.h"

#include "core/parallel.h"
#include "core/statistics.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace fringecal::metrology {
namespace {

constexpr double kTukey = 4.685;  // 95 % efficiency on normal deviations
constexpr double kStep_mm = 0.01;
constexpr std::size_t kFewest = 100;
constexpr int kFewestInCell = 3;
constexpr double kFacing = 0.2588;  // cos 75 degrees

double robust_sd(std::vector<double> values) {
  for (double& v : values) v = std::abs(v);
  return 1.4826 * median(std::move(values));
}

Eigen::Vector3d gradient_of(const SignedDistance& d, const Eigen::Vector3d& x) {
  Eigen::Vector3d out;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d h = kStep_mm * Eigen::Vector3d::Unit(i);
    out[i] = (d(x + h) - d(x - h)) / (2 * kStep_mm);
  }
  return out;
}

/// The smallest h with that share of the sizes at or below it.
double half_width(std::vector<double>& sizes, double share) {
  const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(sizes.size() - 1));
  std::nth_element(sizes.begin(), sizes.begin() + k, sizes.end());
  return sizes[static_cast<std::size_t>(k)];
}

struct Sample {
  Eigen::Vector3d x;
  double d;
};

std::vector<Sample> near_samples(const PointCloud& cloud, const SignedDistance& surface, const Rigid3& motion,
                                 const DeviationOptions& o) {
  const std::size_t step = std::max<std::size_t>(1, cloud.points.size() / o.samples);
  std::vector<Sample> out;
  for (std::size_t i = 0; i < cloud.points.size(); i += step) {
    const Eigen::Vector3d x = motion * cloud.points[i].position_mm;
    const double d = surface(x);
    if (std::abs(d) <= o.max_distance_mm) out.push_back({x, d});
  }
  return out;
}

/// One step of eq. 1; x -> x + w x x + t in `body`. Returns how far a point at 100 mm moves.
double improve(const std::vector<Sample>& samples, const SignedDistance& surface, Rigid3& motion) {
  std::vector<double> values;
  values.reserve(samples.size());
  for (const auto& s : samples) values.push_back(s.d);
  const double s = std::max(robust_sd(std::move(values)), 1e-9);
  using Row = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Row right = Row::Zero();
  for (const auto& sample : samples) {
    const double q = 1 - std::pow(sample.d / (kTukey * s), 2);
    if (!(q > 0)) continue;
    const Eigen::Vector3d n = gradient_of(surface, sample.x);
    Row row;
    row << sample.x.cross(n), n;
    normal += q * q * row * row.transpose();
    right -= q * q * sample.d * row;
  }
  const Row step = normal.ldlt().solve(right);
  const Eigen::Vector3d w = step.head<3>(), t = step.tail<3>();
  motion = Rigid3{rotation_from_vector(w), t} * motion;
  motion.rotation.normalize();
  return t.norm() + 100 * w.norm();
}

}  // namespace

Result<DeviationMap> deviation_map(const PointCloud& cloud, const SignedDistance& surface, const Rigid3& start,
                                   const DeviationOptions& options) {
  DeviationMap out{.body_from_part = start};
  for (out.iterations = 1; out.iterations <= options.max_iterations; ++out.iterations) {
    const auto samples = near_samples(cloud, surface, out.body_from_part, options);
    if (samples.size() < kFewest) {
      return unanswerable(
          fmt::format("only {} of the cloud's sampled points lie within {} mm of the surface; the start is wrong, or "
                      "the surface is another body's",
                      samples.size(), options.max_distance_mm));
    }
    if (improve(samples, surface, out.body_from_part) < 1e-5) break;
  }
  out.deviation_mm.resize(cloud.points.size());
  constexpr std::size_t kBlock = 4096;
  parallel_for(static_cast<int>((cloud.points.size() + kBlock - 1) / kBlock), [&](int block) {
    const std::size_t first = static_cast<std::size_t>(block) * kBlock;
    for (std::size_t i = first; i < std::min(first + kBlock, cloud.points.size()); ++i) {
      out.deviation_mm[i] = static_cast<float>(surface(out.body_from_part * cloud.points[i].position_mm));
    }
  });
  std::vector<double> sizes;
  double squares = 0;
  for (const float d : out.deviation_mm) {
    if (!(std::abs(d) <= options.max_distance_mm)) continue;
    out.mean_mm += d;
    squares += static_cast<double>(d) * d;
    sizes.push_back(std::abs(d));
  }
  if (sizes.size() < kFewest) return unanswerable("too few points lie near the surface");
  const auto n = static_cast<double>(sizes.size());
  out.n_points = sizes.size();
  out.n_beyond = out.deviation_mm.size() - sizes.size();
  out.mean_mm /= n;
  out.sd_mm = std::sqrt(std::max(0.0, (squares - n * out.mean_mm * out.mean_mm) / (n - 1)));
  out.width_95_mm = 2 * half_width(sizes, 0.95);
  out.width_997_mm = 2 * half_width(sizes, 0.997);
  return out;
}

std::vector<DeviationView> views_of(const PointCloud& cloud, const DeviationMap& map, double cell_mm) {
  struct Side {
    const char* name;
    Eigen::Vector3d right, towards;
  };
  const std::array sides = {
      Side{"from the front (+z)", Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()},
      Side{"from the right (+x)", -Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitX()},
      Side{"from behind (-z)", -Eigen::Vector3d::UnitX(), -Eigen::Vector3d::UnitZ()},
      Side{"from the left (-x)", Eigen::Vector3d::UnitZ(), -Eigen::Vector3d::UnitX()},
  };
  std::vector<DeviationView> out;
  for (const auto& side : sides) {
    struct Seen {
      double right, up;
      float d;
    };
    std::vector<Seen> seen;
    double left = std::numeric_limits<double>::infinity(), right = -left, top = -left, bottom = left;
    for (std::size_t i = 0; i < cloud.points.size(); ++i) {
      const auto& p = cloud.points[i];
      if (!(std::abs(map.deviation_mm[i]) <= DeviationOptions{}.max_distance_mm)) continue;
      if (!(side.towards.dot(map.body_from_part.rotation * p.normal) >= kFacing)) continue;
      const Eigen::Vector3d x = map.body_from_part * p.position_mm;
      seen.push_back({side.right.dot(x), x.y(), map.deviation_mm[i]});
      left = std::min(left, seen.back().right);
      right = std::max(right, seen.back().right);
      top = std::max(top, x.y());
      bottom = std::min(bottom, x.y());
    }
    if (seen.empty()) continue;
    const int width = static_cast<int>((right - left) / cell_mm) + 1,
              height = static_cast<int>((top - bottom) / cell_mm) + 1;
    Image<double> sum(width, height);
    Image<int> count(width, height);
    for (const auto& s : seen) {
      const int x = static_cast<int>((s.right - left) / cell_mm), y = static_cast<int>((top - s.up) / cell_mm);
      sum(x, y) += s.d;
      ++count(x, y);
    }
    DeviationView view{
        .name = side.name, .left_mm = left + 0.5 * cell_mm, .top_mm = top - 0.5 * cell_mm, .cell_mm = cell_mm};
    view.mean_mm = Image<float>(width, height, std::numeric_limits<float>::quiet_NaN());
    double total = 0, squares = 0, cells = 0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        if (count(x, y) < kFewestInCell) continue;
        const double mean = sum(x, y) / count(x, y);
        view.mean_mm(x, y) = static_cast<float>(mean);
        total += mean;
        squares += mean * mean;
        cells += 1;
      }
    }
    if (cells > 1) view.sd_mm = std::sqrt(std::max(0.0, (squares - total * total / cells) / (cells - 1)));
    out.push_back(std::move(view));
  }
  return out;
}

}  // namespace fringecal::metrology

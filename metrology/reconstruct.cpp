#include "metrology/reconstruct.h"

#include "calib/model/chen2008.h"
#include "calib/model/triangulate.h"
#include "core/error.h"
#include "core/parallel.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::metrology {
namespace {

constexpr double kMaxStep = 6.0;    // footprints
constexpr int kNormalHalf = 2;      // half the side of the neighbourhood of eq. 2, px
constexpr int kMinNeighbours = 13;  // of 25: more than half, so that the middle is not an outer corner

enum class Fate : std::uint8_t { point, invalid, no_intersection, edge, noisy, grazing };

void check_they_belong_together(const decode::PhaseMap& map, const model::Scanner& scanner) {
  const model::Camera& camera = scanner.camera;
  if (map.width() != camera.width_px || map.height() != camera.height_px) {
    throw InputError(
        fmt::format("the capture is {} x {} pixels, the scanner's camera {} x {}: use the Scanner file of the "
                    "instrument that took the capture",
                    map.width(), map.height(), camera.width_px, camera.height_px));
  }
  const auto& coded = scanner.projector.axis(map.axis);
  if (!coded) throw InputError("the scanner was not calibrated along the axis of this capture's code");
  const FringeCode &ours = map.code, &theirs = coded->code;
  if (ours.unit != theirs.unit || ours.period != theirs.period || ours.gray_bits != theirs.gray_bits ||
      ours.stripes_per_period != theirs.stripes_per_period) {
    throw InputError(
        fmt::format("the capture's code ({} bits, period {} {}, {} stripes per period) is not the scanner's ({} "
                    "bits, period {} {}, {} stripes per period)",
                    ours.gray_bits, ours.period, ours.unit, ours.stripes_per_period, theirs.gray_bits, theirs.period,
                    theirs.unit, theirs.stripes_per_period));
  }
}

/// The closed form's parameters: fitted where the Scanner has them, else geometric.
model::Chen2008Model closed_form_of(const model::Scanner& scanner, ReconstructionModel kind) {
  const auto& fitted = kind == ReconstructionModel::ideal ? scanner.paper_ideal_model : scanner.paper_model;
  return fitted ? fitted->model : model::chen2008_from(scanner);
}

/// The point of every pixel in cam, its u along the ray, and what became of it.
struct Field {
  Image<Eigen::Vector3d> point_in_cam;
  Image<float> u_along_ray_mm;
  Image<Fate> fate;
};

Field triangulate_all(const decode::PhaseMap& map, const model::Scanner& scanner, ReconstructionModel kind) {
  const int width = map.width(), height = map.height();
  Field field{Image<Eigen::Vector3d>(width, height, Eigen::Vector3d::Zero()), Image<float>(width, height),
              Image<Fate>(width, height, Fate::invalid)};
  const bool closed_form = kind != ReconstructionModel::full;
  if (closed_form && map.axis != scanner.projector.main_axis()) {
    throw InputError("the closed form measures along the scanner's main code axis only; use the full model");
  }
  const model::Chen2008Model paper = closed_form ? closed_form_of(scanner, kind) : model::Chen2008Model{};
  const Image<double> phi_ref = closed_form ? model::reference_phase(scanner) : Image<double>();
  const Rigid3 cam_from_world = scanner.world_from_cam().inverse();
  const double mm_per_rad = map.code.period / (2.0 * std::numbers::pi);

  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!map.valid(x, y)) continue;
      field.fate(x, y) = Fate::no_intersection;
      const Eigen::Vector2d pixel(x, y);
      const auto ray = scanner.camera.ray(pixel);
      if (!ray) continue;
      Eigen::Vector3d point = Eigen::Vector3d::Zero();
      if (!closed_form) {
        const auto met =
            model::triangulate_ray(scanner.projector, scanner.proj_from_cam, map.axis, *ray, map.u_at(x, y));
        if (!met) continue;
        point = *met;
      } else {
        if (!std::isfinite(phi_ref(x, y))) continue;
        const bool distorted = kind == ReconstructionModel::chen2008;
        const auto in_world = paper.point_mm(pixel, map.phase_rad(x, y), phi_ref(x, y), distorted);
        if (!in_world) continue;
        point = cam_from_world * *in_world;
      }
      // Eq. 1 by a central difference of 0.02 mm: its error, the third derivative, is below 1e-9 of du/dl.
      const Eigen::Vector3d direction = scanner.proj_from_cam.rotation * ray->normalized();
      const Eigen::Vector3d in_proj = scanner.proj_from_cam * point;
      const auto ahead = scanner.projector.project(map.axis, in_proj + 0.01 * direction);
      const auto behind = scanner.projector.project(map.axis, in_proj - 0.01 * direction);
      const double slope = ahead && behind ? std::abs(*ahead - *behind) / 0.02 : 0.0;
      if (!(slope > 0)) continue;
      field.point_in_cam(x, y) = point;
      field.u_along_ray_mm(x, y) = static_cast<float>(mm_per_rad * map.u_phase_rad(x, y) / slope);
      field.fate(x, y) = Fate::point;
    }
  });
  return field;
}

/// Whether two measured pixels, `distance_px` apart, lie on one surface.
class Continuity {
 public:
  Continuity(const Field& field, const model::Camera& camera) : field_(field), per_px_(1.0 / camera.fx_px) {}

  bool operator()(int x0, int y0, int x1, int y1, double distance_px) const {
    const Eigen::Vector3d& a = field_.point_in_cam(x0, y0);
    const Eigen::Vector3d& b = field_.point_in_cam(x1, y1);
    const double limit = kMaxStep * per_px_ * a.z() * distance_px +
                         6.0 * (field_.u_along_ray_mm(x0, y0) + field_.u_along_ray_mm(x1, y1));
    return (a - b).squaredNorm() <= limit * limit;
  }

 private:
  const Field& field_;
  double per_px_;
};

/// Marks everything within `reach` pixels (the larger of |dx|, |dy|) of a marked pixel.
Image<std::uint8_t> widened(const Image<std::uint8_t>& marks, int reach) {
  const int width = marks.width(), height = marks.height();
  Image<std::uint8_t> across(width, height), out(width, height);
  parallel_for(height, [&](int y) {
    int last = -1'000'000;  // running distance from the left, then from the right
    for (int x = 0; x < width; ++x) {
      if (marks(x, y)) last = x;
      across(x, y) = x - last <= reach;
    }
    last = 1'000'000;
    for (int x = width - 1; x >= 0; --x) {
      if (marks(x, y)) last = x;
      across(x, y) |= last - x <= reach;
    }
  });
  parallel_for(height, [&](int y) {
    for (int r = std::max(0, y - reach); r <= std::min(height - 1, y + reach); ++r) {
      for (int x = 0; x < width; ++x) out(x, y) |= across(x, r);
    }
  });
  return out;
}

void leave_out_edges(Field& field, const Continuity& continuous, int margin) {
  if (margin <= 0) return;
  const int width = field.fate.width(), height = field.fate.height();
  Image<std::uint8_t> missing(width, height), jump(width, height);
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      missing(x, y) = field.fate(x, y) != Fate::point;
      if (missing(x, y)) continue;
      constexpr int kSteps[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
      for (const auto& step : kSteps) {
        const int i = x + step[0], j = y + step[1];
        if (!field.fate.contains(i, j) || field.fate(i, j) != Fate::point) continue;
        if (!continuous(x, y, i, j, 1.0)) jump(x, y) = 1;
      }
    }
  });
  const auto near_missing = widened(missing, margin);
  const auto near_jump = widened(jump, margin - 1);  // a marked pixel is itself one pixel from the other surface
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (field.fate(x, y) == Fate::point && (near_missing(x, y) || near_jump(x, y))) field.fate(x, y) = Fate::edge;
    }
  });
}

/// Eq. 2 in cam, towards the camera; zero where it is not sensible. Edge pixels do not take part.
Eigen::Vector3d normal_at(const Field& field, const Continuity& continuous, int x, int y) {
  int n = 0;
  double sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  Eigen::Vector3d s = Eigen::Vector3d::Zero(), sxp = s, syp = s;
  const Eigen::Vector3d origin = field.point_in_cam(x, y);
  for (int dy = -kNormalHalf; dy <= kNormalHalf; ++dy) {
    for (int dx = -kNormalHalf; dx <= kNormalHalf; ++dx) {
      const int i = x + dx, j = y + dy;
      if (!field.fate.contains(i, j) || field.fate(i, j) != Fate::point) continue;
      if (!continuous(x, y, i, j, std::max(std::abs(dx), std::abs(dy)))) continue;
      const Eigen::Vector3d p = field.point_in_cam(i, j) - origin;
      ++n;
      sx += dx;
      sy += dy;
      sxx += dx * dx;
      sxy += dx * dy;
      syy += dy * dy;
      s += p;
      sxp += dx * p;
      syp += dy * p;
    }
  }
  if (n < kMinNeighbours) return Eigen::Vector3d::Zero();
  const double xx = sxx - sx * sx / n, xy = sxy - sx * sy / n, yy = syy - sy * sy / n;
  const Eigen::Vector3d xp = sxp - sx / n * s, yp = syp - sy / n * s;
  // The slopes times the determinant, which is positive for 13 pixels of a 5 x 5 square.
  const Eigen::Vector3d normal = (yy * xp - xy * yp).cross(xx * yp - xy * xp);
  const double length = normal.norm();
  if (!(length > 0)) return Eigen::Vector3d::Zero();
  return normal.dot(origin) > 0 ? Eigen::Vector3d(-normal / length) : Eigen::Vector3d(normal / length);
}

}  // namespace

Reconstruction reconstruct(const decode::PhaseMap& map, const model::Scanner& scanner,
                           const ReconstructOptions& options) {
  check_they_belong_together(map, scanner);
  Field field = triangulate_all(map, scanner, options.model);
  const Continuity continuous(field, scanner.camera);
  leave_out_edges(field, continuous, options.edge_margin_px);

  const Rigid3 world_from_cam = scanner.world_from_cam();
  const Eigen::Matrix3d rotation = world_from_cam.rotation_matrix();
  require(options.normals || !options.max_incidence_deg, "grazing points are found by their normals");
  const double min_cosine =
      options.max_incidence_deg ? std::cos(*options.max_incidence_deg * std::numbers::pi / 180) : -1.0;
  const Eigen::Vector3d light_in_cam = scanner.proj_from_cam.inverse().translation_mm;
  std::vector<std::vector<CloudPoint>> rows(static_cast<std::size_t>(map.height()));
  std::vector<std::array<std::size_t, 6>> counts(rows.size());
  parallel_for(map.height(), [&](int y) {
    counts[y] = {};
    for (int x = 0; x < map.width(); ++x) {
      Fate fate = field.fate(x, y);
      // Written so that a NaN is refused.
      if (fate == Fate::point && !(field.u_along_ray_mm(x, y) <= options.max_u_along_ray_mm)) fate = Fate::noisy;
      Eigen::Vector3d normal = Eigen::Vector3d::Zero();
      if (fate == Fate::point && options.normals) {
        normal = normal_at(field, continuous, x, y);
        const Eigen::Vector3d p = field.point_in_cam(x, y);
        const auto faces = [&](const Eigen::Vector3d& pupil) {
          return normal.dot((pupil - p).normalized()) >= min_cosine;
        };
        if (!normal.isZero() && !(faces(Eigen::Vector3d::Zero()) && faces(light_in_cam))) fate = Fate::grazing;
      }
      ++counts[y][static_cast<std::size_t>(fate)];
      if (fate != Fate::point) continue;
      CloudPoint& point = rows[y].emplace_back();
      point.position_mm = rotation * field.point_in_cam(x, y) + world_from_cam.translation_mm;
      point.normal = rotation * normal;
      point.u_along_ray_mm = field.u_along_ray_mm(x, y);
      point.modulation = map.modulation(x, y);
      point.pixel_x = static_cast<std::uint16_t>(x);
      point.pixel_y = static_cast<std::uint16_t>(y);
    }
  });
  Reconstruction out;
  std::size_t total = 0;
  for (const auto& row : rows) total += row.size();
  out.cloud.points.reserve(total);
  for (std::size_t y = 0; y < rows.size(); ++y) {
    out.cloud.points.insert(out.cloud.points.end(), rows[y].begin(), rows[y].end());
    out.n_invalid += counts[y][static_cast<std::size_t>(Fate::invalid)];
    out.n_no_intersection += counts[y][static_cast<std::size_t>(Fate::no_intersection)];
    out.n_edge += counts[y][static_cast<std::size_t>(Fate::edge)];
    out.n_grazing += counts[y][static_cast<std::size_t>(Fate::grazing)];
    out.n_noisy += counts[y][static_cast<std::size_t>(Fate::noisy)];
  }
  return out;
}

}  // namespace fringecal::metrology

#include "metrology/reconstruct.h"

#include "calib/model/chen2008.h"
#include "calib/model/triangulate.h"
#include "calib/model/triangulate_span.h"
#include "core/error.h"
#include "core/parallel.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

namespace fringecal::metrology {
namespace {

constexpr double kMaxStep = 6.0;    // footprints
constexpr int kNormalHalf = 2;      // half the side of the neighbourhood of eq. 2, px
constexpr int kMinNeighbours = 13;  // of 25: more than half, so that the middle is not an outer corner

enum class Fate : std::uint8_t { point, invalid, no_intersection, edge, noisy, grazing, low_modulation, isolated };
constexpr std::size_t kFates = 8;

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

}  // namespace

struct Reconstructor::Tables {
  model::Scanner scanner;
  model::RayTable rays;
  std::optional<Image<double>> phi_ref;
  Field field;

  void triangulate_all(const decode::PhaseMap& map);
  void use_closed_form(const decode::PhaseMap& map, ReconstructionModel kind);
};

void Reconstructor::Tables::triangulate_all(const decode::PhaseMap& map) {
  model::SpanTask task = model::span_task(scanner.projector, scanner.proj_from_cam, map.axis);
  task.ray_x = rays.x.data();
  task.ray_y = rays.y.data();
  task.phase_rad = map.phase_rad.data();
  task.points_mm = field.point_in_cam.data();
  const double mm_per_rad = map.code.period / (2.0 * std::numbers::pi);
  parallel_for(map.height(), [&](int y) {
    const std::size_t first = map.validity.index(0, y), width = static_cast<std::size_t>(map.width());
    std::vector<double> slopes(width);
    model::SpanTask row = task;
    row.du_per_mm = slopes.data() - first;
    model::triangulate_span(row, first, width);
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = first + x;
      Fate& fate = field.fate.values()[i];
      fate = map.validity.values()[i] == 0 ? Fate::no_intersection : Fate::invalid;
      if (fate == Fate::invalid) continue;
      Eigen::Vector3d& point = field.point_in_cam.values()[i];
      double slope = slopes[x];
      if (!(slope > 0)) {  // rare: in its own way, or nowhere
        const Eigen::Vector3d ray(rays.x.values()[i], rays.y.values()[i], 1.0);
        const auto met = model::triangulate_ray(scanner.projector, scanner.proj_from_cam, map.axis, ray,
                                                map.code.u_from_phase(map.phase_rad.values()[i]));
        const auto its_slope =
            met ? model::du_per_mm(scanner.projector, scanner.proj_from_cam, map.axis, *met, ray) : std::nullopt;
        if (!its_slope) continue;
        point = *met;
        slope = *its_slope;
      }
      field.u_along_ray_mm.values()[i] = static_cast<float>(mm_per_rad * map.u_phase_rad.values()[i] / slope);  // (1)
      fate = Fate::point;
    }
  });
}

void Reconstructor::Tables::use_closed_form(const decode::PhaseMap& map, ReconstructionModel kind) {
  if (map.axis != scanner.projector.main_axis()) {
    throw InputError("the closed form measures along the scanner's main code axis only; use the full model");
  }
  const model::Chen2008Model paper = closed_form_of(scanner, kind);
  if (!phi_ref) phi_ref = model::reference_phase(scanner);
  const Rigid3 cam_from_world = scanner.world_from_cam().inverse();
  const double mm_per_rad = map.code.period / (2.0 * std::numbers::pi);
  const bool distorted = kind == ReconstructionModel::chen2008;
  parallel_for(map.height(), [&](int y) {
    for (int x = 0; x < map.width(); ++x) {
      field.fate(x, y) = map.valid(x, y) ? Fate::no_intersection : Fate::invalid;
      if (!map.valid(x, y) || !std::isfinite((*phi_ref)(x, y))) continue;
      const auto in_world = paper.point_mm(Eigen::Vector2d(x, y), map.phase_rad(x, y), (*phi_ref)(x, y), distorted);
      if (!in_world) continue;
      const Eigen::Vector3d point = cam_from_world * *in_world;
      const auto slope = model::du_per_mm(scanner.projector, scanner.proj_from_cam, map.axis, point,
                                          Eigen::Vector3d(rays.x(x, y), rays.y(x, y), 1.0));
      if (!slope) continue;
      field.point_in_cam(x, y) = point;
      field.u_along_ray_mm(x, y) = static_cast<float>(mm_per_rad * map.u_phase_rad(x, y) / *slope);
      field.fate(x, y) = Fate::point;
    }
  });
}

namespace {

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
  std::vector<std::uint8_t> any(static_cast<std::size_t>(height));  // most rows have no mark
  parallel_for(height, [&](int y) {
    const auto from = marks.row(y);
    any[static_cast<std::size_t>(y)] = std::memchr(from.data(), 1, from.size()) != nullptr;
    if (!any[static_cast<std::size_t>(y)]) return;
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
      if (!any[static_cast<std::size_t>(r)]) continue;
      for (int x = 0; x < width; ++x) out(x, y) |= across(x, r);
    }
  });
  return out;
}

void leave_out_edges(Field& field, const Continuity& continuous, int margin) {
  if (margin <= 0) return;
  const int width = field.fate.width(), height = field.fate.height();
  // Bit 0: a jump to the pixel on the right, bit 1: to the one below; each pair of neighbours is looked at once.
  Image<std::uint8_t> missing(width, height), jumps(width, height), jump(width, height);
  std::vector<std::uint8_t> any(static_cast<std::size_t>(height));
  parallel_for(height, [&](int y) {
    const Fate* const here = field.fate.row(y).data();
    const Fate* const below = y + 1 < height ? field.fate.row(y + 1).data() : nullptr;
    std::uint8_t found = 0;
    for (int x = 0; x < width; ++x) {
      missing(x, y) = here[x] != Fate::point;
      if (missing(x, y)) continue;
      const bool right = x + 1 < width && here[x + 1] == Fate::point && !continuous(x, y, x + 1, y, 1.0);
      const bool down = below && below[x] == Fate::point && !continuous(x, y, x, y + 1, 1.0);
      jumps(x, y) = static_cast<std::uint8_t>(right | (down << 1));
      found |= jumps(x, y);
    }
    any[static_cast<std::size_t>(y)] = found;
  });
  parallel_for(height, [&](int y) {
    if (!any[static_cast<std::size_t>(y)] && !(y > 0 && any[static_cast<std::size_t>(y - 1)])) return;
    for (int x = 0; x < width; ++x) {
      jump(x, y) = jumps(x, y) || (x > 0 && (jumps(x - 1, y) & 1)) || (y > 0 && (jumps(x, y - 1) & 2));
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

void leave_out_dim(Field& field, const Image<float>& modulation, double least) {
  for (std::size_t i = 0; i < field.fate.values().size(); ++i) {
    Fate& fate = field.fate.values()[i];
    if (fate == Fate::point && !(modulation.values()[i] >= least)) fate = Fate::low_modulation;
  }
}

/// Piece after piece, each grown from its first pixel.
void leave_out_isolated(Field& field, const Continuity& continuous, std::size_t min_piece) {
  const int width = field.fate.width(), height = field.fate.height();
  Image<std::uint8_t> known(width, height);
  std::vector<std::pair<int, int>> piece;
  for (int y0 = 0; y0 < height; ++y0) {
    for (int x0 = 0; x0 < width; ++x0) {
      if (known(x0, y0) || field.fate(x0, y0) != Fate::point) continue;
      piece.assign(1, {x0, y0});
      known(x0, y0) = 1;
      for (std::size_t k = 0; k < piece.size(); ++k) {
        const auto [x, y] = piece[k];
        for (const auto& [i, j] : {std::pair(x + 1, y), {x - 1, y}, {x, y + 1}, {x, y - 1}}) {
          if (!field.fate.contains(i, j) || known(i, j) || field.fate(i, j) != Fate::point) continue;
          if (!continuous(x, y, i, j, 1.0)) continue;
          known(i, j) = 1;
          piece.emplace_back(i, j);
        }
      }
      if (piece.size() >= min_piece) continue;
      for (const auto& [x, y] : piece) field.fate(x, y) = Fate::isolated;
    }
  }
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

Reconstructor::Reconstructor(const model::Scanner& scanner)
    : tables_(std::make_unique<Tables>(Tables{scanner, model::ray_table(scanner.camera), std::nullopt, {}})) {}
Reconstructor::~Reconstructor() = default;

Reconstruction Reconstructor::operator()(const decode::PhaseMap& map, const ReconstructOptions& options,
                                         Reconstruction earlier) {
  const model::Scanner& scanner = tables_->scanner;
  check_they_belong_together(map, scanner);
  Field& field = tables_->field;
  const int width = map.width(), height = map.height();
  if (field.fate.width() != width || field.fate.height() != height) {
    field = {Image<Eigen::Vector3d>(width, height, Eigen::Vector3d::Zero()), Image<float>(width, height),
             Image<Fate>(width, height)};
  }
  if (options.model == ReconstructionModel::full) {
    tables_->triangulate_all(map);
  } else {
    tables_->use_closed_form(map, options.model);
  }
  const Continuity continuous(field, scanner.camera);
  leave_out_edges(field, continuous, options.edge_margin_px);
  if (options.min_modulation > 0) leave_out_dim(field, map.modulation, options.min_modulation);
  if (options.min_piece > 1) leave_out_isolated(field, continuous, static_cast<std::size_t>(options.min_piece));

  const Rigid3 world_from_cam = scanner.world_from_cam();
  const Eigen::Matrix3d rotation = world_from_cam.rotation_matrix();
  require(options.normals || !options.max_incidence_deg, "grazing points are found by their normals");
  const double min_cosine =
      options.max_incidence_deg ? std::cos(*options.max_incidence_deg * std::numbers::pi / 180) : -1.0;
  const Eigen::Vector3d light_in_cam = scanner.proj_from_cam.inverse().translation_mm;
  const auto fate_of = [&](int x, int y) {
    const Fate fate = field.fate(x, y);
    if (fate != Fate::point) return fate;
    // Written so that a NaN is refused. Normals are of all points, noisy ones too: their fate in the field stays.
    if (!(field.u_along_ray_mm(x, y) <= options.max_u_along_ray_mm)) return Fate::noisy;
    if (!options.max_incidence_deg) return fate;
    const Eigen::Vector3d normal = normal_at(field, continuous, x, y), p = field.point_in_cam(x, y);
    const auto faces = [&](const Eigen::Vector3d& pupil) { return normal.dot((pupil - p).normalized()) >= min_cosine; };
    return normal.isZero() || (faces(Eigen::Vector3d::Zero()) && faces(light_in_cam)) ? fate : Fate::grazing;
  };
  using Counts = std::array<std::size_t, kFates>;
  std::vector<Counts> counts(static_cast<std::size_t>(height), Counts{});
  parallel_for(height, [&](int y) {
    for (int x = 0; x < width; ++x) ++counts[static_cast<std::size_t>(y)][static_cast<std::size_t>(fate_of(x, y))];
  });
  Reconstruction out = std::move(earlier);
  Counts sums{};
  std::vector<std::size_t> starts;
  for (const Counts& row : counts) {
    starts.push_back(sums[static_cast<std::size_t>(Fate::point)]);
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += row[k];
  }
  out.n_invalid = sums[static_cast<std::size_t>(Fate::invalid)];
  out.n_no_intersection = sums[static_cast<std::size_t>(Fate::no_intersection)];
  out.n_edge = sums[static_cast<std::size_t>(Fate::edge)];
  out.n_grazing = sums[static_cast<std::size_t>(Fate::grazing)];
  out.n_low_modulation = sums[static_cast<std::size_t>(Fate::low_modulation)];
  out.n_isolated = sums[static_cast<std::size_t>(Fate::isolated)];
  out.n_noisy = sums[static_cast<std::size_t>(Fate::noisy)];
  out.cloud.points.resize(sums[static_cast<std::size_t>(Fate::point)]);
  parallel_for(height, [&](int y) {
    CloudPoint* to = out.cloud.points.data() + starts[static_cast<std::size_t>(y)];
    for (int x = 0; x < width; ++x) {
      if (fate_of(x, y) != Fate::point) continue;
      CloudPoint& point = *to++;
      point.position_mm = rotation * field.point_in_cam(x, y) + world_from_cam.translation_mm;
      point.normal = options.normals ? Eigen::Vector3d(rotation * normal_at(field, continuous, x, y))
                                     : Eigen::Vector3d(Eigen::Vector3d::Zero());
      point.u_along_ray_mm = field.u_along_ray_mm(x, y);
      point.modulation = map.modulation(x, y);
      point.pixel_x = static_cast<std::uint16_t>(x);
      point.pixel_y = static_cast<std::uint16_t>(y);
    }
  });
  return out;
}

Reconstruction reconstruct(const decode::PhaseMap& map, const model::Scanner& scanner,
                           const ReconstructOptions& options) {
  check_they_belong_together(map, scanner);
  return Reconstructor(scanner)(map, options);
}

}  // namespace fringecal::metrology

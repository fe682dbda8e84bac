#include "tests/calib/synthetic_board_views.h"

#include "core/error.h"

#include <Eigen/LU>

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <random>

namespace fringecal::test {
namespace {

constexpr double kBase = 400, kDistance = 1000;

FringeCode grating() {
  return {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
}

/// std::normal_distribution differs between libraries; this does not.
class Normal {
 public:
  explicit Normal(std::uint64_t seed) : engine_(seed) {}
  double operator()() {
    const double u1 = (static_cast<double>(engine_() >> 11) + 1.0) * 0x1.0p-53;
    const double u2 = static_cast<double>(engine_() >> 11) * 0x1.0p-53;
    return std::sqrt(-2.0 * std::log(u1)) * std::cos(2.0 * std::numbers::pi * u2);
  }

 private:
  std::mt19937_64 engine_;
};

/// What a code's coordinate changes by per pixel along the board's face at a place: phases are read at the pixel where the
/// corner was found. Central differences over 0.02 mm; the slope of the bow, 1e-3, is left out.
Eigen::RowVector2d u_by_pixel(const model::Scanner& s, CodeAxis axis, const Rigid3& pose,
                              const Eigen::Vector3d& place) {
  Eigen::Matrix2d pixel;
  Eigen::RowVector2d u;
  for (const int i : {0, 1}) {
    const Eigen::Vector3d step = 0.01 * Eigen::Vector3d::Unit(i), up = pose * (place + step),
                          down = pose * (place - step);
    pixel.col(i) = *s.camera.project(up) - *s.camera.project(down);
    u[i] = *s.projector.project(axis, s.proj_from_cam * up) - *s.projector.project(axis, s.proj_from_cam * down);
  }
  return u * pixel.inverse();
}

std::vector<model::BoardObservation> observe(const model::Scanner& scanner, const model::Board& board,
                                             const std::vector<Rigid3>& cam_from_middle, const ViewErrors& errors) {
  Normal normal(errors.seed);
  const Eigen::Vector3d last = board.corner_mm(board.columns - 1, board.rows - 1), middle = 0.5 * last;
  const double scale = 1.0 + errors.pitch_relative * normal();
  std::vector<Eigen::Vector3d> corners;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      Eigen::Vector3d p = board.corner_mm(column, row) - middle;
      const double xi = p.x() / middle.x(), eta = p.y() / middle.y();
      p.x() += errors.print_mm * normal();
      p.y() += errors.print_mm * normal();
      p *= scale;
      p.z() = errors.bow_mm * (xi * xi + eta * eta);
      corners.push_back(p);
    }
  }
  std::vector<model::BoardObservation> out;
  for (const Rigid3& pose : cam_from_middle) {
    model::BoardObservation o{fmt::format("pose_{:02}", out.size() + 1), {}};
    const Eigen::Vector3d bend = errors.bend_mm * Eigen::Vector3d{normal(), normal(), normal()};
    const Eigen::Vector2d offset = errors.phase_offset_mm * Eigen::Vector2d{normal(), normal()};
    for (int row = 0; row < board.rows; ++row) {
      for (int column = 0; column < board.columns; ++column) {
        Eigen::Vector3d place = corners[static_cast<std::size_t>(row * board.columns + column)];
        const double xi = place.x() / middle.x(), eta = place.y() / middle.y();
        place.z() += bend.dot(Eigen::Vector3d(xi * xi, eta * eta, xi * eta));
        const Eigen::Vector3d in_cam = pose * place;
        const Eigen::Vector3d in_proj = scanner.proj_from_cam * in_cam;
        const auto pixel = scanner.camera.project(in_cam);
        require(pixel.has_value(), "a synthetic corner lies in front of the camera");
        model::CornerObservation c;
        c.column = column;
        c.row = row;
        const Eigen::Vector2d off = errors.u_pixel_px * Eigen::Vector2d{normal(), normal()};
        c.pixel = *pixel + off;
        c.u_pixel_px = std::max(errors.u_pixel_px, 1e-3);
        const double u = std::max(errors.u_coordinate_mm, 1e-6);
        const auto read = [&](CodeAxis axis, double capture_offset) {
          return Uncertain{*scanner.projector.project(axis, in_proj) + u_by_pixel(scanner, axis, pose, place).dot(off) +
                               capture_offset + errors.u_coordinate_mm * normal(),
                           u};
        };
        if (scanner.projector.x) c.x = read(CodeAxis::x, offset.x());
        if (scanner.projector.y) c.y = read(CodeAxis::y, offset.y());
        o.corners.push_back(c);
      }
    }
    out.push_back(std::move(o));
  }
  return out;
}

/// The point that camera and projector look at, in cam.
Eigen::Vector3d target() { return {0, 0, std::hypot(kBase, kDistance)}; }

}  // namespace

model::Scanner known_scanner(bool two_axes) {
  model::Scanner s;
  s.name = "known";
  s.camera = {.width_px = 1392,
              .height_px = 1040,
              .fx_px = 3721,
              .fy_px = 3721,
              .cx_px = 708,
              .cy_px = 512,
              .distortion = {-0.10, 0.06, 2e-4, -1.5e-4, 0},
              .pixel_mm = 0.00645};
  s.projector.x = model::ProjectorAxis{grating(), 32.0, 7.83};
  if (two_axes) s.projector.y = model::ProjectorAxis{grating(), 32.0, 7.5};
  s.projector.distortion = {-0.08, 0.03, 0, 0, 0};
  // The camera stands at +X of the projector, turned towards the point on the projector's axis.
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(-std::atan2(kBase, kDistance), Eigen::Vector3d::UnitY()));
  const Eigen::Quaterniond roll(Eigen::AngleAxisd(0.3 * std::numbers::pi / 180, Eigen::Vector3d::UnitZ()));
  s.proj_from_cam = {(turn * roll).normalized(), Eigen::Vector3d(kBase, 3.0, 0.0)};
  s.working_distance_mm = kDistance;
  return s;
}

model::Board known_board() {
  model::Board b;
  b.columns = 9;
  b.rows = 7;
  b.pitch_x_mm = b.pitch_y_mm = 30;
  return b;
}

PatternPlan known_plan(bool two_axes) {
  PatternPlan plan;
  plan.x = grating();
  if (two_axes) plan.y = grating();
  return plan;
}

std::vector<Rigid3> view_places(int poses) {
  std::vector<Rigid3> placed;
  const double golden = std::numbers::pi * (3.0 - std::sqrt(5.0));
  for (int i = 0; i < poses; ++i) {
    const double direction = golden * i, tilt = (15.0 + 20.0 * (i % 3) / 2.0) * std::numbers::pi / 180;
    const Eigen::Vector3d axis(std::cos(direction), std::sin(direction), 0);
    const Eigen::Vector3d shift(25.0 * std::cos(2 * direction), 20.0 * std::sin(3 * direction),
                                80.0 * ((i % 5) - 2) / 2.0);
    placed.push_back({Eigen::Quaterniond(Eigen::AngleAxisd(tilt, axis)), target() + shift});
  }
  return placed;
}

std::vector<model::BoardObservation> views(const model::Scanner& scanner, const model::Board& board, int poses,
                                           const ViewErrors& errors) {
  return observe(scanner, board, view_places(poses), errors);
}

std::vector<model::BoardObservation> parallel_views(const model::Scanner& scanner, const model::Board& board, int poses,
                                                    const ViewErrors& errors) {
  std::vector<Rigid3> placed;
  for (int i = 0; i < poses; ++i) {
    placed.push_back({Eigen::Quaterniond::Identity(), target() + Eigen::Vector3d(10.0 * i, -5.0 * i, 30.0 * i)});
  }
  return observe(scanner, board, placed, errors);
}

model::BoardObservation view_at(const model::Scanner& scanner, const model::Board& board, const Rigid3& cam_from_board,
                                const ViewErrors& errors) {
  const Eigen::Vector3d middle = 0.5 * board.corner_mm(board.columns - 1, board.rows - 1);
  auto view = observe(scanner, board, {{cam_from_board.rotation, cam_from_board * middle}}, errors).front();
  view.name = "placed";
  const auto& axis = *scanner.projector.axis(scanner.projector.main_axis());
  std::erase_if(view.corners, [&](const model::CornerObservation& c) {
    const auto& u = scanner.projector.x ? c.x : c.y;
    return c.pixel.x() < 0 || c.pixel.y() < 0 || c.pixel.x() > scanner.camera.width_px - 1 ||
           c.pixel.y() > scanner.camera.height_px - 1 || u->value < 0 ||
           u->value > axis.code.stripe_width() * axis.code.stripes();
  });
  return view;
}

std::vector<calib::PlanarView> planar_views(int boards, int columns, int rows, double pitch_mm, double noise_px) {
  model::Scanner scanner = known_scanner();
  scanner.camera.distortion = {-0.10, 0.06, 0, 0, 0};
  model::Board board;
  board.columns = columns;
  board.rows = rows;
  board.pitch_x_mm = board.pitch_y_mm = pitch_mm;
  std::vector<calib::PlanarView> out;
  for (const auto& o : views(scanner, board, boards, {.u_pixel_px = noise_px})) {
    calib::PlanarView v;
    for (const auto& c : o.corners) {
      v.board_mm.push_back(board.corner_mm(c.column, c.row).head<2>());
      // OpenCV keeps its points in float: the same corners for all.
      v.pixels.push_back(c.pixel.cast<float>().cast<double>());
    }
    out.push_back(std::move(v));
  }
  return out;
}

}  // namespace fringecal::test

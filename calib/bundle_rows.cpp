#include "calib/bundle_rows.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {

Eigen::Vector3d Bundle::corner_mm(std::size_t target) const {
  const Eigen::Vector2d& nominal = targets_mm[target];
  const Eigen::Vector3d smooth(nominal.x(), nominal.y(), bow_mm.dot(rows::bow_shapes(*this)[target]));
  return print_mm.empty() ? smooth : Eigen::Vector3d(smooth + print_mm[target]);
}

namespace rows {
namespace {

struct Lens {
  double xd, yd;
  double xx, xy, yy;             // eq. 4
  std::array<double, 5> xk, yk;  // by k1, k2, p1, p2, k3
};

Lens bend_rays(const model::Distortion& k, double x, double y) {
  const double r2 = x * x + y * y;
  const double s = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double ds = 2.0 * (k[0] + r2 * (2.0 * k[1] + 3.0 * r2 * k[4]));
  Lens l;
  l.xd = x * s + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x);
  l.yd = y * s + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y;
  l.xx = s + ds * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
  l.xy = ds * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
  l.yy = s + ds * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
  const double r4 = r2 * r2;
  l.xk = {x * r2, x * r4, 2.0 * x * y, r2 + 2.0 * x * x, x * r4 * r2};
  l.yk = {y * r2, y * r4, r2 + 2.0 * y * y, 2.0 * x * y, y * r4 * r2};
  return l;
}

Eigen::Vector3d shape_of(const Eigen::Vector2d& e) { return {e.x() * e.x(), e.y() * e.y(), e.x() * e.y()}; }

/// What a sight is of, on its board or flat.
struct Place {
  Eigen::Vector2d place = Eigen::Vector2d::Zero();
  double height = 0, pitch = 1;
  Eigen::Vector3d shape = Eigen::Vector3d::Zero();
};

/// by[column ..] = -(a . [q]x) = q x a, eq. 3 for a row a.
void set_rotation(Row& row, int column, const Eigen::RowVector3d& a, const Eigen::Vector3d& q) {
  const Eigen::Vector3d d = q.cross(a.transpose());
  for (int i = 0; i < 3; ++i) row.by[static_cast<std::size_t>(column + i)] = d[i];
}

/// The columns of pose, board and corner from a = d(residual)/d(point in cam).
void set_pose_and_board(Row& row, const Eigen::RowVector3d& a, const Frame& f, const Eigen::Vector3d& turned,
                        const Eigen::Vector2d& place, double pitch, const Eigen::Vector3d& shape) {
  set_rotation(row, kPoseW, a, turned);
  const Eigen::RowVector3d on_board = a * f.rotation;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    row.by[kPoseT + i] = a[k];
    row.by[kBow + i] = row.by[kBend + i] = on_board[2] * shape[k];
  }
  row.by[kPitch] = on_board[0] * place.x() + on_board[1] * place.y();
  row.by[kPrint] = on_board[0] * pitch;
  row.by[kPrint + 1] = on_board[1] * pitch;
  row.by[kPrint + 2] = on_board[2];
}

}  // namespace

Frame frame_of(const Bundle& b, std::size_t pose) {
  Frame f;
  f.rotation = b.cam_from_board[pose].rotation_matrix();
  f.translation = b.cam_from_board[pose].translation_mm;
  f.projector_rotation = b.proj_from_cam.rotation_matrix();
  f.projector_translation = b.proj_from_cam.translation_mm;
  f.bow = b.bow_mm;
  if (!b.bend_mm.empty()) f.bow += b.bend_mm[pose];
  f.offset = b.phase_offset.empty() ? Eigen::Vector2d(Eigen::Vector2d::Zero()) : b.phase_offset[pose];
  return f;
}

std::vector<Eigen::Vector3d> bow_shapes(const Bundle& b) {
  Eigen::Vector2d low = b.targets_mm.front(), high = low;
  for (const auto& t : b.targets_mm) {
    low = low.cwiseMin(t);
    high = high.cwiseMax(t);
  }
  const Eigen::Vector2d middle = 0.5 * (low + high), half = (0.5 * (high - low)).cwiseMax(1e-9);
  std::vector<Eigen::Vector3d> out;
  out.reserve(b.targets_mm.size() + 1);
  for (const auto& t : b.targets_mm) {
    const Eigen::Vector2d e = (t - middle).cwiseQuotient(half);
    out.push_back(shape_of(e));
  }
  out.push_back(Eigen::Vector3d::Zero());
  return out;
}

namespace {

/// Rows at a place of the board or the flat.
bool evaluate_at(const Bundle& b, const Frame& f, const Place& at, const Sight& s, With with, SightRows& out) {
  const auto& [place, height, pitch, shape] = at;
  const Eigen::Vector3d board(pitch * place.x(), pitch * place.y(), height);  // bundle.h, eq. 1
  const Eigen::Vector3d turned = f.rotation * board, cam = turned + f.translation;
  if (!(cam.z() > 0.0)) return false;
  const auto& c = b.camera;
  {
    const double x = cam.x() / cam.z(), y = cam.y() / cam.z(), iz = 1.0 / cam.z();
    const Lens l = bend_rays(c.distortion, x, y);
    Row &rx = out.row[0], &ry = out.row[1];
    out.has[0] = out.has[1] = true;
    rx.residual = c.fx_px * l.xd + c.cx_px - s.pixel.x();  // eq. 1
    ry.residual = c.fy_px * l.yd + c.cy_px - s.pixel.y();
    if (with == With::derivatives) {
      rx.by.fill(0.0);
      ry.by.fill(0.0);
      rx.by[kCamera] = l.xd;
      rx.by[kCamera + 2] = 1.0;
      ry.by[kCamera + 1] = l.yd;
      ry.by[kCamera + 3] = 1.0;
      for (std::size_t i = 0; i < 5; ++i) {
        rx.by[kCameraK + i] = c.fx_px * l.xk[i];
        ry.by[kCameraK + i] = c.fy_px * l.yk[i];
      }
      const Eigen::RowVector3d ax = c.fx_px * iz * Eigen::RowVector3d(l.xx, l.xy, -(l.xx * x + l.xy * y));
      const Eigen::RowVector3d ay = c.fy_px * iz * Eigen::RowVector3d(l.xy, l.yy, -(l.xy * x + l.yy * y));
      set_pose_and_board(rx, ax, f, turned, place, pitch, shape);
      set_pose_and_board(ry, ay, f, turned, place, pitch, shape);
    }
  }
  if (!b.projector || !((s.x && b.projector->x) || (s.y && b.projector->y))) return true;

  const Eigen::Vector3d spun = f.projector_rotation * cam, proj = spun + f.projector_translation;
  if (!(proj.z() > 0.0)) return false;
  const double x = proj.x() / proj.z(), y = proj.y() / proj.z(), iz = 1.0 / proj.z();
  const Lens l = bend_rays(b.projector->distortion, x, y);
  for (const std::size_t axis : {0U, 1U}) {
    const auto& coded = axis == 0 ? b.projector->x : b.projector->y;
    const auto& seen = axis == 0 ? s.x : s.y;
    if (!coded || !seen) continue;
    Row& row = out.row[2 + axis];
    out.has[2 + axis] = true;
    const double d = axis == 0 ? l.xd : l.yd;
    const Eigen::RowVector2d slope = s.u_by_pixel.row(static_cast<Eigen::Index>(axis));
    row.residual = coded->f * d + coded->u0 + f.offset[static_cast<Eigen::Index>(axis)] - seen->value -
                   slope[0] * out.row[0].residual - slope[1] * out.row[1].residual;  // eq. 2
    if (with == With::residuals) continue;
    row.by.fill(0.0);
    row.by[kAxis + 2 * axis] = d;
    row.by[kAxis + 2 * axis + 1] = 1.0;
    row.by[kOffset + axis] = 1.0;
    for (std::size_t i = 0; i < 5; ++i) row.by[kProjectorK + i] = coded->f * (axis == 0 ? l.xk[i] : l.yk[i]);
    const double dx = axis == 0 ? l.xx : l.xy, dy = axis == 0 ? l.xy : l.yy;
    const Eigen::RowVector3d a = coded->f * iz * Eigen::RowVector3d(dx, dy, -(dx * x + dy * y));
    set_rotation(row, kProjectorW, a, spun);
    for (std::size_t i = 0; i < 3; ++i) row.by[kProjectorT + i] = a[static_cast<Eigen::Index>(i)];
    set_pose_and_board(row, a * f.projector_rotation, f, turned, place, pitch, shape);
    for (std::size_t i = 0; i < row.by.size(); ++i) {
      row.by[i] -= slope[0] * out.row[0].by[i] + slope[1] * out.row[1].by[i];
    }
  }
  return true;
}

/// What a place on the face does to a row; and to the pixel.
Eigen::RowVector2d by_place(const Row& row) { return {row.by[kPrint], row.by[kPrint + 1]}; }
Eigen::Matrix2d pixel_by_place(const SightRows& rows) {
  Eigen::Matrix2d out;
  out << by_place(rows.row[0]), by_place(rows.row[1]);
  return out;
}

/// Where a pixel's ray meets the flat of this frame. The bow's slope is some 1e-5: each pass lowers what is left by that, and
/// the third has a height of 1e-13 mm.
std::optional<Place> place_on_flat(const Bundle& b, const Frame& f, const Sight& s) {
  const auto ray = b.camera.ray(s.pixel);
  if (!ray) return std::nullopt;
  const Eigen::Vector3d normal = f.rotation.col(2);
  const double along = normal.dot(*ray), distance = normal.dot(f.translation);
  Place out{.pitch = 1.0};
  for (int pass = 0; pass < 3; ++pass) {
    const Eigen::Vector3d at = (distance + out.height) / along * *ray;
    if (!(at.z() > 0.0) || !at.allFinite()) return std::nullopt;
    out.place = (f.rotation.transpose() * (at - f.translation)).head<2>();
    out.shape = shape_of(out.place / b.flat_half_mm);
    out.height = b.flat_bow_mm.dot(out.shape);  // bundle.h, eq. 2
  }
  return out;
}

/// Eq. 6 on the rows of a place on the flat.
bool keep_the_fringes_alone(SightRows& out, With with) {
  out.has[0] = out.has[1] = false;
  if (with == With::residuals) return true;
  const Eigen::Matrix2d inverse = pixel_by_place(out).inverse();
  if (!inverse.allFinite()) return false;
  for (const std::size_t k : {2U, 3U}) {
    if (!out.has[k]) continue;
    Row& row = out.row[k];
    const Eigen::RowVector2d of_camera = by_place(row) * inverse;
    for (std::size_t i = 0; i < kColumns; ++i) {
      row.by[i] -= of_camera[0] * out.row[0].by[i] + of_camera[1] * out.row[1].by[i];
    }
    for (std::size_t i = 0; i < 3; ++i) row.by[kFlatBow + i] = row.by[kBow + i];
    for (const int first : {kBow, kBend, kPrint}) std::fill_n(row.by.begin() + first, 3, 0.0);
    row.by[kPitch] = 0.0;
  }
  return true;
}

}  // namespace

bool evaluate(const Bundle& b, const Frame& f, const Eigen::Vector3d& shape, const Sight& s, With with,
              SightRows& out) {
  out.has = {};
  if (s.target == kOnFlat) {
    const auto place = place_on_flat(b, f, s);
    return place && evaluate_at(b, f, *place, s, with, out) && keep_the_fringes_alone(out, with);
  }
  const auto target = static_cast<std::size_t>(s.target);
  Place at{b.targets_mm[target], f.bow.dot(shape), 1.0 + b.pitch_error, shape};
  if (!b.print_mm.empty()) {
    at.place += b.print_mm[target].head<2>();
    at.height += b.print_mm[target].z();
  }
  return evaluate_at(b, f, at, s, with, out);
}

void set_slopes(Bundle& b) {
  const auto shapes = bow_shapes(b);
  std::vector<Frame> frames;
  for (std::size_t j = 0; j < b.cam_from_board.size(); ++j) frames.push_back(frame_of(b, j));
  SightRows r;
  for (Sight& s : b.sights) {
    s.u_by_pixel.setZero();
    if (s.target == kOnFlat) continue;  // the pixel is exact
    if (!b.projector || !evaluate(b, frames[static_cast<std::size_t>(s.pose)],
                                  shapes[static_cast<std::size_t>(s.target)], s, With::derivatives, r)) {
      continue;
    }
    const Eigen::Matrix2d by = pixel_by_place(r);
    // Seen at less than some 3 degrees from its face, a board tells nothing of its own slope.
    if (!(std::abs(by.determinant()) > 0.05 * by.squaredNorm())) continue;
    for (const std::size_t axis : {0U, 1U}) {
      if (r.has[2 + axis])
        s.u_by_pixel.row(static_cast<Eigen::Index>(axis)) = by_place(r.row[2 + axis]) * by.inverse();  // eq. 5
    }
  }
}

}  // namespace rows
}  // namespace fringecal::calib

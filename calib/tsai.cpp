#include "calib/tsai.h"

#include "core/error.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::calib {
namespace {

constexpr double kLeastTilt = 3.0 * std::numbers::pi / 180.0;
constexpr double kDegrees = 180.0 / std::numbers::pi;

/// What stage 1 gives, with the sign of eq. 2 still open.
struct Aligned {
  Eigen::Matrix2d block;  // r11 r12, r21 r22
  Eigen::Vector2d shift;  // tx, ty
  Eigen::Vector2d third;  // r13, r23, up to a common sign
  double tilt_rad = 0;
};

std::optional<Aligned> align_radially(const PlanarView& view, const Eigen::Vector2d& middle) {
  double size = 0, field = 0;
  for (std::size_t i = 0; i < view.pixels.size(); ++i) {
    size = std::max(size, (view.pixels[i] - middle).norm());
    field = std::max(field, view.board_mm[i].norm());
  }
  if (!(size > 0 && field > 0)) return std::nullopt;
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  for (std::size_t i = 0; i < view.pixels.size(); ++i) {
    const Eigen::Vector2d d = (view.pixels[i] - middle) / size, b = view.board_mm[i] / field;
    Vector6 row;  // eq. 1 by r11, r12, tx / field, r21, r22, ty / field
    row << -d.y() * b.x(), -d.y() * b.y(), -d.y(), d.x() * b.x(), d.x() * b.y(), d.x();
    normal += row * row.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(normal);
  // A second null direction: the points do not fix the six numbers (all on a line, or on one through the middle).
  if (!(eigen.eigenvalues()[1] > 1e-12 * eigen.eigenvalues()[5])) return std::nullopt;
  const Vector6 q = eigen.eigenvectors().col(0);
  Aligned a;
  a.block << q[0], q[1], q[3], q[4];
  a.shift << field * q[2], field * q[5];
  // Singular values of the block: the eigenvalues of M M^T, whose eigenvectors are U.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> u(a.block * a.block.transpose());
  const double largest = std::sqrt(u.eigenvalues()[1]), cosine = std::sqrt(std::max(u.eigenvalues()[0], 0.0)) / largest;
  if (!(largest > 0)) return std::nullopt;
  double agreement = 0;
  for (std::size_t i = 0; i < view.pixels.size(); ++i) {
    agreement += (a.block * view.board_mm[i] + a.shift).dot(view.pixels[i] - middle);
  }
  const double factor = std::copysign(1.0 / largest, agreement);
  a.block *= factor;
  a.shift *= factor;
  a.tilt_rad = std::acos(std::min(cosine, 1.0));
  a.third = std::sqrt(std::max(1.0 - cosine * cosine, 0.0)) * u.eigenvectors().col(0);  // eq. 2
  return a;
}

/// f and tz of one pose without distortion, eq. 3; `w` the third row's part of each corner.
struct Linear {
  double f = 0, tz = 0;
};
std::optional<Linear> linear_stage(const PlanarView& view, const Eigen::Vector2d& middle, const Aligned& a,
                                   const Eigen::Vector2d& third_row) {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < view.pixels.size(); ++i) {
    const Eigen::Vector2d d = view.pixels[i] - middle, xy = a.block * view.board_mm[i] + a.shift;
    const double w = third_row.dot(view.board_mm[i]);
    for (const int k : {0, 1}) {
      const Eigen::Vector2d row(xy[k], -d[k]);
      normal += row * row.transpose();
      right += row * (d[k] * w);
    }
  }
  const Eigen::Vector2d found = normal.ldlt().solve(right);
  if (!found.allFinite() || !(found[0] > 0 && found[1] > 0)) return std::nullopt;
  return Linear{found[0], found[1]};
}

/// The rotation with the given sign of eq. 2.
Eigen::Matrix3d rotation_of(const Aligned& a, double sign) {
  Eigen::Matrix3d r;
  r.row(0) << a.block.row(0), sign * a.third.x();
  r.row(1) << a.block.row(1), sign * a.third.y();
  r.row(2) = r.row(0).cross(r.row(1));
  return r;
}

}  // namespace

Result<TsaiSolution> calibrate_tsai(std::span<const PlanarView> views, int width_px, int height_px,
                                    const std::optional<Eigen::Vector2d>& principal_point_px) {
  require(width_px > 0 && height_px > 0, "calibrate_tsai() gets the size of the images");
  if (views.empty()) return unanswerable("no view of the board");
  const Eigen::Vector2d middle =
      principal_point_px.value_or(Eigen::Vector2d(0.5 * (width_px - 1), 0.5 * (height_px - 1)));
  TsaiSolution out;
  std::vector<Aligned> aligned;
  std::size_t corners = 0;
  for (std::size_t j = 0; j < views.size(); ++j) {
    require(views[j].board_mm.size() == views[j].pixels.size(), "a view has a pixel per corner");
    const auto a = views[j].pixels.size() >= 8 ? align_radially(views[j], middle) : std::nullopt;
    if (!a) {
      return unanswerable(
          fmt::format("view {} shows {} corners, not in general position; the radial alignment needs at least 8", j + 1,
                      views[j].pixels.size()));
    }
    aligned.push_back(*a);
    out.tilt_rad.push_back(a->tilt_rad);
    corners += views[j].pixels.size();
  }
  const double most = *std::max_element(out.tilt_rad.begin(), out.tilt_rad.end());
  const auto inseparable = [&](const std::string& more) {
    return unanswerable(fmt::format(
        "the focal length f and the distance t_z cannot be separated: the board is tilted against the image by {:.1f} "
        "degrees at most, and a board parallel to it shows f / t_z only{}; hold it tilted by 30 degrees or more",
        kDegrees * most, more));
  };
  if (most < kLeastTilt) return inseparable("");

  // The mean of 1/f over the tilted poses is the start: a pose with little tilt says little about f.
  std::vector<Eigen::Matrix3d> rotations;
  double inverse = 0, weight = 0;
  for (std::size_t j = 0; j < views.size(); ++j) {
    std::optional<Linear> best;
    Eigen::Matrix3d rotation = rotation_of(aligned[j], 1.0);
    for (const double sign : {1.0, -1.0}) {
      const Eigen::Matrix3d r = rotation_of(aligned[j], sign);
      const auto linear = linear_stage(views[j], middle, aligned[j], r.row(2).head<2>().transpose());
      if (!linear) continue;
      best = linear;
      rotation = r;
    }
    rotations.push_back(rotation);
    if (!best) continue;
    const double w = std::pow(std::sin(aligned[j].tilt_rad), 2);
    inverse += w / best->f;
    weight += w;
  }
  if (!(weight > 0)) return inseparable("");
  double f = weight / inverse, k1 = 0, k2 = 0;
  std::vector<double> tz;
  for (std::size_t j = 0; j < views.size(); ++j) {
    // With f known, eq. 3 is one line for tz.
    double above = 0, below = 0;
    for (std::size_t i = 0; i < views[j].pixels.size(); ++i) {
      const Eigen::Vector2d d = views[j].pixels[i] - middle,
                            xy = aligned[j].block * views[j].board_mm[i] + aligned[j].shift;
      above += d.dot(f * xy - d * rotations[j].row(2).head<2>().dot(views[j].board_mm[i]));
      below += d.squaredNorm();
    }
    tz.push_back(above / below);
  }

  // Eq. 3 by Levenberg-Marquardt over f, k1, k2 and every tz.
  const auto n = static_cast<Eigen::Index>(3 + views.size());
  Eigen::MatrixXd normal;
  Eigen::VectorXd gradient;
  const auto squares_at = [&](double f_, double k1_, double k2_, const std::vector<double>& tz_, bool derivatives) {
    double sum = 0;
    if (derivatives) {
      normal.setZero(n, n);
      gradient.setZero(n);
    }
    for (std::size_t j = 0; j < views.size(); ++j) {
      for (std::size_t i = 0; i < views[j].pixels.size(); ++i) {
        const Eigen::Vector2d& b = views[j].board_mm[i];
        const double z = rotations[j].row(2).head<2>().dot(b) + tz_[j];
        if (!(z > 0)) return HUGE_VAL;
        const Eigen::Vector2d p = (aligned[j].block * b + aligned[j].shift) / z;
        const double r2 = p.squaredNorm(), s = 1.0 + r2 * (k1_ + r2 * k2_);
        const Eigen::Vector2d e = f_ * s * p - (views[j].pixels[i] - middle);
        sum += e.squaredNorm();
        if (!derivatives) continue;
        // By tz: p scales as 1 / z, and d(s p)/dp . p = p (s + 2 k1 r^2 + 4 k2 r^4).
        Eigen::Matrix<double, 2, 4> by;
        by << s * p, f_ * r2 * p, f_ * r2 * r2 * p, -f_ / z * (s + 2 * k1_ * r2 + 4 * k2_ * r2 * r2) * p;
        const auto at = static_cast<Eigen::Index>(3 + j);
        normal.topLeftCorner<3, 3>() += by.leftCols<3>().transpose() * by.leftCols<3>();
        normal.block<3, 1>(0, at) += by.leftCols<3>().transpose() * by.col(3);
        normal(at, at) += by.col(3).squaredNorm();
        gradient.head<3>() += by.leftCols<3>().transpose() * e;
        gradient[at] += by.col(3).dot(e);
      }
    }
    if (derivatives) normal.block(3, 0, n - 3, 3) = normal.block(0, 3, 3, n - 3).transpose();
    return sum;
  };
  double squares = squares_at(f, k1, k2, tz, false), lambda = 1e-3;
  constexpr int kIterations = 100;
  bool done = !std::isfinite(squares);
  if (done) return inseparable(", and the linear start puts corners behind the camera");
  for (; out.iterations < kIterations && !done; ++out.iterations) {
    squares_at(f, k1, k2, tz, true);
    const Eigen::VectorXd scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    for (bool accepted = false; !accepted && !done;) {
      Eigen::MatrixXd damped = scale.asDiagonal() * normal * scale.asDiagonal();
      damped.diagonal().array() += lambda;
      const Eigen::VectorXd step = -scale.cwiseProduct(damped.ldlt().solve(scale.cwiseProduct(gradient)));
      std::vector<double> next_tz = tz;
      for (std::size_t j = 0; j < tz.size(); ++j) next_tz[j] += step[static_cast<Eigen::Index>(3 + j)];
      const double next = squares_at(f + step[0], k1 + step[1], k2 + step[2], next_tz, false);
      accepted = next <= squares * (1.0 + 1e-13);
      if (accepted) {
        // What the step moves pixels by, in units of the whole: below rounding nothing is left to gain.
        done = std::abs(step[0]) < 1e-12 * f && lambda < 1e-6;
        f += step[0];
        k1 += step[1];
        k2 += step[2];
        tz = next_tz;
        squares = next;
        lambda = lambda < 1e-12 ? 0.0 : 0.1 * lambda;
      } else {
        lambda = std::max(10 * lambda, 1e-9);
        done = lambda > 1e6;
      }
    }
  }
  squares_at(f, k1, k2, tz, true);
  const double freedom =
      2.0 * static_cast<double>(corners) - static_cast<double>(n) - 5.0 * static_cast<double>(views.size());
  const Eigen::VectorXd scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(scale.asDiagonal() * normal * scale.asDiagonal());
  if (!(f > 0) || !(ldlt.vectorD().minCoeff() > 1e-14) || !(freedom > 0)) return inseparable("");
  const Eigen::MatrixXd inverse_normal =
      scale.asDiagonal() * Eigen::MatrixXd(ldlt.solve(Eigen::MatrixXd::Identity(n, n))) * scale.asDiagonal();
  out.covariance = squares / freedom * inverse_normal.topLeftCorner<3, 3>();
  const double u_f = std::sqrt(out.covariance(0, 0));
  if (!(u_f <= 0.1 * f))
    return inseparable(fmt::format(" (f = {:.4g} px with a standard uncertainty of {:.2g})", f, u_f));
  out.rms_px = std::sqrt(squares / (2.0 * static_cast<double>(corners)));
  auto& c = out.camera;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx_px = c.fy_px = f;
  c.cx_px = middle.x();
  c.cy_px = middle.y();
  c.distortion = {k1, k2, 0, 0, 0};
  for (std::size_t j = 0; j < views.size(); ++j) {
    out.cam_from_board.push_back({Eigen::Quaterniond(rotations[j]).normalized(),
                                  Eigen::Vector3d(aligned[j].shift.x(), aligned[j].shift.y(), tz[j])});
  }
  return out;
}

}  // namespace fringecal::calib

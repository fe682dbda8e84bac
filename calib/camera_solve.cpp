#include "calib/camera_solve.h"

#include "core/error.h"
#include "core/parallel.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace fringecal::calib {
namespace {

// Corners per tile: 14 columns of a tile, twice, stay within the first-level cache.
constexpr int kTile = 32;
// Below this many corners the start of a thread costs more than it saves.
constexpr std::size_t kParallelCorners = 8000;
constexpr double kLeftToGo_px = 1e-10;

// The largest system: four of the pinhole, five of the distortion, the skew. Sizes at run time, memory of fixed size: Eigen
// unrolls matrices of fixed size, which for ten columns costs the compiler minutes and the solve nothing.
constexpr int kMostLens = 10;
using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostLens, kMostLens>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostLens, 1>;

struct Pose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

struct Lens {
  double fx, fy, cx, cy;
  std::array<double, 5> k{};
  double skew = 0;
};

/// Homography pixel ~ H (X, Y, 1) by linear least squares with h33 = 1 on centred, scaled coordinates.
std::optional<Eigen::Matrix3d> homography(const PlanarView& view) {
  const auto normaliser = [](const std::vector<Eigen::Vector2d>& points) {
    Eigen::Vector2d mean = Eigen::Vector2d::Zero(), square = Eigen::Vector2d::Zero();
    for (const auto& p : points) mean += p;
    mean /= static_cast<double>(points.size());
    for (const auto& p : points) square += (p - mean).cwiseAbs2();
    const double scale = 1.0 / std::sqrt(std::max(square.sum() / static_cast<double>(points.size()), 1e-300));
    Eigen::Matrix3d t;
    t << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
    return t;
  };
  const Eigen::Matrix3d from = normaliser(view.board_mm), to = normaliser(view.pixels);
  Eigen::Matrix<double, 8, 8> normal = Eigen::Matrix<double, 8, 8>::Zero();
  Eigen::Matrix<double, 8, 1> right = Eigen::Matrix<double, 8, 1>::Zero();
  // The blocks of the normal matrix are sums of (X, Y, 1)(X, Y, 1)^T times 1, x, y, x^2 + y^2.
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero(), mx = m, my = m, mr = m;
  for (std::size_t i = 0; i < view.pixels.size(); ++i) {
    const Eigen::Vector3d b(from(0, 0) * view.board_mm[i].x() + from(0, 2),
                            from(1, 1) * view.board_mm[i].y() + from(1, 2), 1.0);
    const double x = to(0, 0) * view.pixels[i].x() + to(0, 2), y = to(1, 1) * view.pixels[i].y() + to(1, 2);
    const Eigen::Matrix3d bb = b * b.transpose();
    m += bb;
    mx += x * bb;
    my += y * bb;
    mr += (x * x + y * y) * bb;
  }
  normal.block<3, 3>(0, 0) = normal.block<3, 3>(3, 3) = m;
  normal.block<3, 2>(0, 6) = -mx.leftCols<2>();
  normal.block<3, 2>(3, 6) = -my.leftCols<2>();
  normal.block<2, 2>(6, 6) = mr.topLeftCorner<2, 2>();
  normal.block<2, 3>(6, 0) = normal.block<3, 2>(0, 6).transpose();
  normal.block<2, 3>(6, 3) = normal.block<3, 2>(3, 6).transpose();
  right << mx.col(2), my.col(2), -mr.block<2, 1>(0, 2);
  const Eigen::Matrix<double, 8, 1> h = normal.ldlt().solve(right);
  if (!h.allFinite()) return std::nullopt;
  Eigen::Matrix3d out;
  out << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  const double scale = 1.0 / to(0, 0);
  Eigen::Matrix3d back;
  back << scale, 0, -scale * to(0, 2), 0, scale, -scale * to(1, 2), 0, 0, 1;
  return back * out * from;
}

/// f with the principal point in the middle: r1 . r2 = 0 and |r1| = |r2| are linear in 1/f^2.
double focal_length(const std::vector<Eigen::Matrix3d>& homographies, const Eigen::Vector2d& middle) {
  double above = 0, below = 0;
  for (const Eigen::Matrix3d& h : homographies) {
    Eigen::Matrix3d centred = h;
    centred.row(0) -= middle.x() * h.row(2);
    centred.row(1) -= middle.y() * h.row(2);
    const Eigen::Vector3d a = centred.col(0) / centred.col(0).norm(), b = centred.col(1) / centred.col(1).norm();
    const double s1 = centred.col(0).norm(), s2 = centred.col(1).norm();
    const double e1[2] = {a.head<2>().dot(b.head<2>()), a.z() * b.z()};
    const double r = s2 / s1;
    const double e2[2] = {a.head<2>().squaredNorm() - r * r * b.head<2>().squaredNorm(),
                          a.z() * a.z() - r * r * b.z() * b.z()};
    for (const auto& e : {e1, e2}) {
      above += e[0] * e[0];
      below -= e[0] * e[1];
    }
  }
  return below > 0 && above > 0 ? std::sqrt(above / below) : 0.0;
}

std::optional<Pose> pose_of(const Eigen::Matrix3d& h, double f, const Eigen::Vector2d& middle) {
  Eigen::Matrix3d m;
  m.row(0) = (h.row(0) - middle.x() * h.row(2)) / f;
  m.row(1) = (h.row(1) - middle.y() * h.row(2)) / f;
  m.row(2) = h.row(2);
  const double sign = m(2, 2) > 0 ? 1.0 : -1.0;
  m *= sign * 2.0 / (m.col(0).norm() + m.col(1).norm());
  // The two columns made orthogonal and of length one, half of the correction each.
  const Eigen::Vector3d a = m.col(0).normalized(), b = m.col(1).normalized();
  const Eigen::Vector3d sum = (a + b).normalized(), difference = (a - b).normalized();
  Pose pose;
  pose.rotation.col(0) = (sum + difference) * std::sqrt(0.5);
  pose.rotation.col(1) = (sum - difference) * std::sqrt(0.5);
  pose.rotation.col(2) = pose.rotation.col(0).cross(pose.rotation.col(1));
  pose.translation = m.col(2);
  if (!pose.rotation.allFinite() || !pose.translation.allFinite() || !(pose.translation.z() > 0)) return std::nullopt;
  return pose;
}

/// Solver for kTerms distortion coefficients and, with kSkew = 1, the skew, of which those in `free` move (indices into fx,
/// fy, cx, cy, k1 .., skew).
template <int kTerms, int kSkew>
class Solver {
 public:
  static constexpr int kLens = 4 + kTerms + kSkew;

  Solver(std::span<const PlanarView> views, const Lens& lens, std::vector<Pose> poses, std::vector<int> free,
         Aspect aspect)
      : views_(views),
        lens_(lens),
        poses_(std::move(poses)),
        free_(std::move(free)),
        aspect_(aspect),
        boards_(views.size()) {
    for (const auto& v : views) corners_ += v.pixels.size();
    place_.fill(-1);
    for (std::size_t i = 0; i < free_.size(); ++i) place_[static_cast<std::size_t>(free_[i])] = static_cast<int>(i);
    // No reading depends on both focal lengths: sharing the place of fx adds up what they say.
    if (aspect_ == Aspect::one) place_[1] = place_[0];
  }

  bool run(int max_iterations);
  const Lens& lens() const { return lens_; }
  const std::vector<Pose>& poses() const { return poses_; }
  double squares() const { return squares_; }
  int iterations() const { return iterations_; }
  const Small& reduced() const { return reduced_; }

 private:
  // Columns of the rows of x: fx, [skew,] cx, terms, w, t, residual; of y: fy, cy, terms, w, t, residual.
  static constexpr int kX = 2 + kSkew + kTerms + 7, kY = 2 + kTerms + 7;

  struct Board {
    Small a, w, n;
    SmallVector g, gn;
    double squares = 0;
    bool in_front = true;
  };

  void linearise(std::size_t j);
  bool linearise_all();
  /// Eq. 2 and one step; false where it is not positive definite.
  bool step(double lambda, Lens& lens, std::vector<Pose>& poses, double& moved_px);

  std::span<const PlanarView> views_;
  Lens lens_;
  std::vector<Pose> poses_;
  std::vector<int> free_;
  Aspect aspect_;
  std::array<int, kMostLens> place_{};  // of each lens parameter among the free ones; -1: held
  std::vector<Board> boards_;
  std::size_t corners_ = 0;
  double squares_ = 0;
  int iterations_ = 0;
  Small reduced_;
};

template <int kColumns>
void add_products(const double (&columns)[kColumns][kTile], double (&sums)[kColumns][kColumns]) {
  for (int a = 0; a < kColumns; ++a) {
    for (int b = 0; b <= a; ++b) {
      double even = 0, odd = 0;  // two lanes, one order of summation on every machine
      for (int i = 0; i < kTile; i += 2) {
        even += columns[a][i] * columns[b][i];
        odd += columns[a][i + 1] * columns[b][i + 1];
      }
      sums[a][b] += even + odd;
    }
  }
}

template <int kTerms, int kSkew>
void Solver<kTerms, kSkew>::linearise(std::size_t j) {
  const PlanarView& view = views_[j];
  const Pose& pose = poses_[j];
  Board& board = boards_[j];
  const Lens l = lens_;
  const double* const k = l.k.data();
  alignas(16) double jx[kX][kTile];
  alignas(16) double jy[kY][kTile];
  double nx[kX][kX] = {}, ny[kY][kY] = {};
  const double r00 = pose.rotation(0, 0), r01 = pose.rotation(0, 1), r10 = pose.rotation(1, 0),
               r11 = pose.rotation(1, 1), r20 = pose.rotation(2, 0), r21 = pose.rotation(2, 1);
  const double tx = pose.translation.x(), ty = pose.translation.y(), tz = pose.translation.z();
  const std::size_t n = view.pixels.size();
  board.in_front = true;
  for (std::size_t first = 0; first < n; first += kTile) {
    const int count = static_cast<int>(std::min<std::size_t>(kTile, n - first));
    const Eigen::Vector2d* const from = view.board_mm.data() + first;
    const Eigen::Vector2d* const to = view.pixels.data() + first;
    for (int i = 0; i < count; ++i) {
      const double bx = from[i].x(), by = from[i].y();
      const double qx = r00 * bx + r01 * by, qy = r10 * bx + r11 * by, qz = r20 * bx + r21 * by;
      const double z = qz + tz, iz = 1.0 / z;
      if (!(z > 0.0)) board.in_front = false;
      const double x = (qx + tx) * iz, y = (qy + ty) * iz, xx = x * x, yy = y * y, xy = x * y, r2 = xx + yy,
                   r4 = r2 * r2;
      double s = 1.0 + r2 * (k[0] + r2 * k[1]), ds = 2.0 * k[0] + 4.0 * k[1] * r2;
      if constexpr (kTerms == 5) {
        s += k[4] * r4 * r2;
        ds += 6.0 * k[4] * r4;
      }
      double xd = x * s, yd = y * s, dxx = s + ds * xx, dxy = ds * xy, dyy = s + ds * yy;
      if constexpr (kTerms >= 4) {
        xd += 2.0 * k[2] * xy + k[3] * (r2 + 2.0 * xx);
        yd += k[2] * (r2 + 2.0 * yy) + 2.0 * k[3] * xy;
        dxx += 2.0 * k[2] * y + 6.0 * k[3] * x;
        dxy += 2.0 * k[2] * x + 2.0 * k[3] * y;
        dyy += 6.0 * k[2] * y + 2.0 * k[3] * x;
      }
      double ux = l.fx * dxx, uy = l.fx * dxy;
      const double vx = l.fy * dxy, vy = l.fy * dyy;
      double px = l.fx * xd + l.cx;
      if constexpr (kSkew == 1) {
        ux += l.skew * dxy;
        uy += l.skew * dyy;
        px += l.skew * yd;
      }
      const double uz = -(ux * x + uy * y) * iz, vz = -(vx * x + vy * y) * iz;
      const double u0 = ux * iz, u1 = uy * iz, v0 = vx * iz, v1 = vy * iz;
      int cx = 0, cy = 0;
      jx[cx++][i] = xd;
      if constexpr (kSkew == 1) jx[cx++][i] = yd;
      jx[cx++][i] = 1.0;
      jy[cy++][i] = yd;
      jy[cy++][i] = 1.0;
      double by_x[5] = {x * r2, x * r4, 2.0 * xy, r2 + 2.0 * xx, x * r4 * r2};
      double by_y[5] = {y * r2, y * r4, r2 + 2.0 * yy, 2.0 * xy, y * r4 * r2};
      for (int t = 0; t < kTerms; ++t) {
        double dx = l.fx * by_x[t];
        if constexpr (kSkew == 1) dx += l.skew * by_y[t];
        jx[cx++][i] = dx;
        jy[cy++][i] = l.fy * by_y[t];
      }
      // By w: q x a (bundle_rows.h, eq. 3); by t: a.
      jx[cx++][i] = qy * uz - qz * u1;
      jx[cx++][i] = qz * u0 - qx * uz;
      jx[cx++][i] = qx * u1 - qy * u0;
      jx[cx++][i] = u0;
      jx[cx++][i] = u1;
      jx[cx++][i] = uz;
      jx[cx][i] = px - to[i].x();
      jy[cy++][i] = qy * vz - qz * v1;
      jy[cy++][i] = qz * v0 - qx * vz;
      jy[cy++][i] = qx * v1 - qy * v0;
      jy[cy++][i] = v0;
      jy[cy++][i] = v1;
      jy[cy++][i] = vz;
      jy[cy][i] = l.fy * yd + l.cy - to[i].y();
    }
    for (int i = count; i < kTile; ++i) {
      for (auto& column : jx) column[i] = 0.0;
      for (auto& column : jy) column[i] = 0.0;
    }
    add_products(jx, nx);
    add_products(jy, ny);
  }

  // Where each column of the rows stands among the free lens parameters (>= 0) or the pose (-1 .. -6); held: kHeld.
  constexpr int kHeld = 1000;
  const auto m = static_cast<Eigen::Index>(free_.size());
  board.n.setZero(m, m);
  board.gn.setZero(m);
  board.a.setZero(6, 6);
  board.w.setZero(6, m);
  board.g.setZero(6);
  const auto scatter = [&](const auto& sums, int columns, const int* place) {
    const int residual = columns - 1;
    for (int a = 0; a < columns; ++a) {
      for (int b = 0; b <= a; ++b) {
        const double v = sums[a][b];
        const int pa = place[a], pb = place[b];
        if (pa == kHeld || pb == kHeld) continue;
        if (a == residual) {
          if (b == residual) {
            board.squares += v;
          } else if (pb >= 0) {
            board.gn[pb] += v;
          } else {
            board.g[-1 - pb] += v;
          }
        } else if (pa >= 0) {
          board.n(pa, pb) += v;
          if (pa != pb) board.n(pb, pa) += v;
        } else if (pb >= 0) {
          board.w(-1 - pa, pb) += v;
        } else {
          board.a(-1 - pa, -1 - pb) += v;
          if (pa != pb) board.a(-1 - pb, -1 - pa) += v;
        }
      }
    }
  };
  board.squares = 0;
  int x_place[kX], y_place[kY], cx = 0, cy = 0;
  const auto lens_place = [&](int parameter) {
    const int at = place_[static_cast<std::size_t>(parameter)];
    return at < 0 ? kHeld : at;
  };
  x_place[cx++] = lens_place(0);
  if (kSkew == 1) x_place[cx++] = lens_place(4 + kTerms);
  x_place[cx++] = lens_place(2);
  y_place[cy++] = lens_place(1);
  y_place[cy++] = lens_place(3);
  for (int t = 0; t < kTerms; ++t) x_place[cx++] = y_place[cy++] = lens_place(4 + t);
  for (int p = 0; p < 6; ++p) x_place[cx++] = y_place[cy++] = -1 - p;
  x_place[cx] = y_place[cy] = 0;  // the residual
  scatter(nx, kX, x_place);
  scatter(ny, kY, y_place);
}

template <int kTerms, int kSkew>
bool Solver<kTerms, kSkew>::linearise_all() {
  const int count = static_cast<int>(views_.size());
  if (corners_ >= kParallelCorners && thread_count() > 1) {
    // A few blocks of boards per thread: a start per board would cost as much as the board.
    const int blocks = std::min(count, 4 * thread_count());
    parallel_for(blocks, [&](int b) {
      for (int j = b * count / blocks; j < (b + 1) * count / blocks; ++j) linearise(static_cast<std::size_t>(j));
    });
  } else {
    for (int j = 0; j < count; ++j) linearise(static_cast<std::size_t>(j));
  }
  squares_ = 0;
  bool in_front = true;
  for (const Board& b : boards_) {
    squares_ += b.squares;
    in_front = in_front && b.in_front;
  }
  return in_front && std::isfinite(squares_);
}

template <int kTerms, int kSkew>
bool Solver<kTerms, kSkew>::step(double lambda, Lens& lens, std::vector<Pose>& poses, double& moved_px) {
  const auto m = static_cast<Eigen::Index>(free_.size());
  Small s = Small::Zero(m, m);
  SmallVector g = SmallVector::Zero(m);
  std::vector<Eigen::LLT<Small>> factors;
  factors.reserve(boards_.size());
  for (const Board& b : boards_) {
    Small a = b.a;
    a.diagonal() *= 1.0 + lambda;
    factors.emplace_back(a);
    if (factors.back().info() != Eigen::Success) return false;
    Small half = b.w;
    SmallVector half_g = b.g;
    factors.back().matrixL().solveInPlace(half);
    factors.back().matrixL().solveInPlace(half_g);
    s += b.n;
    s.diagonal() += lambda * b.n.diagonal();
    s.noalias() -= half.transpose().lazyProduct(half);  // eq. 2
    g += b.gn;
    g.noalias() -= half.transpose() * half_g;
  }
  reduced_ = s;
  const SmallVector scale = s.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Small scaled = scale.asDiagonal() * s * scale.asDiagonal();
  const Eigen::LLT<Small> llt(scaled);
  if (llt.info() != Eigen::Success) return false;
  const SmallVector scaled_g = scale.cwiseProduct(g);
  const SmallVector moves = -scale.cwiseProduct(SmallVector(llt.solve(scaled_g)));
  if (!moves.allFinite()) return false;
  std::array<double, kMostLens> d{};
  for (std::size_t i = 0; i < free_.size(); ++i) {
    d[static_cast<std::size_t>(free_[i])] = moves[static_cast<Eigen::Index>(i)];
  }
  if (aspect_ == Aspect::one) d[1] = d[0];
  lens = lens_;
  lens.fx += d[0];
  lens.fy += d[1];
  lens.cx += d[2];
  lens.cy += d[3];
  for (int t = 0; t < kTerms; ++t) lens.k[static_cast<std::size_t>(t)] += d[static_cast<std::size_t>(4 + t)];
  if constexpr (kSkew == 1) lens.skew += d[4 + kTerms];
  moved_px = std::max({std::abs(d[0]), std::abs(d[1]), std::abs(d[2]), std::abs(d[3])});
  poses.resize(poses_.size());
  for (std::size_t j = 0; j < poses_.size(); ++j) {
    const SmallVector right = boards_[j].g + boards_[j].w.lazyProduct(moves);
    const SmallVector p = -factors[j].solve(right);
    poses[j].rotation = rotation_from_vector(p.head<3>()).toRotationMatrix() * poses_[j].rotation;
    poses[j].translation = poses_[j].translation + p.tail<3>();
  }
  return true;
}

template <int kTerms, int kSkew>
bool Solver<kTerms, kSkew>::run(int max_iterations) {
  if (!linearise_all()) return false;
  double lambda = 0, last_moved = 0;
  Lens lens;
  std::vector<Pose> poses;
  for (iterations_ = 0; iterations_ < max_iterations; ++iterations_) {
    double moved = 0;
    if (!step(lambda, lens, poses, moved)) {
      lambda = std::max(10.0 * lambda, 1e-4);
      if (lambda > 1e8) return false;
      continue;
    }
    const double before = squares_;
    std::swap(lens_, lens);
    std::swap(poses_, poses);
    const bool usable = linearise_all();
    // The rounding of the sum: below it a step is judged by its length alone.
    if (!usable || !(squares_ <= before * (1.0 + 1e-12))) {
      std::swap(lens_, lens);
      std::swap(poses_, poses);
      if (!linearise_all()) return false;
      lambda = std::max(10.0 * lambda, 1e-4);
      if (lambda > 1e8) return false;
      continue;
    }
    // Gauss-Newton converges linearly: what is left is the rest of a geometric series.
    const double rate = last_moved > 0 ? moved / last_moved : 1.0;
    if (lambda < 1e-8 && (moved < kLeftToGo_px || (rate < 0.5 && moved * rate / (1.0 - rate) < kLeftToGo_px))) {
      ++iterations_;
      return true;
    }
    last_moved = moved;
    lambda = lambda < 1e-7 ? 0.0 : 0.1 * lambda;
  }
  return true;
}

template <int kTerms, int kSkew>
Result<CameraSolution> solved(std::span<const PlanarView> views, const Lens& start, std::vector<Pose> poses,
                              const CameraSolveOptions& options) {
  const int terms = options.terms == DistortionTerms::full                ? 5
                    : options.terms == DistortionTerms::radial_tangential ? 4
                                                                          : 2;
  std::vector<int> free;
  CameraSolution out;
  const bool one_focal_length = options.aspect == Aspect::one;
  for (const char* name : {"fx_px", "fy_px", "cx_px", "cy_px"}) out.names.emplace_back(name);
  if (one_focal_length) out.names.erase(out.names.begin() + 1);
  for (int t = 0; t < terms; ++t) {
    out.names.emplace_back(std::array{"k1", "k2", "p1", "p2", "k3"}[static_cast<std::size_t>(t)]);
  }
  for (int i = 0; i < 4 + terms; ++i) {
    if (i != 1 || !one_focal_length) free.push_back(i);
  }
  if (options.skew == Skew::free) {
    free.push_back(4 + kTerms);
    out.names.emplace_back("skew_px");
  }
  const auto n_free = static_cast<Eigen::Index>(free.size());
  Solver<kTerms, kSkew> solver(views, start, std::move(poses), free, options.aspect);
  if (!solver.run(options.max_iterations) || solver.iterations() >= options.max_iterations) {
    return unanswerable(fmt::format(
        "the camera's solve does not converge in {} iterations; capture the board tilted by 20 to 40 degrees "
        "about different axes, and check its pitch",
        solver.iterations()));
  }
  const Lens& l = solver.lens();
  out.camera.fx_px = l.fx;
  out.camera.fy_px = l.fy;
  out.camera.cx_px = l.cx;
  out.camera.cy_px = l.cy;
  out.camera.distortion = l.k;
  out.skew_px = l.skew;
  for (const Pose& p : solver.poses()) {
    out.cam_from_board.push_back({Eigen::Quaterniond(p.rotation).normalized(), p.translation});
  }
  std::size_t corners = 0;
  for (const auto& v : views) corners += v.pixels.size();
  const double readings = 2.0 * static_cast<double>(corners);
  const double freedom = readings - static_cast<double>(n_free) - 6.0 * static_cast<double>(views.size());
  if (!(freedom >= 1)) return unanswerable(fmt::format("{} corners leave nothing over; show more of them", corners));
  out.squares_px2 = solver.squares();
  out.rms_px = std::sqrt(solver.squares() / readings);
  out.iterations = solver.iterations();
  const SmallVector scale = solver.reduced().diagonal().cwiseSqrt().cwiseInverse();
  const Small scaled = scale.asDiagonal() * solver.reduced() * scale.asDiagonal();
  const Eigen::LDLT<Small> ldlt(scaled);
  Eigen::Index worst = 0;
  if (!(ldlt.vectorD().minCoeff(&worst) > 1e-12)) {
    Eigen::VectorXi order = Eigen::VectorXi::LinSpaced(static_cast<int>(n_free), 0, static_cast<int>(n_free) - 1);
    order = ldlt.transpositionsP() * order;
    return unanswerable(
        fmt::format("the views do not determine {}; capture the board tilted by 20 to 40 degrees about different axes",
                    out.names[static_cast<std::size_t>(order[worst])]));
  }
  const Small unit = Small::Identity(n_free, n_free);
  const Small inverse = scale.asDiagonal() * Small(ldlt.solve(unit)) * scale.asDiagonal();
  out.covariance = solver.squares() / freedom * inverse;
  return out;
}

}  // namespace

Result<CameraSolution> solve_camera(std::span<const PlanarView> views, int width_px, int height_px,
                                    const CameraSolveOptions& options) {
  require(width_px > 0 && height_px > 0, "solve_camera() gets the size of the images");
  if (views.size() < 3) {
    return unanswerable(fmt::format("{} views of the board; a lens needs at least 3, 10 to 15 are good", views.size()));
  }
  const Eigen::Vector2d middle(0.5 * (width_px - 1), 0.5 * (height_px - 1));
  std::vector<Eigen::Matrix3d> homographies;
  for (std::size_t j = 0; j < views.size(); ++j) {
    require(views[j].board_mm.size() == views[j].pixels.size(), "a view has a pixel per corner");
    const auto h = views[j].pixels.size() >= 4 ? homography(views[j]) : std::nullopt;
    if (!h)
      return unanswerable(fmt::format("view {} shows {} corners, not in general position; at least 4 are needed", j + 1,
                                      views[j].pixels.size()));
    homographies.push_back(*h);
  }
  const double side = std::max(width_px, height_px);
  double f = focal_length(homographies, middle);
  // The closed form gives anything for nearly parallel boards; a start from which the solve finds out what they say.
  if (!(f > 0.3 * side && f < 30.0 * side)) f = 2.0 * side;
  std::vector<Pose> poses;
  for (std::size_t j = 0; j < views.size(); ++j) {
    const auto pose = pose_of(homographies[j], f, middle);
    if (!pose)
      return unanswerable(
          fmt::format("no position of the board explains view {}; check columns, rows and pitch", j + 1));
    poses.push_back(*pose);
  }
  const Lens start{f, f, middle.x(), middle.y(), {}, 0};
  require(options.terms == DistortionTerms::radial || options.terms == DistortionTerms::radial_tangential ||
              options.terms == DistortionTerms::full,
          "solve_camera() estimates 2, 4 or 5 distortion coefficients");
  const bool lean = options.terms == DistortionTerms::radial && options.skew == Skew::zero;
  auto out = lean ? solved<2, 0>(views, start, poses, options) : solved<5, 1>(views, start, poses, options);
  if (!out) return out;
  out->camera.width_px = width_px;
  out->camera.height_px = height_px;
  if (!(out->camera.fx_px > 0 && out->camera.fy_px > 0) || !out->covariance.allFinite()) {
    return unanswerable("the views do not determine the focal length; capture the board tilted by 20 to 40 degrees");
  }
  return out;
}

}  // namespace fringecal::calib

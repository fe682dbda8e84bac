#include "calib/bundle_system.h"

#include "calib/bundle_rows.h"
#include "calib/joint_solve.h"
#include "core/error.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace fringecal::calib {
namespace {

using Eigen::Index;
using rows::SightRows;

/// Whitening factor of row k of a sight.
double whitening(const Sight& s, std::size_t k, const Components& c) {
  if (k < 2) return 1.0 / (s.u_pixel_px * c.camera);
  return 1.0 / ((k == 2 ? s.x->u : s.y->u) * (s.target == kOnFlat ? c.flat : c.projector));
}

/// Squares and weights of the robust loss: the camera's two rows are judged together.
struct Robust {
  double scale2;  // 0: plain squares
  double cost(double r2) const { return scale2 > 0 ? scale2 * std::log1p(r2 / scale2) : r2; }
  double weight(double r2) const { return scale2 > 0 ? 1.0 / (1.0 + r2 / scale2) : 1.0; }
};

std::vector<std::string> distortion_names(const std::string& prefix) {
  std::vector<std::string> out;
  for (const char* name : {"k1", "k2", "p1", "p2", "k3"}) out.push_back(prefix + name);
  return out;
}

/// The focal lengths that take part in what a singular matrix leaves open, beside the row that its pivots name.
std::string with_focal_lengths(const Eigen::MatrixXd& normal, const std::vector<std::string>& names, Index open) {
  const Eigen::VectorXd scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(scale.asDiagonal() * normal * scale.asDiagonal());
  std::string words = names[static_cast<std::size_t>(open)];
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto row = static_cast<Index>(i);
    const bool focal = names[i].ends_with("fx_px") || names[i].ends_with("fy_px") || names[i].ends_with(".f");
    double share = 0;
    for (Index m = 0; m < normal.rows(); ++m) {
      // Directions known a thousand times worse than each parameter on its own.
      if (modes.eigenvalues()[m] < 1e-6) share += std::pow(modes.eigenvectors()(row, m), 2);
    }
    if (focal && row != open && share > 0.01) words += " and " + names[i];
  }
  return words;
}

/// Inverse of a symmetric matrix scaled to a unit diagonal, or the index of the row that it leaves open.
struct Inverse {
  Eigen::MatrixXd matrix;
  Index open = -1;
};
Inverse inverse_of(const Eigen::MatrixXd& normal) {
  const Index n = normal.rows();
  Eigen::VectorXd scale(n);
  for (Index i = 0; i < n; ++i) {
    if (!(normal(i, i) > 0.0)) return {{}, i};
    scale[i] = 1.0 / std::sqrt(normal(i, i));
  }
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> llt(scaled);
  // A pivot of 1e-13 is what rounding leaves of a singular matrix of this size.
  if (llt.info() != Eigen::Success || !(llt.matrixLLT().diagonal().cwiseAbs2().minCoeff() > 1e-13)) {
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(scaled);  // pivots: the last one names the open direction
    Index worst = 0;
    ldlt.vectorD().minCoeff(&worst);
    const Eigen::VectorXi plain = Eigen::VectorXi::LinSpaced(static_cast<int>(n), 0, static_cast<int>(n) - 1);
    const Eigen::VectorXi order = ldlt.transpositionsP() * plain;
    return {{}, order[worst]};
  }
  Eigen::MatrixXd inverse = llt.solve(Eigen::MatrixXd::Identity(n, n));
  inverse = scale.asDiagonal() * inverse * scale.asDiagonal();
  return {0.5 * (inverse + inverse.transpose()), -1};
}

}  // namespace

BundleSystem::BundleSystem(const Bundle& b, const FreeTerms& free, const Components& components, double loss_scale)
    : free_(free),
      components_(components),
      loss_scale_(loss_scale),
      poses_(static_cast<int>(b.cam_from_board.size())),
      flats_(b.flats),
      targets_(components.print_mm > 0 ? static_cast<int>(b.targets_mm.size()) : 0),
      per_target_(components.relief_mm > 0 ? 3 : 2) {
  add_names(b);
}

void BundleSystem::add_names(const Bundle& b) {
  const auto add = [&](int column, const std::vector<std::string>& names, int count) {
    for (int i = 0; i < count; ++i) {
      dense_.push_back(column + i);
      names_.push_back(names[static_cast<std::size_t>(i)]);
    }
  };
  if (free_.camera_and_poses) {
    add(rows::kCamera, {"camera.fx_px", "camera.fy_px", "camera.cx_px", "camera.cy_px"}, 4);
    add(rows::kCameraK, distortion_names("camera."), term_count(free_.camera));
    pose_ = {rows::kPoseW, rows::kPoseW + 1, rows::kPoseW + 2, rows::kPoseT, rows::kPoseT + 1, rows::kPoseT + 2};
    pose_names_ = {"rotation x", "rotation y", "rotation z", "x", "y", "z"};
  }
  if (b.projector) {
    if (b.projector->x) add(rows::kAxis, {"projector.x.f", "projector.x.u0"}, 2);
    if (b.projector->y) add(rows::kAxis + 2, {"projector.y.f", "projector.y.u0"}, 2);
    add(rows::kProjectorK, distortion_names("projector."), term_count(free_.projector));
    const std::string r = "proj_from_cam.rotation_", t = "proj_from_cam.translation_";
    add(rows::kProjectorW, {r + "x_rad", r + "y_rad", r + "z_rad"}, 3);
    one_axis_ = !(b.projector->x && b.projector->y);
    const int along = b.projector->x ? 1 : 0;
    const char* const letters[] = {"x_mm", "y_mm", "z_mm"};
    for (int i = 0; i < 3; ++i) {
      const bool open = one_axis_ && i == along;
      if (open && !(components_.along_mm > 0)) continue;
      if (open) along_column_ = static_cast<int>(dense_.size());
      add(rows::kProjectorT + i, {t + letters[i]}, 1);
    }
    if (components_.phase_offset > 0) {
      if (b.projector->x) pose_.push_back(rows::kOffset);
      if (b.projector->y) pose_.push_back(rows::kOffset + 1);
    }
  }
  if (components_.bend_mm > 0) {
    for (int i = 0; i < 3; ++i) pose_.push_back(rows::kBend + i);
  }
  pose_names_.resize(pose_.size(), "board and phase");
  reported_ = static_cast<int>(dense_.size());
  if (components_.pitch > 0) add(rows::kPitch, {"board scale"}, 1);
  if (components_.bow_mm > 0) add(rows::kBow, {"board bow x", "board bow y", "board twist"}, 3);
  if (b.flats > 0 && components_.flat_bow_mm > 0) add(rows::kFlatBow, {"flat bow x", "flat bow y", "flat twist"}, 3);
}

int BundleSystem::lens_and_pose_unknowns() const {
  return reported_ + (free_.camera_and_poses ? 6 * (poses_ - flats_) + 3 * flats_ : 0);
}

double BundleSystem::prior_cost(const Bundle& b) const {
  double sum = 0;
  const auto add = [&](double value, double sd) {
    if (sd > 0) sum += value * value / (sd * sd);
  };
  add(b.pitch_error, components_.pitch);
  for (const double v : b.bow_mm) add(v, components_.bow_mm);
  for (const double v : b.flat_bow_mm) add(v, components_.flat_bow_mm);
  for (const auto& e : b.print_mm) {
    add(e.head<2>().norm(), components_.print_mm);
    add(e.z(), components_.relief_mm);
  }
  for (const auto& c : b.bend_mm) add(c.norm(), components_.bend_mm);
  for (const auto& o : b.phase_offset) add(o.norm(), components_.phase_offset);
  if (along_column_ >= 0) add(b.proj_from_cam.translation_mm[b.projector->x ? 1 : 0], components_.along_mm);
  return sum;
}

double BundleSystem::cost(const Bundle& b) const {
  const auto shapes = rows::bow_shapes(b);
  std::vector<rows::Frame> frames;
  for (std::size_t j = 0; j < b.cam_from_board.size(); ++j) frames.push_back(rows::frame_of(b, j));
  const Robust robust{loss_scale_ * loss_scale_};
  double sum = prior_cost(b);
  SightRows r;
  for (const Sight& s : b.sights) {
    if (!s.used) continue;
    const auto pose = static_cast<std::size_t>(s.pose);
    if (!rows::evaluate(b, frames[pose], shapes[rows::shape_index(b, s)], s, rows::With::residuals, r)) {
      return std::numeric_limits<double>::infinity();
    }
    if (r.has[0]) {
      const double k = whitening(s, 0, components_);
      sum += robust.cost(k * k * (std::pow(r.row[0].residual, 2) + std::pow(r.row[1].residual, 2)));
    }
    for (const std::size_t i : {2U, 3U}) {
      if (r.has[i]) sum += robust.cost(std::pow(whitening(s, i, components_) * r.row[i].residual, 2));
    }
  }
  return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

bool BundleSystem::linearise(const Bundle& b) {
  const auto shapes = rows::bow_shapes(b);
  const Robust robust{loss_scale_ * loss_scale_};
  const auto nd = static_cast<Index>(dense_.size()), np = static_cast<Index>(pose_.size());
  const Index local = nd + np + 1, m = nd + per_target_ * targets_;
  shared_.setZero(m, m);
  shared_g_.setZero(m);
  blocks_.assign(static_cast<std::size_t>(poses_), {});

  std::vector<std::vector<const Sight*>> of_pose(static_cast<std::size_t>(poses_));
  for (const Sight& s : b.sights) {
    if (s.used) of_pose[static_cast<std::size_t>(s.pose)].push_back(&s);
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  RowMajor lines;  // one reading per line: shared, pose, residual
  SightRows r;
  for (std::size_t j = 0; j < of_pose.size(); ++j) {
    const rows::Frame frame = rows::frame_of(b, j);
    PoseBlock& block = blocks_[j];
    block.w.setZero(np, m);
    lines.setZero(static_cast<Index>(4 * of_pose[j].size()), local);
    Index n = 0;
    for (const Sight* s : of_pose[j]) {
      if (!rows::evaluate(b, frame, shapes[rows::shape_index(b, *s)], *s, rows::With::derivatives, r)) return false;
      const Index first = n;
      Eigen::Matrix<double, 4, 3> by_print;
      for (const auto& [from, to] : {std::pair<std::size_t, std::size_t>{0, 2}, {2, 3}, {3, 4}}) {
        if (!r.has[from]) continue;
        double r2 = 0;
        for (std::size_t k = from; k < to; ++k) r2 += std::pow(whitening(*s, k, components_) * r.row[k].residual, 2);
        const double root_weight = std::sqrt(robust.weight(r2));
        for (std::size_t k = from; k < to; ++k) {
          const double factor = root_weight * whitening(*s, k, components_);
          double* line = lines.row(n).data();
          for (const int column : dense_) *line++ = factor * r.row[k].by[static_cast<std::size_t>(column)];
          for (const int column : pose_) *line++ = factor * r.row[k].by[static_cast<std::size_t>(column)];
          *line = factor * r.row[k].residual;
          const auto& by = r.row[k].by;
          by_print.row(n - first) << factor * by[rows::kPrint], factor * by[rows::kPrint + 1],
              factor * by[rows::kPrint + 2];
          ++n;
        }
      }
      if (targets_ == 0 || s->target == kOnFlat) continue;
      const auto e = by_print.topLeftCorner(n - first, per_target_);
      const Eigen::MatrixXd cross = e.transpose() * lines.middleRows(first, n - first);
      const Index at = print_column(static_cast<std::size_t>(s->target));
      shared_.block(at, 0, per_target_, nd) += cross.leftCols(nd);
      shared_.block(at, at, per_target_, per_target_) += e.transpose() * e;
      block.w.block(0, at, np, per_target_) += cross.middleCols(nd, np).transpose();
      shared_g_.segment(at, per_target_) += cross.col(local - 1);
    }
    const Eigen::MatrixXd normal = lines.topRows(n).transpose() * lines.topRows(n);
    shared_.topLeftCorner(nd, nd) += normal.topLeftCorner(nd, nd);
    shared_g_.head(nd) += normal.col(local - 1).head(nd);
    block.a = normal.block(nd, nd, np, np);
    block.w.leftCols(nd) = normal.block(nd, 0, np, nd);
    block.g = normal.col(local - 1).segment(nd, np);
  }
  shared_.topRightCorner(nd, m - nd) = shared_.bottomLeftCorner(m - nd, nd).transpose();
  add_priors(b);
  return shared_.allFinite() && shared_g_.allFinite();
}

void BundleSystem::add_priors(const Bundle& b) {
  const auto shared = [&](Index i, double value, double sd) {
    shared_(i, i) += 1.0 / (sd * sd);
    shared_g_[i] += value / (sd * sd);
  };
  for (std::size_t i = 0; i < dense_.size(); ++i) {
    const auto at = static_cast<Index>(i);
    if (dense_[i] == rows::kPitch) shared(at, b.pitch_error, components_.pitch);
    if (dense_[i] >= rows::kBow && dense_[i] < rows::kFlatBow) {
      shared(at, b.bow_mm[dense_[i] - rows::kBow], components_.bow_mm);
    }
    if (dense_[i] >= rows::kFlatBow && dense_[i] < rows::kDense) {
      shared(at, b.flat_bow_mm[dense_[i] - rows::kFlatBow], components_.flat_bow_mm);
    }
  }
  if (along_column_ >= 0) {
    shared(along_column_, b.proj_from_cam.translation_mm[b.projector->x ? 1 : 0], components_.along_mm);
  }
  for (int t = 0; t < targets_; ++t) {
    const auto target = static_cast<std::size_t>(t);
    for (Index c = 0; c < per_target_; ++c) {
      shared(print_column(target) + c, b.print_mm.empty() ? 0.0 : b.print_mm[target][c],
             c < 2 ? components_.print_mm : components_.relief_mm);
    }
  }
  for (std::size_t j = 0; j < blocks_.size(); ++j) {
    if (free_.camera_and_poses && b.is_flat(j)) hold_in_its_plane(b.cam_from_board[j], blocks_[j].a);
    for (std::size_t i = 0; i < pose_.size(); ++i) {
      double value = 0, sd = 0;
      if (pose_[i] >= rows::kBend) {
        value = b.bend_mm.empty() ? 0.0 : b.bend_mm[j][pose_[i] - rows::kBend];
        sd = components_.bend_mm;
      } else if (pose_[i] >= rows::kOffset) {
        value = b.phase_offset.empty() ? 0.0 : b.phase_offset[j][pose_[i] - rows::kOffset];
        sd = components_.phase_offset;
      } else {
        continue;
      }
      const auto at = static_cast<Index>(i);
      blocks_[j].a(at, at) += 1.0 / (sd * sd);
      blocks_[j].g[at] += value / (sd * sd);
    }
  }
}

void BundleSystem::hold_in_its_plane(const Rigid3& cam_from_flat, Eigen::MatrixXd& a) {
  // No reading moves with these three, so any weight holds them where they are; these are of the others' order.
  constexpr double kTurn_rad = 1e-5, kShift_mm = 1e-2;
  const Eigen::Matrix3d axes = cam_from_flat.rotation_matrix();
  a.topLeftCorner<3, 3>() += axes.col(2) * axes.col(2).transpose() / (kTurn_rad * kTurn_rad);
  a.block<3, 3>(3, 3) += axes.leftCols<2>() * axes.leftCols<2>().transpose() / (kShift_mm * kShift_mm);
}

std::optional<BundleSystem::Direction> BundleSystem::newton(double lambda) const {
  Eigen::MatrixXd s = shared_;
  s.diagonal() *= 1.0 + lambda;
  Eigen::VectorXd g = shared_g_;
  std::vector<Eigen::LLT<Eigen::MatrixXd>> factors;
  for (const PoseBlock& block : blocks_) {
    Eigen::MatrixXd a = block.a;
    a.diagonal() *= 1.0 + lambda;
    factors.emplace_back(a);
    if (factors.back().info() != Eigen::Success) return std::nullopt;
    if (a.rows() == 0) continue;
    const Eigen::MatrixXd half = factors.back().matrixL().solve(block.w);
    s.selfadjointView<Eigen::Lower>().rankUpdate(half.transpose(), -1.0);  // eq. 1
    g -= half.transpose() * factors.back().matrixL().solve(block.g);
  }
  // Scaled to a unit diagonal: focal lengths and k2 differ by 1e5.
  const Eigen::VectorXd scale = s.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled =
      scale.asDiagonal() * Eigen::MatrixXd(s.selfadjointView<Eigen::Lower>()) * scale.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> reduced(scaled);
  if (reduced.info() != Eigen::Success) return std::nullopt;
  Direction out{-(scale.asDiagonal() * reduced.solve(scale.asDiagonal() * g)), {}};
  bool finite = out.shared.allFinite();
  for (std::size_t j = 0; j < blocks_.size(); ++j) {
    out.pose.push_back(pose_.empty() ? Eigen::VectorXd()
                                     : Eigen::VectorXd(-factors[j].solve(blocks_[j].g + blocks_[j].w * out.shared)));
    finite = finite && out.pose.back().allFinite();
  }
  return finite ? std::optional(std::move(out)) : std::nullopt;
}

double BundleSystem::slope(const Direction& d) const {
  double sum = d.shared.dot(shared_g_);
  for (std::size_t j = 0; j < blocks_.size(); ++j) sum += d.pose[j].dot(blocks_[j].g);
  return sum;
}

Bundle BundleSystem::moved(const Bundle& b, const Direction& direction, double length) const {
  const Eigen::VectorXd ds = length * direction.shared;
  Bundle next = b;
  next.bend_mm.resize(static_cast<std::size_t>(poses_), Eigen::Vector3d::Zero());
  next.phase_offset.resize(static_cast<std::size_t>(poses_), Eigen::Vector2d::Zero());
  next.print_mm.resize(b.targets_mm.size(), Eigen::Vector3d::Zero());
  Eigen::Vector3d projector_w = Eigen::Vector3d::Zero();
  double* const camera[] = {&next.camera.fx_px, &next.camera.fy_px, &next.camera.cx_px, &next.camera.cy_px};
  for (std::size_t i = 0; i < dense_.size(); ++i) {
    const double d = ds[static_cast<Index>(i)];
    const int c = dense_[i];
    if (c < rows::kCameraK) {
      *camera[c] += d;
    } else if (c < rows::kAxis) {
      next.camera.distortion[static_cast<std::size_t>(c - rows::kCameraK)] += d;
    } else if (c < rows::kProjectorK) {
      auto& axis = c < rows::kAxis + 2 ? next.projector->x : next.projector->y;
      ((c - rows::kAxis) % 2 == 0 ? axis->f : axis->u0) += d;
    } else if (c < rows::kProjectorW) {
      next.projector->distortion[static_cast<std::size_t>(c - rows::kProjectorK)] += d;
    } else if (c < rows::kProjectorT) {
      projector_w[c - rows::kProjectorW] = d;
    } else if (c < rows::kPitch) {
      next.proj_from_cam.translation_mm[c - rows::kProjectorT] += d;
    } else if (c < rows::kBow) {
      next.pitch_error += d;
    } else if (c < rows::kFlatBow) {
      next.bow_mm[c - rows::kBow] += d;
    } else {
      next.flat_bow_mm[c - rows::kFlatBow] += d;
    }
  }
  next.proj_from_cam.rotation = (rotation_from_vector(projector_w) * next.proj_from_cam.rotation).normalized();
  for (int t = 0; t < targets_; ++t) {
    next.print_mm[static_cast<std::size_t>(t)].head(per_target_) +=
        ds.segment(print_column(static_cast<std::size_t>(t)), per_target_);
  }
  for (std::size_t j = 0; j < direction.pose.size(); ++j) {
    if (pose_.empty()) break;
    const Eigen::VectorXd dp = length * direction.pose[j];
    Eigen::Vector3d w = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < pose_.size(); ++i) {
      const double d = dp[static_cast<Index>(i)];
      const int c = pose_[i];
      if (c < rows::kPoseT) {
        w[c - rows::kPoseW] = d;
      } else if (c < rows::kOffset) {
        next.cam_from_board[j].translation_mm[c - rows::kPoseT] += d;
      } else if (c < rows::kBend) {
        next.phase_offset[j][c - rows::kOffset] += d;
      } else {
        next.bend_mm[j][c - rows::kBend] += d;
      }
    }
    auto& rotation = next.cam_from_board[j].rotation;
    rotation = (rotation_from_vector(w) * rotation).normalized();
  }
  return next;
}

Eigen::VectorXd BundleSystem::difference(const Bundle& from, const Bundle& to) const {
  const auto values = [](const Bundle& b) {
    std::array<double, rows::kPitch> v{};
    const auto put = [&](int first, auto... value) {
      auto at = v.begin() + first;
      ((*at++ = value), ...);
    };
    put(rows::kCamera, b.camera.fx_px, b.camera.fy_px, b.camera.cx_px, b.camera.cy_px);
    std::copy(b.camera.distortion.begin(), b.camera.distortion.end(), v.begin() + rows::kCameraK);
    if (!b.projector) return v;
    if (b.projector->x) put(rows::kAxis, b.projector->x->f, b.projector->x->u0);
    if (b.projector->y) put(rows::kAxis + 2, b.projector->y->f, b.projector->y->u0);
    std::copy(b.projector->distortion.begin(), b.projector->distortion.end(), v.begin() + rows::kProjectorK);
    const auto& t = b.proj_from_cam.translation_mm;
    put(rows::kProjectorT, t.x(), t.y(), t.z());
    return v;
  };
  const auto a = values(from), b = values(to);
  const Eigen::Vector3d w = vector_from_rotation(to.proj_from_cam.rotation * from.proj_from_cam.rotation.conjugate());
  Eigen::VectorXd out(reported_);
  for (int i = 0; i < reported_; ++i) {
    const int c = dense_[static_cast<std::size_t>(i)];
    const bool turn = c >= rows::kProjectorW && c < rows::kProjectorT;
    out[i] = turn ? w[c - rows::kProjectorW] : b[static_cast<std::size_t>(c)] - a[static_cast<std::size_t>(c)];
  }
  return out;
}

Result<BundleSystem::Posterior> BundleSystem::posterior(const Bundle& b) const {
  const auto open = [](const std::string& what) {
    return unanswerable(fmt::format(
        "the poses do not determine {}: boards that are parallel, or too alike; capture the board tilted by "
        "20 to 40 degrees about different axes",
        what));
  };
  Eigen::MatrixXd s = shared_;
  const auto nd = static_cast<Index>(dense_.size()), np = static_cast<Index>(pose_.size());
  std::vector<Eigen::MatrixXd> inverse_a, k;
  for (std::size_t j = 0; j < blocks_.size(); ++j) {
    Inverse a = np > 0 ? inverse_of(blocks_[j].a) : Inverse{Eigen::MatrixXd(0, 0), -1};
    if (a.open >= 0) return open(fmt::format("pose {} {}", j + 1, pose_names_[static_cast<std::size_t>(a.open)]));
    k.push_back(a.matrix * blocks_[j].w);
    inverse_a.push_back(std::move(a.matrix));
    s.noalias() -= blocks_[j].w.transpose() * k.back();
  }
  Inverse c = inverse_of(0.5 * (s + s.transpose()));
  if (c.open >= 0) return open(c.open < nd ? with_focal_lengths(s, names_, c.open) : "a corner's place on the board");
  if (!c.matrix.allFinite()) return unanswerable("the covariance of the calibration is not finite; capture more poses");
  Posterior out;
  out.shared = std::move(c.matrix);
  const Eigen::MatrixXd& css = out.shared;
  const auto note = [](Scatter& scatter, double value, double sd, double posterior_variance) {
    scatter.squares += value * value / (sd * sd);
    scatter.redundancy += 1.0 - posterior_variance / (sd * sd);
    ++scatter.count;
  };
  for (int t = 0; t < targets_; ++t) {
    const Index at = print_column(static_cast<std::size_t>(t));
    for (Index i = 0; i < per_target_; ++i) {
      note(i < 2 ? out.print : out.relief, b.print_mm[static_cast<std::size_t>(t)][i],
           i < 2 ? components_.print_mm : components_.relief_mm, css(at + i, at + i));
    }
  }

  const auto shapes = rows::bow_shapes(b);
  std::vector<std::vector<std::size_t>> of_pose(blocks_.size());
  for (std::size_t i = 0; i < b.sights.size(); ++i) {
    if (b.sights[i].used) of_pose[static_cast<std::size_t>(b.sights[i].pose)].push_back(i);
  }
  SightRows r;
  for (std::size_t j = 0; j < blocks_.size(); ++j) {
    const Eigen::MatrixXd cps = -k[j] * css;  // eq. 2
    const Eigen::MatrixXd cpp = inverse_a[j] - cps * k[j].transpose();
    for (std::size_t i = 0; i < pose_.size(); ++i) {
      const auto at = static_cast<Index>(i);
      if (pose_[i] >= rows::kBend) {
        note(out.bend, b.bend_mm[j][pose_[i] - rows::kBend], components_.bend_mm, cpp(at, at));
      } else if (pose_[i] >= rows::kOffset) {
        note(out.phase_offset, b.phase_offset[j][pose_[i] - rows::kOffset], components_.phase_offset, cpp(at, at));
      }
    }
    const rows::Frame frame = rows::frame_of(b, j);
    const Index ne = targets_ > 0 ? per_target_ : 0, local = nd + np + ne;
    Eigen::MatrixXd covariance(local, local);
    covariance.topLeftCorner(nd, nd) = css.topLeftCorner(nd, nd);
    covariance.block(nd, 0, np, nd) = cps.leftCols(nd);
    covariance.block(nd, nd, np, np) = cpp;
    Eigen::VectorXd line(local);
    for (const std::size_t i : of_pose[j]) {
      const Sight& sight = b.sights[i];
      const bool on_flat = sight.target == kOnFlat;
      if (!rows::evaluate(b, frame, shapes[rows::shape_index(b, sight)], sight, rows::With::derivatives, r)) continue;
      if (ne > 0 && on_flat) {  // the last corner's, which its zero columns leave out
        covariance.bottomRows(ne).setZero();
        covariance.rightCols(ne).setZero();
      } else if (ne > 0) {
        const Index at = print_column(static_cast<std::size_t>(sight.target));
        covariance.block(nd + np, 0, ne, nd) = css.block(at, 0, ne, nd);
        covariance.block(nd + np, nd, ne, np) = cps.middleCols(at, ne).transpose();
        covariance.block(nd + np, nd + np, ne, ne) = css.block(at, at, ne, ne);
      }
      for (std::size_t q = 0; q < 4; ++q) {
        if (!r.has[q]) continue;
        const double factor = whitening(sight, q, components_);
        for (Index n = 0; n < nd; ++n)
          line[n] = factor * r.row[q].by[static_cast<std::size_t>(dense_[static_cast<std::size_t>(n)])];
        for (Index n = 0; n < np; ++n)
          line[nd + n] = factor * r.row[q].by[static_cast<std::size_t>(pose_[static_cast<std::size_t>(n)])];
        for (Index n = 0; n < ne; ++n)
          line[nd + np + n] = factor * r.row[q].by[static_cast<std::size_t>(rows::kPrint + n)];
        const double h = line.dot(covariance.selfadjointView<Eigen::Lower>() * line);
        out.readings.push_back({i,
                                q < 2     ? Group::camera
                                : on_flat ? Group::flat
                                          : Group::projector,
                                factor * r.row[q].residual, h});
      }
    }
  }
  return out;
}

std::optional<Eigen::MatrixXd> BundleSystem::information(const Bundle& b) {
  require(reported_ == static_cast<int>(dense_.size()) && targets_ == 0, "only reported unknowns are shared");
  if (!linearise(b)) return std::nullopt;
  Eigen::MatrixXd s = shared_;
  if (along_column_ >= 0) s(along_column_, along_column_) -= 1.0 / (components_.along_mm * components_.along_mm);
  for (const PoseBlock& block : blocks_) {
    const Eigen::LLT<Eigen::MatrixXd> llt(block.a);
    if (llt.info() != Eigen::Success) return std::nullopt;
    const Eigen::MatrixXd half = llt.matrixL().solve(block.w);
    s.noalias() -= half.transpose() * half;
  }
  return Eigen::MatrixXd(0.5 * (s + s.transpose()));
}

}  // namespace fringecal::calib

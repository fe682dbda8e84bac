#include "calib/joint_solve.h"

#include "calib/bundle_cost.h"
#include "core/error.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

namespace fringecal::calib {
namespace {

using bundle::BoardPlace;
using bundle::CameraResidual;
using bundle::PriorResidual;
using bundle::ProjectorResidual;

constexpr double kRejectBeyond = 4.0;  // standard deviations: 6e-5 of good components, calibrate.h
// Readings better than a thousandth of what they state are taken for a thousandth: without a floor, readings without
// any error would drown the priors in rounding.
constexpr double kLeastScale = 1e-3;

enum class Group { camera, projector, prior };

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Parameters as the solver moves them. Addresses stay while the object lives.
struct Parameters {
  std::array<double, 4> camera{};
  model::Distortion camera_distortion{}, projector_distortion{};
  std::array<std::array<double, 2>, 2> axis{};  // f, u0 along x and y
  Eigen::Matrix3d projector_rotation;
  Eigen::Vector3d projector_w = Eigen::Vector3d::Zero(), projector_t = Eigen::Vector3d::Zero();
  std::vector<Eigen::Matrix3d> pose_rotation;
  std::vector<Eigen::Vector3d> pose_w, pose_t;
  double scale = 0;
  Eigen::Vector2d bow = Eigen::Vector2d::Zero();
  std::vector<Eigen::Vector2d> print;
};

/// One solve: the Ceres problem of the current scales and the sights in use.
class Problem {
 public:
  Problem(Bundle& bundle, const SolveSettings& settings) : bundle_(bundle), settings_(settings) {}

  void load() {
    const auto& c = bundle_.camera;
    p_.camera = {c.fx_px, c.fy_px, c.cx_px, c.cy_px};
    p_.camera_distortion = c.distortion;
    if (bundle_.projector) {
      const auto& projector = *bundle_.projector;
      if (projector.x) p_.axis[0] = {projector.x->f, projector.x->u0};
      if (projector.y) p_.axis[1] = {projector.y->f, projector.y->u0};
      p_.projector_distortion = projector.distortion;
    }
    p_.projector_rotation = bundle_.proj_from_cam.rotation_matrix();
    p_.projector_t = bundle_.proj_from_cam.translation_mm;
    p_.projector_w.setZero();
    p_.pose_rotation.clear();
    p_.pose_t.clear();
    for (const auto& pose : bundle_.cam_from_board) {
      p_.pose_rotation.push_back(pose.rotation_matrix());
      p_.pose_t.push_back(pose.translation_mm);
    }
    p_.pose_w.assign(bundle_.cam_from_board.size(), Eigen::Vector3d::Zero());
    p_.bow = bundle_.bow_mm;
    p_.print = bundle_.print_mm;
    p_.print.resize(bundle_.targets_mm.size(), Eigen::Vector2d::Zero());
  }

  void store() {
    auto& c = bundle_.camera;
    c.fx_px = p_.camera[0];
    c.fy_px = p_.camera[1];
    c.cx_px = p_.camera[2];
    c.cy_px = p_.camera[3];
    c.distortion = p_.camera_distortion;
    if (bundle_.projector) {
      auto& projector = *bundle_.projector;
      if (projector.x) std::tie(projector.x->f, projector.x->u0) = std::tie(p_.axis[0][0], p_.axis[0][1]);
      if (projector.y) std::tie(projector.y->f, projector.y->u0) = std::tie(p_.axis[1][0], p_.axis[1][1]);
      projector.distortion = p_.projector_distortion;
      auto& rotation = bundle_.proj_from_cam.rotation;
      rotation = (rotation_from_vector(p_.projector_w) * rotation).normalized();
      bundle_.proj_from_cam.translation_mm = p_.projector_t;
    }
    for (std::size_t i = 0; i < p_.pose_w.size(); ++i) {
      auto& pose = bundle_.cam_from_board[i];
      pose.rotation = (rotation_from_vector(p_.pose_w[i]) * pose.rotation).normalized();
      pose.translation_mm = p_.pose_t[i];
    }
    bundle_.bow_mm = p_.bow;
    bundle_.print_mm = p_.print;
    load();
  }

  /// Builds the problem for scales (s_c, s_p). loss_scale 0: plain least squares.
  void build(const Eigen::Vector2d& scales, double loss_scale) {
    problem_ = std::make_unique<ceres::Problem>();
    blocks_.clear();
    groups_.clear();
    owners_.clear();
    Eigen::Vector2d low = bundle_.targets_mm.front(), high = low;
    for (const auto& t : bundle_.targets_mm) {
      low = low.cwiseMin(t);
      high = high.cwiseMax(t);
    }
    const Eigen::Vector2d middle = 0.5 * (low + high), half = (0.5 * (high - low)).cwiseMax(1e-9);
    const auto loss = [&]() -> ceres::LossFunction* {
      return loss_scale > 0 ? new ceres::CauchyLoss(loss_scale) : nullptr;
    };
    for (std::size_t k = 0; k < bundle_.sights.size(); ++k) {
      const Sight& s = bundle_.sights[k];
      if (!s.used) continue;
      const auto pose = static_cast<std::size_t>(s.pose), target = static_cast<std::size_t>(s.target);
      const Eigen::Vector2d nominal = bundle_.targets_mm[target];
      const BoardPlace place{nominal, (nominal - middle).cwiseQuotient(half)};
      double* const w = p_.pose_w[pose].data();
      double* const t = p_.pose_t[pose].data();
      double* const print = p_.print[target].data();
      problem_->AddResidualBlock(
          new ceres::AutoDiffCostFunction<CameraResidual, 2, 4, 5, 3, 3, 1, 2, 2>(
              new CameraResidual{place, &p_.pose_rotation[pose], s.pixel, s.u_pixel_px * scales[0]}),
          loss(), p_.camera.data(), p_.camera_distortion.data(), w, t, &p_.scale, p_.bow.data(), print);
      note(Group::camera, k, 2);
      if (!bundle_.projector) continue;
      for (const int component : {0, 1}) {
        const auto& coordinate = component == 0 ? s.x : s.y;
        if (!coordinate || !bundle_.projector->axis(component == 0 ? CodeAxis::x : CodeAxis::y)) continue;
        problem_->AddResidualBlock(new ceres::AutoDiffCostFunction<ProjectorResidual, 1, 2, 5, 3, 3, 3, 3, 1, 2, 2>(
                                       new ProjectorResidual{place, &p_.pose_rotation[pose], &p_.projector_rotation,
                                                             component, coordinate->value, coordinate->u * scales[1]}),
                                   loss(), p_.axis[static_cast<std::size_t>(component)].data(),
                                   p_.projector_distortion.data(), p_.projector_w.data(), p_.projector_t.data(), w, t,
                                   &p_.scale, p_.bow.data(), print);
        note(Group::projector, k, 1);
      }
    }
    add_priors();
    list_blocks();
  }

  /// Iterations; negative where the solver could not make sense of the start.
  int solve(double tolerance) {
    ceres::Solver::Options options;
    // One thread: the sums then have one order, and the same input gives the same bytes.
    options.num_threads = 1;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 100;
    options.function_tolerance = tolerance;
    options.gradient_tolerance = 1e-16;
    options.parameter_tolerance = 1e-14;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem_.get(), &summary);
    if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) return -1;
    return static_cast<int>(summary.iterations.size());
  }

  struct Linearised {
    std::vector<double> residuals;
    Eigen::MatrixXd normal, normal_camera, normal_projector;  // J^T J, and the groups' shares
    Eigen::VectorXd gradient;
  };

  std::optional<Linearised> linearise(bool with_jacobian) const {
    ceres::Problem::EvaluateOptions options;
    options.apply_loss_function = false;
    for (const auto& b : blocks_) options.parameter_blocks.push_back(b.data);
    Linearised out;
    double cost = 0;
    std::vector<double> gradient;
    ceres::CRSMatrix j;
    if (!problem_->Evaluate(options, &cost, &out.residuals, with_jacobian ? &gradient : nullptr,
                            with_jacobian ? &j : nullptr)) {
      return std::nullopt;
    }
    for (const double r : out.residuals) {
      if (!std::isfinite(r)) return std::nullopt;
    }
    if (!with_jacobian) return out;
    out.gradient = Eigen::Map<const Eigen::VectorXd>(gradient.data(), static_cast<Eigen::Index>(gradient.size()));
    out.normal.setZero(j.num_cols, j.num_cols);
    out.normal_camera = out.normal_projector = out.normal;
    for (int r = 0; r < j.num_rows; ++r) {
      const Group group = groups_[static_cast<std::size_t>(r)];
      for (int a = j.rows[static_cast<std::size_t>(r)]; a < j.rows[static_cast<std::size_t>(r) + 1]; ++a) {
        for (int b = j.rows[static_cast<std::size_t>(r)]; b < j.rows[static_cast<std::size_t>(r) + 1]; ++b) {
          const auto ia = static_cast<std::size_t>(a), ib = static_cast<std::size_t>(b);
          const double product = j.values[ia] * j.values[ib];
          out.normal(j.cols[ia], j.cols[ib]) += product;
          if (group == Group::camera) out.normal_camera(j.cols[ia], j.cols[ib]) += product;
          if (group == Group::projector) out.normal_projector(j.cols[ia], j.cols[ib]) += product;
        }
      }
    }
    return out;
  }

  const std::vector<Group>& groups() const { return groups_; }
  const std::vector<std::size_t>& owners() const { return owners_; }

  /// Names of the parameters that are free, in the order of the Jacobian's columns; those of the report come first.
  std::vector<std::string> names() const {
    std::vector<std::string> out;
    for (const auto& b : blocks_) out.insert(out.end(), b.names.begin(), b.names.end());
    return out;
  }
  int reported() const {
    int count = 0;
    for (const auto& b : blocks_) count += b.reported ? static_cast<int>(b.names.size()) : 0;
    return count;
  }
  /// Free parameters that are not held by a prior of the board.
  int free_parameters() const {
    int count = 0;
    for (const auto& b : blocks_) count += b.held_by_prior ? 0 : static_cast<int>(b.names.size());
    return count;
  }
  bool solves_along() const { return solves_along_; }

 private:
  struct Block {
    double* data;
    std::vector<std::string> names;
    bool reported, held_by_prior;
  };

  void note(Group group, std::size_t owner, int count) {
    groups_.insert(groups_.end(), static_cast<std::size_t>(count), group);
    owners_.insert(owners_.end(), static_cast<std::size_t>(count), owner);
  }

  template <int kSize>
  void prior(double* block, int component, double u) {
    if (!problem_->HasParameterBlock(block)) return;
    problem_->AddResidualBlock(
        new ceres::AutoDiffCostFunction<PriorResidual<kSize>, 1, kSize>(new PriorResidual<kSize>{component, 0.0, u}),
        nullptr, block);
    note(Group::prior, 0, 1);
  }

  void add_priors() {
    if (settings_.u_pitch_relative > 0) prior<1>(&p_.scale, 0, settings_.u_pitch_relative);
    for (const int c : {0, 1}) {
      if (settings_.u_bow_mm > 0) prior<2>(p_.bow.data(), c, settings_.u_bow_mm);
      if (!(settings_.u_print_mm > 0)) continue;
      for (auto& print : p_.print) prior<2>(print.data(), c, settings_.u_print_mm);
    }
    solves_along_ = false;
    if (bundle_.projector && !(bundle_.projector->x && bundle_.projector->y) && settings_.u_along_mm > 0) {
      prior<3>(p_.projector_t.data(), bundle_.projector->x ? 1 : 0, settings_.u_along_mm);
      solves_along_ = true;
    }
  }

  /// Registers a block: `free` holds a name for each component that moves and nothing for one that stays.
  void block(double* data, const std::vector<std::string>& free, bool reported, bool held_by_prior) {
    if (!problem_->HasParameterBlock(data)) return;
    std::vector<int> constant;
    Block b{data, {}, reported, held_by_prior};
    for (std::size_t i = 0; i < free.size(); ++i) {
      if (free[i].empty()) {
        constant.push_back(static_cast<int>(i));
      } else {
        b.names.push_back(free[i]);
      }
    }
    if (constant.size() == free.size()) {
      problem_->SetParameterBlockConstant(data);
      return;
    }
    if (!constant.empty()) {
      problem_->SetManifold(data, new ceres::SubsetManifold(static_cast<int>(free.size()), constant));
    }
    blocks_.push_back(std::move(b));
  }

  static std::vector<std::string> distortion_names(const std::string& prefix, DistortionTerms terms) {
    std::vector<std::string> names;
    int k = 0;
    for (const char* name : {"k1", "k2", "p1", "p2", "k3"}) {
      names.push_back(k++ < term_count(terms) ? prefix + name : "");
    }
    return names;
  }

  void list_blocks() {
    const bool held = settings_.held == Held::camera_and_poses;
    const auto unless_held = [&](std::vector<std::string> names) {
      if (held) names.assign(names.size(), "");
      return names;
    };
    block(p_.camera.data(), unless_held({"camera.fx_px", "camera.fy_px", "camera.cx_px", "camera.cy_px"}), true, false);
    block(p_.camera_distortion.data(), unless_held(distortion_names("camera.", settings_.camera_terms)), true, false);
    block(p_.axis[0].data(), {"projector.x.f", "projector.x.u0"}, true, false);
    block(p_.axis[1].data(), {"projector.y.f", "projector.y.u0"}, true, false);
    block(p_.projector_distortion.data(), distortion_names("projector.", settings_.projector_terms), true, false);
    const std::string r = "proj_from_cam.rotation_", t = "proj_from_cam.translation_";
    block(p_.projector_w.data(), {r + "x_rad", r + "y_rad", r + "z_rad"}, true, false);
    std::vector<std::string> translation = {t + "x_mm", t + "y_mm", t + "z_mm"};
    const bool one_axis = bundle_.projector && !(bundle_.projector->x && bundle_.projector->y);
    if (one_axis && !solves_along_) translation[bundle_.projector->x ? 1 : 0].clear();
    block(p_.projector_t.data(), translation, true, false);
    for (std::size_t i = 0; i < p_.pose_w.size(); ++i) {
      const std::string n = fmt::format("pose {} ", i + 1);
      block(p_.pose_w[i].data(), unless_held({n + "rotation x", n + "rotation y", n + "rotation z"}), false, false);
      block(p_.pose_t[i].data(), unless_held({n + "x", n + "y", n + "z"}), false, false);
    }
    const auto if_prior = [](double u, std::vector<std::string> names) {
      if (!(u > 0)) names.assign(names.size(), "");
      return names;
    };
    block(&p_.scale, if_prior(settings_.u_pitch_relative, {"board scale"}), false, true);
    block(p_.bow.data(), if_prior(settings_.u_bow_mm, {"board bow x", "board bow y"}), false, true);
    for (auto& print : p_.print) {
      block(print.data(), if_prior(settings_.u_print_mm, {"print x", "print y"}), false, true);
    }
  }

  Bundle& bundle_;
  const SolveSettings& settings_;
  Parameters p_;
  std::unique_ptr<ceres::Problem> problem_;
  std::vector<Block> blocks_;
  std::vector<Group> groups_;        // per residual
  std::vector<std::size_t> owners_;  // sight of each residual
  bool solves_along_ = false;
};

/// 1.4826 MAD of the residuals of a group about zero, in units of their whitening.
double robust_scale(const std::vector<double>& residuals, const std::vector<Group>& groups, Group group) {
  std::vector<double> sizes;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (groups[i] == group) sizes.push_back(std::abs(residuals[i]));
  }
  return sizes.empty() ? 1.0 : std::max(1.4826 * median(std::move(sizes)), 1e-9);
}

/// Leaves out the sights with a component beyond the limit; returns how many. The standard deviation is the larger of
/// the whole group's (1, the residuals are whitened) and of the sight's own pose, robustly: a board that was bent or
/// moved in one pose raises the scatter of that pose, which is no reason to keep only those of its corners that happen
/// to fit.
int reject(Bundle& bundle, const Problem& problem, const std::vector<double>& residuals) {
  const auto slot = [&](std::size_t i) {
    const auto pose = static_cast<std::size_t>(bundle.sights[problem.owners()[i]].pose);
    return 2 * pose + (problem.groups()[i] == Group::camera ? 0 : 1);
  };
  std::vector<std::vector<double>> sizes(2 * bundle.cam_from_board.size());
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (problem.groups()[i] != Group::prior) sizes[slot(i)].push_back(std::abs(residuals[i]));
  }
  std::vector<double> limit;
  for (auto& s : sizes)
    limit.push_back(kRejectBeyond * (s.empty() ? 1.0 : std::max(1.0, 1.4826 * median(std::move(s)))));
  int count = 0;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (problem.groups()[i] == Group::prior) continue;
    Sight& sight = bundle.sights[problem.owners()[i]];
    if (sight.used && std::abs(residuals[i]) > limit[slot(i)]) {
      sight.used = false;
      ++count;
    }
  }
  return count;
}

/// The inverse of a normal matrix scaled to a unit diagonal, or which parameter the data leave open.
Result<Eigen::MatrixXd> inverse_of(const Eigen::MatrixXd& normal, const std::vector<std::string>& names) {
  const Eigen::Index n = normal.rows();
  Eigen::VectorXd scale(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    if (!(normal(i, i) > 0.0)) {
      return unanswerable(
          fmt::format("the poses say nothing about {}; capture the board in more, differently tilted poses",
                      names[static_cast<std::size_t>(i)]));
    }
    scale[i] = 1.0 / std::sqrt(normal(i, i));
  }
  const Eigen::MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(scaled);
  Eigen::Index worst = 0;
  // A pivot of 1e-13 is what rounding leaves of a singular matrix of this size.
  if (ldlt.info() != Eigen::Success || !(ldlt.vectorD().minCoeff(&worst) > 1e-13)) {
    Eigen::VectorXi order = Eigen::VectorXi::LinSpaced(static_cast<int>(n), 0, static_cast<int>(n) - 1);
    order = ldlt.transpositionsP() * order;
    return unanswerable(fmt::format(
        "the poses do not determine {}: boards that are parallel, or too alike; capture the board tilted by "
        "20 to 40 degrees about different axes",
        names[static_cast<std::size_t>(order[worst])]));
  }
  Eigen::MatrixXd inverse = ldlt.solve(Eigen::MatrixXd::Identity(n, n));
  inverse = scale.asDiagonal() * inverse * scale.asDiagonal();
  inverse = 0.5 * (inverse + inverse.transpose()).eval();
  if (!inverse.allFinite()) return unanswerable("the covariance of the calibration is not finite; capture more poses");
  return inverse;
}

}  // namespace

int term_count(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::none:
      return 0;
    case DistortionTerms::radial:
      return 2;
    case DistortionTerms::radial_tangential:
      return 4;
    case DistortionTerms::full:
      return 5;
    case DistortionTerms::automatic:
      break;
  }
  throw std::logic_error("broken contract: 'automatic' is resolved before terms are counted");
}

const char* name_of(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::none:
      return "none";
    case DistortionTerms::radial:
      return "radial";
    case DistortionTerms::radial_tangential:
      return "radial+tangential";
    case DistortionTerms::full:
      return "full";
    case DistortionTerms::automatic:
      return "auto";
  }
  return "";
}

Result<SolveReport> solve_bundle(Bundle& bundle, const SolveSettings& settings) {
  require(!bundle.targets_mm.empty() && !bundle.sights.empty(), "a bundle has targets and sights");
  SolveReport report;
  Problem problem(bundle, settings);
  problem.load();
  const auto failed = [] {
    return unanswerable(
        "the joint solve found no camera and projector that explain the corners; look for a pose with a "
        "wrong board, a moved board or a moved scanner");
  };
  const auto run = [&](const Eigen::Vector2d& scales, double loss, double tolerance) {
    problem.build(scales, loss);
    const int iterations = problem.solve(tolerance);
    if (iterations < 0) return false;
    report.iterations += iterations;
    problem.store();
    return true;
  };

  Eigen::Vector2d scales = settings.fixed_scales.value_or(Eigen::Vector2d(1, 1));
  // Rejection never works with a smaller standard deviation than the robust passes found: what is left after each round of
  // leaving out scatters less, and judged by that the data would be eroded.
  Eigen::Vector2d robust_scales(0, 0);
  const bool may_reject = !settings.fixed_scales && settings.outliers == Outliers::reject;
  if (may_reject) {
    // Robust passes. The scale of the loss comes from the residuals themselves; it starts wide, at the start's own
    // misfit.
    for (int pass = 0; pass < 3; ++pass) {
      problem.build(scales, 0);
      const auto at_start = problem.linearise(false);
      if (!at_start) return failed();
      const Eigen::Vector2d spread(robust_scale(at_start->residuals, problem.groups(), Group::camera),
                                   robust_scale(at_start->residuals, problem.groups(), Group::projector));
      scales = scales.cwiseProduct(spread).cwiseMax(kLeastScale);
      if (!run(scales, 2.0, 1e-8)) return failed();
    }
    problem.build(scales, 0);
    const auto after = problem.linearise(false);
    if (!after) return failed();
    scales[0] *= robust_scale(after->residuals, problem.groups(), Group::camera);
    scales[1] *= robust_scale(after->residuals, problem.groups(), Group::projector);
    scales = robust_scales = scales.cwiseMax(kLeastScale);
    problem.build(scales, 0);
    const auto whitened = problem.linearise(false);
    if (!whitened) return failed();
    report.n_rejected += reject(bundle, problem, whitened->residuals);
  }

  // Clean passes: solve, variance components, outliers against them, until nothing changes.
  Eigen::MatrixXd inverse;
  Problem::Linearised linear;
  constexpr int kPasses = 12;
  for (int pass = 0; pass < kPasses; ++pass) {
    if (!run(scales, 0, 1e-15)) return failed();
    problem.build(scales, 0);
    auto now = problem.linearise(true);
    if (!now) return failed();
    linear = std::move(*now);
    auto inverted = inverse_of(linear.normal, problem.names());
    if (!inverted) return tl::unexpected(inverted.error());
    inverse = std::move(*inverted);
    if (settings.fixed_scales) break;

    Eigen::Vector2d chi2(0, 0), count(0, 0);
    for (std::size_t i = 0; i < linear.residuals.size(); ++i) {
      const Group g = problem.groups()[i];
      if (g == Group::prior) continue;
      chi2[g == Group::camera ? 0 : 1] += linear.residuals[i] * linear.residuals[i];
      count[g == Group::camera ? 0 : 1] += 1;
    }
    const Eigen::Vector2d spent(inverse.cwiseProduct(linear.normal_camera).sum(),
                                inverse.cwiseProduct(linear.normal_projector).sum());
    Eigen::Vector2d factor(1, 1);
    for (const int g : {0, 1}) {
      if (!(count[g] > 0)) continue;
      const double redundancy = count[g] - spent[g];
      if (!(redundancy >= 3.0)) {
        return unanswerable(fmt::format("{:.0f} {} readings leave {:.1f} degrees of freedom; capture more poses",
                                        count[g], g == 0 ? "camera" : "projector", redundancy));
      }
      factor[g] = std::max(std::sqrt(chi2[g] / redundancy), 1e-9);  // eq. 2
    }
    const Eigen::Vector2d judged = factor.cwiseMax(robust_scales.cwiseQuotient(scales));
    for (std::size_t i = 0; i < linear.residuals.size(); ++i) {
      if (problem.groups()[i] == Group::camera) linear.residuals[i] /= judged[0];
      if (problem.groups()[i] == Group::projector) linear.residuals[i] /= judged[1];
    }
    const int rejected = may_reject ? reject(bundle, problem, linear.residuals) : 0;
    report.n_rejected += rejected;
    const Eigen::Vector2d next = scales.cwiseProduct(factor).cwiseMax(kLeastScale);
    const bool settled = (next - scales).cwiseQuotient(scales).cwiseAbs().maxCoeff() < 1e-3;
    if (settled && rejected == 0) break;
    if (pass + 1 < kPasses) scales = next;
  }

  report.newton_decrement = std::sqrt(std::max(0.0, linear.gradient.dot(inverse * linear.gradient)));
  if (!(report.newton_decrement < 1e-3)) {  // eq. 3
    return unanswerable(
        fmt::format("the joint solve did not converge: {:.2g} standard uncertainties are left to go after {} "
                    "iterations; capture the board in more, differently tilted poses",
                    report.newton_decrement, report.iterations));
  }
  report.scale_camera = scales[0];
  report.scale_projector = scales[1];
  const int reported = problem.reported();
  const auto names = problem.names();
  report.covariance.names.assign(names.begin(), names.begin() + reported);
  report.covariance.covariance = inverse.topLeftCorner(reported, reported);
  for (int i = 0; i < reported; ++i) {
    if (!(inverse(i, i) > 0.0))
      return unanswerable("the covariance of the calibration is not positive; capture more poses");
  }

  problem.build(Eigen::Vector2d(1, 1), 0);
  const auto stated = problem.linearise(false);
  problem.build(scales, 0);
  const auto final_residuals = problem.linearise(false);
  if (!stated || !final_residuals) return failed();
  double camera2 = 0, projector2 = 0;
  int n_camera = 0, n_projector = 0;
  for (std::size_t i = 0; i < stated->residuals.size(); ++i) {
    const Group g = problem.groups()[i];
    report.chi2 += std::pow(final_residuals->residuals[i], 2);
    if (g == Group::prior) continue;
    const Sight& s = bundle.sights[problem.owners()[i]];
    if (g == Group::camera) {
      camera2 += std::pow(stated->residuals[i] * s.u_pixel_px, 2);
      ++n_camera;
    } else {
      const auto& coordinate = bundle.projector->x && s.x ? s.x : s.y;
      projector2 += std::pow(stated->residuals[i] * coordinate->u, 2);
      ++n_projector;
    }
  }
  report.camera_rms_px = std::sqrt(camera2 / std::max(1, n_camera));
  report.projector_rms = std::sqrt(projector2 / std::max(1, n_projector));
  report.residuals = n_camera + n_projector;
  report.parameters = problem.free_parameters();
  report.dof = report.residuals + (problem.solves_along() ? 1 : 0) - report.parameters;
  return report;
}

}  // namespace fringecal::calib

// How much the parameters scatter from pose to pose, and how much they would if the model were true (bundle_system.h,
// eqs. 3 to 5).
#include "calib/bundle_system.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <cmath>

namespace fringecal::calib {

Result<BundleSystem::Parts> BundleSystem::parts_of(const Bundle& b) const {
  // A system of no sights has the priors (and the flats) only, one of a single pose's sights those and the pose's part.
  Bundle part = b;
  const int boards = poses_ - flats_;
  const auto with_pose = [&](int pose) {
    for (std::size_t i = 0; i < b.sights.size(); ++i)
      part.sights[i].used = b.sights[i].used && (b.sights[i].pose == pose || b.sights[i].pose >= boards);
    BundleSystem system(part, free_, components_, loss_scale_);
    system.linearise(part);
    return system;
  };
  const BundleSystem none = with_pose(-1);
  Parts out;
  out.all = none.shared_;
  for (int flat = boards; flat < poses_; ++flat) {
    const PoseBlock& block = none.blocks_[static_cast<std::size_t>(flat)];
    const Eigen::LLT<Eigen::MatrixXd> llt(block.a);
    if (block.a.rows() == 0) continue;
    if (llt.info() != Eigen::Success) return unanswerable(fmt::format("flat {} is not determined", flat - boards + 1));
    const Eigen::MatrixXd half = llt.matrixL().solve(block.w);
    out.all.noalias() -= half.transpose() * half;
  }
  for (int pose = 0; pose < boards; ++pose) {
    const BundleSystem one = with_pose(pose);
    const PoseBlock& block = one.blocks_[static_cast<std::size_t>(pose)];
    Eigen::MatrixXd i = one.shared_ - none.shared_;
    Eigen::VectorXd g = one.shared_g_ - none.shared_g_;
    if (block.a.rows() > 0) {
      const Eigen::LLT<Eigen::MatrixXd> llt(block.a);
      if (llt.info() != Eigen::Success) return unanswerable(fmt::format("pose {} is not determined", pose + 1));
      const Eigen::MatrixXd half = llt.matrixL().solve(block.w);
      i.noalias() -= half.transpose() * half;
      g.noalias() -= half.transpose() * llt.matrixL().solve(block.g);
    }
    out.all += i;
    out.information.push_back(std::move(i));
    out.gradient.push_back(std::move(g));
  }
  return out;
}

Result<PoseScatter> BundleSystem::pose_scatter(const Bundle& b, const Eigen::VectorXd& stated) const {
  const auto parts = parts_of(b);
  if (!parts) return tl::unexpected(parts.error());
  const auto n = static_cast<Eigen::Index>(parts->information.size());
  const auto poses = static_cast<double>(n);
  const Eigen::VectorXd unit = parts->all.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LLT<Eigen::MatrixXd> whole(unit.asDiagonal() * parts->all * unit.asDiagonal());
  if (whole.info() != Eigen::Success) return unanswerable("the poses do not determine the scanner");
  // Rows: the reported unknowns, in the unit in which eq. 4 is the sum of all squares.
  const Eigen::VectorXd row_unit =
      ((poses - 1) / (poses * static_cast<double>(stated.size())) * stated.cwiseInverse()).cwiseSqrt();
  Eigen::MatrixXd moves(stated.size(), n), d_sum = Eigen::MatrixXd::Zero(stated.size(), stated.size());
  Eigen::MatrixXd m_mean = Eigen::MatrixXd::Zero(stated.size(), unit.size());
  std::vector<Eigen::MatrixXd> d, m;
  for (Eigen::Index pose = 0; pose < n; ++pose) {
    const Eigen::MatrixXd& information = parts->information[static_cast<std::size_t>(pose)];
    const Eigen::MatrixXd rest = parts->all - information;
    const Eigen::VectorXd scale = rest.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> llt(scale.asDiagonal() * rest * scale.asDiagonal());
    if (llt.info() != Eigen::Success) {
      return unanswerable(fmt::format("without pose {} the other poses do not determine the scanner", pose + 1));
    }
    // R_j, its reported rows.
    Eigen::MatrixXd r = Eigen::MatrixXd::Identity(rest.rows(), stated.size());
    r = (scale.asDiagonal() * llt.solve(scale.asDiagonal() * r)).transpose().eval();
    r = (row_unit.asDiagonal() * r).eval();
    moves.col(pose) = r * parts->gradient[static_cast<std::size_t>(pose)];  // eq. 3
    const Eigen::MatrixXd r_i = r * information;
    d.push_back(r_i * r.transpose());
    d_sum += d.back();
    // R_j I_j L^-T with S = L L^T.
    m.push_back(whole.matrixL().solve(unit.asDiagonal() * r_i.transpose()).transpose());
    m_mean += m.back() / poses;
  }
  PoseScatter out;
  out.ratio = (moves.colwise() - Eigen::VectorXd(moves.rowwise().mean())).squaredNorm();  // eq. 4
  // The mean and the variance of that sum of squares, with the centring P = 1 - 1/n over the poses:
  // tr (P D P - P M M^T P) and tr of its square.
  Eigen::MatrixXd mm = Eigen::MatrixXd::Zero(unit.size(), unit.size());
  double squares = 0, mixed = 0;
  for (std::size_t j = 0; j < d.size(); ++j) {
    m[j] -= m_mean;
    mm.noalias() += m[j].transpose() * m[j];
    mixed += (d[j] * m[j]).cwiseProduct(m[j]).sum();
    squares += d[j].squaredNorm();
  }
  out.expected = (1 - 1 / poses) * d_sum.trace() - mm.trace();
  const double variance =
      (1 - 2 / poses) * squares + d_sum.squaredNorm() / (poses * poses) - 2 * mixed + mm.squaredNorm();
  if (!(out.expected > 0) || !(variance > 0)) return unanswerable("no pose has a part in what is found");
  out.ways = out.expected * out.expected / variance;
  return out;
}

}  // namespace fringecal::calib

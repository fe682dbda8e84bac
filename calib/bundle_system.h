// The normal equations of a Bundle, poses eliminated first.
//
// Unknowns are split into the shared ones s (lenses, relative pose, pitch, bow, printing errors) and those of each pose
// p_j (attitude, place, phase offset, bending), because a sight involves one pose only. With A_j, W_j, S0 the blocks of
// J^T J, and g = (g_s, g_j) the gradient,
//   S = S0 - sum_j W_j^T A_j^-1 W_j,   S ds = -(g_s - sum_j W_j^T A_j^-1 g_j),   dp_j = -A_j^-1 (g_j + W_j ds)     (1)
// [Brown1976, Triggs2000]. The same blocks give the covariance of everything that a sight involves,
//   C_ss = S^-1,  C_ps = -K C_ss,  C_pp = A_j^-1 + K C_ss K^T,  K = A_j^-1 W_j                                      (2)
// and with it the part of each reading that the solution has taken up, h = J_r C J_r^T (its leverage).
// Levenberg-Marquardt: A_j and S0 with (1 + lambda) on their diagonals. Robust: the loss log(1 + r^2 / c^2) c^2 enters
// as a weight 1 / (1 + r^2 / c^2) of its sight's rows.
#pragma once

#include "calib/bundle.h"
#include "calib/calibrate.h"
#include "core/result.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

namespace fringecal::calib {

/// Standard deviations of what scatters. A zero holds the quantity at its nominal value.
struct Components {
  double camera = 1, projector = 1;  // factors on the stated uncertainties of the readings of corners
  double flat = 1;                   // of those on flats
  double print_mm = 0;               // of each corner and coordinate, the same in all poses
  double relief_mm = 0;              // of each corner's height; only where print_mm is free too
  double bend_mm = 0;                // of each term of c_j (bundle.h, eq. 1), new in every pose
  double phase_offset = 0;           // of o_j, in the code's unit, new in every capture
  double pitch = 0;                  // relative, of the board
  double bow_mm = 0;                 // of each term of b
  double flat_bow_mm = 0;            // of each term of f (bundle.h, eq. 2)
  double along_mm = 0;               // the projector's place along the fringes where one axis only is coded
};

/// What is free.
struct FreeTerms {
  DistortionTerms camera = DistortionTerms::radial, projector = DistortionTerms::radial;
  bool camera_and_poses = true;  // false: held
};

/// Which group a reading belongs to.
enum class Group { camera, projector, flat };

/// A whitened reading at the linearisation.
struct Reading {
  std::size_t sight = 0;
  Group group = Group::camera;
  double residual = 0;  // in standard deviations
  double leverage = 0;  // h, where it was asked for
};

/// Sums of squares and redundancies of the scattering quantities, for their variance components.
struct Scatter {
  double squares = 0;     // sum of (value / standard deviation)^2
  double redundancy = 0;  // number - sum of posterior over prior variance
  int count = 0;
};

/// F of eq. 4, what it is on the mean if the model is true, and of how many degrees of freedom.
struct PoseScatter {
  double ratio = 0, expected = 1, ways = 1;
};

class BundleSystem {
 public:
  BundleSystem(const Bundle& bundle, const FreeTerms& free, const Components& components, double loss_scale = 0);

  /// Sum of the (robust) squares at the bundle; infinite where a point is not in front of a lens.
  double cost(const Bundle& bundle) const;
  /// Linearises at the bundle. False where a point is not in front of a lens.
  bool linearise(const Bundle& bundle);
  /// A change of all free unknowns: the shared ones, and each pose's.
  struct Direction {
    Eigen::VectorXd shared;
    std::vector<Eigen::VectorXd> pose;
  };
  /// The step of eq. 1 from the linearisation; no value where the system is not positive definite.
  std::optional<Direction> newton(double lambda) const;
  /// g . d at the linearisation: half of what the cost changes by along d.
  double slope(const Direction& d) const;
  /// What leads from one bundle to the other in the reported unknowns: the inverse of moved().
  Eigen::VectorXd difference(const Bundle& from, const Bundle& to) const;
  /// The bundle, changed by `length` times d.
  Bundle moved(const Bundle& bundle, const Direction& d, double length) const;

  /// Eq. 2 at the linearisation. No result: what the sights leave open, by its name.
  struct Posterior {
    Eigen::MatrixXd shared;  // C_ss, columns as names()
    std::vector<Reading> readings;
    Scatter print, relief, bend, phase_offset;
  };
  Result<Posterior> posterior(const Bundle& bundle) const;

  /// What leaving out one of n poses at a time would change (one Newton step each from the linearisation), the jackknife
  /// [Efron1982], which needs no model of how the readings of one pose err together. Views of a flat are few and unlike
  /// the others: they stay.
  ///   d_j = R_j g'_j,  R_j = (S - I_j)^-1,  I_j, g'_j the pose's own part of S and of the reduced gradient in eq. 1   (3)
  ///   F = mean over the K reported unknowns of (n - 1) / n sum_j (d_j - mean)_k^2 / C_kk                              (4)
  /// C_kk: `stated`. If the model is true, g' scatters with cov(g'_i, g'_j) = delta_ij I_j - I_i S^-1 I_j, so that all d_j
  /// at once have the covariance
  ///   V_ij = delta_ij R_j I_j R_j - M_i M_j^T,  M_j M_j^T = R_j I_j S^-1 I_j R_j                                      (5)
  /// from which F's expectation follows (more than 1 where poses have few others to replace them) and, with its variance,
  /// the degrees of freedom of the chi^2 that is nearest to it (metrology/compare_scanners.h, eq. 3).
  /// No result: a pose that nothing replaces.
  Result<PoseScatter> pose_scatter(const Bundle& bundle, const Eigen::VectorXd& stated) const;

  /// What the sights of a bundle say of the reported unknowns, those of its poses eliminated (S of eq. 1, without priors on
  /// shared unknowns). The system must not have other shared unknowns. No value: a pose that its sights leave open.
  std::optional<Eigen::MatrixXd> information(const Bundle& bundle);

  /// Names of the shared unknowns but the printing errors; reported() of them belong in the Scanner's covariance.
  const std::vector<std::string>& names() const { return names_; }
  int reported() const { return reported_; }
  /// Which of them is the projector's place along the fringes, held by a prior; -1: it is not among them.
  int along_column() const { return along_column_; }
  int lens_and_pose_unknowns() const;

 private:
  struct PoseBlock {
    Eigen::MatrixXd a, w;  // A_j, W_j
    Eigen::VectorXd g;
  };
  /// S, and what each pose of a board adds to it and to the gradient.
  struct Parts {
    Eigen::MatrixXd all;
    std::vector<Eigen::MatrixXd> information;
    std::vector<Eigen::VectorXd> gradient;
  };
  Result<Parts> parts_of(const Bundle& bundle) const;
  void add_names(const Bundle& bundle);
  void add_priors(const Bundle& bundle);
  double prior_cost(const Bundle& b) const;
  static void hold_in_its_plane(const Rigid3& cam_from_flat, Eigen::MatrixXd& a);
  Eigen::Index print_column(std::size_t target) const {
    return static_cast<Eigen::Index>(dense_.size()) + per_target_ * static_cast<Eigen::Index>(target);
  }

  FreeTerms free_;
  Components components_;
  double loss_scale_;
  int poses_ = 0, flats_ = 0, targets_ = 0;
  Eigen::Index per_target_ = 2;
  bool one_axis_ = false;
  int along_column_ = -1;          // of rows::, held by a prior; -1: none
  std::vector<int> dense_, pose_;  // the free columns of rows::
  std::vector<std::string> names_, pose_names_;
  int reported_ = 0;
  Eigen::MatrixXd shared_;
  Eigen::VectorXd shared_g_;
  std::vector<PoseBlock> blocks_;
};

}  // namespace fringecal::calib

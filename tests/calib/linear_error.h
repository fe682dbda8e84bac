// What errors of readings do to the parameters to first order: one Newton step from the truth. It is linear in the errors, its
// covariance can be stated and drawn cheaply, and it differs from the estimate's own error by curvature and by estimated components only.
//
// A truth that is one and the same in every repeat is not drawn from its prior, and the errors then scatter by less than their
// uncertainty C says: by the prior's share. With the prior's standard deviation s on parameter i,
//   V_kk = C_kk - C_ki^2 / s^2                                                                                  (1)
#pragma once

#include "calib/bundle_rows.h"
#include "calib/bundle_system.h"
#include "core/error.h"

namespace fringecal::test {

class LinearErrors {
 public:
  /// truth: a bundle at its true values, with sights whose readings are exact.
  LinearErrors(calib::Bundle truth, const calib::FreeTerms& free, const calib::Components& components)
      : truth_(std::move(truth)), system_(truth_, free, components) {
    truth_.print_mm.resize(truth_.targets_mm.size(), Eigen::Vector3d::Zero());
    truth_.bend_mm.resize(truth_.cam_from_board.size(), Eigen::Vector3d::Zero());
    truth_.phase_offset.resize(truth_.cam_from_board.size(), Eigen::Vector2d::Zero());
    calib::rows::set_slopes(truth_);
    require(system_.linearise(truth_), "the truth lies in front of the lenses");
    const auto posterior = system_.posterior(truth_);
    require(posterior.has_value(), "the sights determine every parameter");
    covariance_ = posterior->shared.topLeftCorner(system_.reported(), system_.reported());
    along_mm_ = components.along_mm;
  }
  const calib::Bundle& truth() const { return truth_; }
  const std::vector<std::string>& names() const { return system_.names(); }
  /// Standard deviations of the errors in repeats with one projector, whose place along the fringes has a prior (eq. 1).
  Eigen::VectorXd scatter() const {
    const auto at = covariance_.col(system_.along_column());
    return (covariance_.diagonal() - at.cwiseAbs2() / (along_mm_ * along_mm_)).cwiseSqrt();
  }
  /// Errors of the parameters in the order of names(), the projector's place along the fringes among them. read: the truth
  /// with other readings.
  Eigen::VectorXd of(const calib::Bundle& read) const {
    calib::BundleSystem system = system_;
    require(system.linearise(read), "the truth lies in front of the lenses");
    return system.newton(0.0).value().shared.head(covariance_.rows());
  }

 private:
  calib::Bundle truth_;
  calib::BundleSystem system_;
  Eigen::MatrixXd covariance_;
  double along_mm_ = 0;
};

}  // namespace fringecal::test

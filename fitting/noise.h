// How much the residuals of a fit say: errors that neighbouring pixels share, and form.
//
// The residuals r of n points on a grid of pixels come from errors e of the variance s^2 and the correlation rho(h) at the
// lag h, of which the fit took a part: r = (I - V V^T) e, the m columns v_k of V an orthonormal basis of the columns of its
// Jacobian J. A parameter p has the error g_p . e, g_p its row of (J^T J)^-1 J^T, and so the variance
//   u_p^2 = s^2 sum over lags of rho(h) A_p(h),   A_p(h) = sum of g_p,i g_p,i+h over the pairs at the lag h        (1)
// whatever the rim of the points, and however fast the row changes over the length of the correlation.
// rho follows from the sums of products over the n_h pairs at a lag, R(h) = sum r_i r_(i+h). Where the columns change
// little over that length, the covariance C of e has C v_k = S_k s^2 v_k, and the means are
//   E R(h) = s^2 (n_h rho(h) - sum_k S_k T_k(h)),   T_k(h) = sum of v_k,i v_k,i+h,   E R(0) = s^2 (n - sum_k S_k)  (2)
//   S_k = sum over lags of rho(h) T_k(h)                                                                          (3)
// (2) and (3) are iterated from S_k = 1. A fit that takes its s^2 as R(0) / (n - m) states u too small by
//   inflation_p = sqrt(sum rho(h) A_p(h) / A_p(0) * (n - m) / (n - sum_k S_k))                                    (4)
// S = mean S_k; the residuals are worth n_effective = n / S independent ones [Bartlett1946].
// The sums run over |h_x|, |h_y| <= L with the smallest L that is at least 2.2 sqrt(S / pi): there a Gaussian blur's
// rho, exp(-h^2 / (4 sigma^2)) with S = 4 pi sigma^2, is below 0.01; more lags would add scatter only.
// Whiteness: z = rho1 sqrt(number of pairs), rho1 over neighbours in a row and in a column; white noise has z ~ N(0, 1).
// Form: where no L below a quarter of the grid satisfies its condition, or the parameters took nearly all of the sums
// (sum T^2 / (m n_h) > 0.9, T = sum_k T_k), the residual is the surface's (or the instrument's) shape and not noise; then
// there is no number of independent points, and u is no uncertainty.
#pragma once

#include "core/result.h"

#include <Eigen/Core>

#include <cstddef>
#include <span>

namespace fringecal::fitting {

struct GridResidual {
  int x = 0, y = 0;  // pixel
  double d_mm = 0;
};

enum class ResidualKind { white, correlated, form };

struct ResidualNoise {
  ResidualKind kind = ResidualKind::white;
  double z = 0;            // of whiteness; white: |z| <= 4
  double n_effective = 0;  // n / S; form: 1
  /// Eq. 4, the factor on u of each parameter, at least 1. Form: of the largest L looked at, a lower bound.
  Eigen::VectorXd inflation;
  int reach_px = 0;  // L
};

/// jacobian: row i has the derivatives of residual i by the parameters of the fit (of a sphere by its centre and radius:
/// the outward normal and one, with the opposite sign or not). No result: fewer than 100 residuals, all of them zero, or
/// columns that do not differ.
Result<ResidualNoise> noise_of(std::span<const GridResidual> residuals, const Eigen::MatrixXd& jacobian);

}  // namespace fringecal::fitting

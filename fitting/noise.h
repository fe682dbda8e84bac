// How much the residuals of a fit say: errors that neighbouring pixels share, and form.
//
// Residuals d on a grid of pixels have, at the lag (h, v), the autocorrelation
//   rho(h, v) = mean of d(x, y) d(x + h, y + v) over the pairs that exist / mean of d^2                        (1)
// The mean of n such values has the variance s^2 S / n with S = sum of rho over all lags, so they are worth
//   n_effective = n / S                                                                                        (2)
// independent ones [Bartlett1946], and so are they for every parameter whose row of the Jacobian hardly changes over the
// length of the correlation: u becomes u sqrt(S). The sum runs over |h|, |v| <= L with the smallest L that is at least
// 2.2 sqrt(S / pi): there a Gaussian blur's rho, exp(-r^2 / (4 sigma^2)) with S = 4 pi sigma^2, is below 0.01; more lags
// would add scatter only (and the sum over all of them is zero for residuals, whatever the noise).
// The m parameters took their share of each rho, m S / n; it is given back:
//   S = S_L / (1 - (2 L + 1)^2 m / n)                                                                          (3)
// Where the grid is only some 50 correlation lengths wide, u comes out too large (by 11 to 17 % for a blur of 1.5 px on 70).
// Whiteness: z = rho1 sqrt(number of pairs), rho1 over neighbours in a row and in a column; white noise has z ~ N(0, 1).
// Form: where no L below a quarter of the grid satisfies its condition, the residual is the surface's (or the
// instrument's) shape and not noise; then there is no number of independent points, and u is no uncertainty.
#pragma once

#include "core/result.h"

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
  double n_effective = 0;  // eq. 2; form: 1
  double inflation =
      1;             // sqrt(S): the factor on u of a fit; at least 1. Form: of the largest L looked at, a lower bound
  int reach_px = 0;  // L
};

/// parameters: how many the fit had. No result: fewer than 100 residuals, or all of them zero.
Result<ResidualNoise> noise_of(std::span<const GridResidual> residuals, int parameters);

}  // namespace fringecal::fitting

// Linear Chebyshev approximation: minimise t subject to |d_i + J_i x| <= t for all i. Exact for the rows used: CGAL's
// linear programme solver over rational numbers, rounded once at the end.
#pragma once

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace fringecal::fitting {

struct ChebyshevSolution {
  Eigen::VectorXd x;
  double t = 0;
};

/// Rows of J and d for the constraints; some tens of rows, up to five columns.
ChebyshevSolution chebyshev(const Eigen::MatrixXd& J, const Eigen::VectorXd& d);

/// The largest c . x that |d_i + J_i x| <= t leaves, or nullopt where there is no bound.
std::optional<double> farthest(const Eigen::MatrixXd& J, const Eigen::VectorXd& d, double t, const Eigen::VectorXd& c);

}  // namespace fringecal::fitting

#include "fitting/chebyshev.h"

#include "core/error.h"

#include <CGAL/Gmpzf.h>
#include <CGAL/QP_functions.h>
#include <CGAL/QP_models.h>

namespace fringecal::fitting {
namespace {

using Program = CGAL::Quadratic_program<double>;
using Exact = CGAL::Gmpzf;

/// Rows J x - s t <= -d and -J x - s t <= d; s one where t is a variable (the last column), else its value is given.
Program constraints(const Eigen::MatrixXd& J, const Eigen::VectorXd& d, std::optional<double> t) {
  Program program(CGAL::SMALLER, false, 0.0, false, 0.0);
  const int m = static_cast<int>(J.cols());
  int row = 0;
  for (Eigen::Index i = 0; i < J.rows(); ++i) {
    for (const double sign : {1.0, -1.0}) {
      for (int c = 0; c < m; ++c) program.set_a(c, row, sign * J(i, c));
      if (!t) program.set_a(m, row, -1.0);
      program.set_b(row++, t.value_or(0.0) - sign * d[i]);
    }
  }
  return program;
}

}  // namespace

ChebyshevSolution chebyshev(const Eigen::MatrixXd& J, const Eigen::VectorXd& d) {
  Program program = constraints(J, d, std::nullopt);
  const int m = static_cast<int>(J.cols());
  program.set_l(m, true, 0.0);
  program.set_c(m, 1.0);
  const auto solution = CGAL::solve_linear_program(program, Exact());
  require(solution.is_optimal(), "a Chebyshev approximation has an optimum");
  ChebyshevSolution out{Eigen::VectorXd(m), 0.0};
  auto value = solution.variable_values_begin();
  for (int c = 0; c < m; ++c) out.x[c] = CGAL::to_double(*value++);
  out.t = CGAL::to_double(*value);
  return out;
}

std::optional<double> farthest(const Eigen::MatrixXd& J, const Eigen::VectorXd& d, double t, const Eigen::VectorXd& c) {
  Program program = constraints(J, d, t);
  for (Eigen::Index i = 0; i < c.size(); ++i) program.set_c(static_cast<int>(i), -c[i]);
  const auto solution = CGAL::solve_linear_program(program, Exact());
  if (!solution.is_optimal()) return std::nullopt;
  return -CGAL::to_double(solution.objective_value());
}

}  // namespace fringecal::fitting

#include "fitting/noise.h"

#include "core/error.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace fringecal::fitting {
namespace {

/// Values over the pixels of the residuals, zero where there is none.
using Layer = std::vector<double>;

class Grid {
 public:
  explicit Grid(std::span<const GridResidual> residuals) : residuals_(residuals) {
    int right = residuals[0].x, bottom = residuals[0].y;
    left_ = right;
    top_ = bottom;
    for (const GridResidual& r : residuals) {
      left_ = std::min(left_, r.x);
      right = std::max(right, r.x);
      top_ = std::min(top_, r.y);
      bottom = std::max(bottom, r.y);
    }
    width_ = right - left_ + 1;
    height_ = bottom - top_ + 1;
  }
  int shorter_side() const { return std::min(width_, height_); }

  /// value_of(i): of residual i.
  template <class Value>
  Layer layer(const Value& value_of) const {
    Layer out(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), 0.0);
    for (std::size_t i = 0; i < residuals_.size(); ++i)
      out[offset(residuals_[i].y - top_) + static_cast<std::size_t>(residuals_[i].x - left_)] = value_of(i);
    return out;
  }
  /// Sum of f f' over the pairs at the lag (h, v), v >= 0.
  double lag(const Layer& f, int h, int v) const {
    const int first = std::max(0, -h), count = std::min(width_, width_ - h) - first;
    if (count <= 0) return 0.0;
    double out = 0;
    for (int y = 0; y + v < height_; ++y) {
      const Eigen::Map<const Eigen::VectorXd> a(f.data() + offset(y) + first, count);
      const Eigen::Map<const Eigen::VectorXd> b(f.data() + offset(y + v) + first + h, count);
      out += a.dot(b);
    }
    return out;
  }

 private:
  std::size_t offset(int y) const { return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_); }
  std::span<const GridResidual> residuals_;
  int left_ = 0, top_ = 0, width_ = 0, height_ = 0;
};

/// The sums at the lags looked at so far; a column per lag, which stands for the opposite lag too.
struct Lags {
  std::vector<double> q, n, times;  // R(h) / R(0); n_h; two, one for the lag zero
  std::vector<Eigen::VectorXd> T, A;
  double taken(double m) const {  // sum T^2 / (m n_h)
    double sum = 0;
    for (std::size_t i = 0; i < q.size(); ++i) sum += times[i] * T[i].sum() * T[i].sum() / (m * n[i]);
    return sum;
  }
};

/// Eqs. 2, 3.
struct Correlations {
  Eigen::VectorXd S;
  std::vector<double> rho;
};
Correlations correlations_of(const Lags& lags, double n) {
  constexpr int kIterations = 200;
  Correlations out{Eigen::VectorXd::Ones(lags.T[0].size()), std::vector<double>(lags.q.size())};
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::VectorXd next = Eigen::VectorXd::Zero(out.S.size());
    for (std::size_t i = 0; i < lags.q.size(); ++i) {
      out.rho[i] = (lags.q[i] * (n - out.S.sum()) + out.S.dot(lags.T[i])) / lags.n[i];
      next += lags.times[i] * out.rho[i] * lags.T[i];
    }
    const double change = (next - out.S).cwiseAbs().maxCoeff();
    out.S = next;
    if (!(change > 1e-9 * next.cwiseAbs().maxCoeff())) break;
  }
  return out;
}

}  // namespace

Result<ResidualNoise> noise_of(std::span<const GridResidual> residuals, const Eigen::MatrixXd& jacobian) {
  constexpr std::size_t kFewest = 100;
  constexpr double kWhite = 4.0, kTaken = 0.9;
  require(static_cast<std::size_t>(jacobian.rows()) == residuals.size(), "noise_of() is given a row for each residual");
  if (residuals.size() < kFewest) {
    return unanswerable(
        fmt::format("an autocorrelation needs {} residuals and there are {}", kFewest, residuals.size()));
  }
  const Grid grid(residuals);
  const Layer d = grid.layer([&](std::size_t i) { return residuals[i].d_mm; });
  const Layer is = grid.layer([](std::size_t) { return 1.0; });
  const double n = static_cast<double>(residuals.size()), m = static_cast<double>(jacobian.cols());
  const double R0 = grid.lag(d, 0, 0);
  if (!(R0 > 0.0)) return unanswerable("all residuals are zero, so they have no correlation");
  ResidualNoise out;
  const double pairs = grid.lag(is, 1, 0) + grid.lag(is, 0, 1);
  out.z = pairs > 0 ? (grid.lag(d, 1, 0) + grid.lag(d, 0, 1)) / pairs / (R0 / n) * std::sqrt(pairs) : 0.0;
  out.n_effective = n;
  out.inflation = Eigen::VectorXd::Ones(jacobian.cols());
  if (std::abs(out.z) <= kWhite) return out;
  out.kind = ResidualKind::correlated;

  // J = V L^T, g = V L^-1 (a column per parameter)
  const Eigen::LLT<Eigen::MatrixXd> factors(jacobian.transpose() * jacobian);
  if (factors.info() != Eigen::Success || !(factors.rcond() > 1e-14))
    return unanswerable("the points do not tell the parameters of the fit apart, so its residuals say nothing");
  const Eigen::MatrixXd V = factors.matrixL().solve(jacobian.transpose()).transpose();
  const Eigen::MatrixXd g = factors.solve(jacobian.transpose()).transpose();
  std::vector<Layer> v_layers, g_layers;
  for (Eigen::Index k = 0; k < jacobian.cols(); ++k) {
    v_layers.push_back(grid.layer([&](std::size_t i) { return V(static_cast<Eigen::Index>(i), k); }));
    g_layers.push_back(grid.layer([&](std::size_t i) { return g(static_cast<Eigen::Index>(i), k); }));
  }
  Lags lags;
  const auto add = [&](int h, int v) {
    const double n_h = grid.lag(is, h, v);
    if (!(n_h > 0.0)) return;
    lags.q.push_back(grid.lag(d, h, v) / R0);
    lags.n.push_back(n_h);
    lags.times.push_back(h == 0 && v == 0 ? 1.0 : 2.0);
    lags.T.emplace_back(jacobian.cols());
    lags.A.emplace_back(jacobian.cols());
    for (Eigen::Index k = 0; k < jacobian.cols(); ++k) {
      lags.T.back()[k] = grid.lag(v_layers[static_cast<std::size_t>(k)], h, v);
      lags.A.back()[k] = grid.lag(g_layers[static_cast<std::size_t>(k)], h, v);
    }
  };
  add(0, 0);
  const int most = std::max(1, grid.shorter_side() / 4);
  for (int L = 1; L <= most; ++L) {
    for (int v = 1; v < L; ++v) {
      add(L, v);
      add(-L, v);
    }
    add(L, 0);
    for (int h = -L; h <= L; ++h) add(h, L);
    if (!(lags.taken(m) < kTaken)) break;
    const Correlations found = correlations_of(lags, n);
    const double S = std::max(1.0, found.S.mean()), left = n - found.S.sum();
    if (!(left > (1.0 - kTaken) * n)) break;
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(jacobian.cols());
    for (std::size_t i = 0; i < lags.q.size(); ++i) squares += lags.times[i] * found.rho[i] * lags.A[i];
    out.inflation = (squares.cwiseQuotient(lags.A[0]) * ((n - m) / left)).cwiseMax(1.0).cwiseSqrt();  // eq. 4
    out.reach_px = L;
    out.n_effective = n / S;
    if (L >= 2.2 * std::sqrt(S / std::numbers::pi)) return out;
  }
  out.kind = ResidualKind::form;
  out.n_effective = 1.0;
  return out;
}

}  // namespace fringecal::fitting

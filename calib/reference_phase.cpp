#include "calib/reference_phase.h"

#include "core/statistics.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

constexpr int kReach = 3;  // px: five standard deviations of a blur of 0.6 px
constexpr double kEven = 0.8;
constexpr int kDegree = 7, kTerms = (kDegree + 1) * (kDegree + 2) / 2;
constexpr int kTile = 24;  // px, about a period of the default grating
constexpr int kMostInTile = kTile * kTile;
constexpr std::size_t kNeeded = 3 * kTerms;  // tiles

/// Pixels with a phase whose surroundings are of one brightness.
Image<std::uint8_t> undisturbed(const decode::PhaseMap& map) {
  Image<std::uint8_t> out(map.width(), map.height());
  for (int y = kReach; y < map.height() - kReach; ++y) {
    for (int x = kReach; x < map.width() - kReach; ++x) {
      if (!map.valid(x, y)) continue;
      float low = map.mean(x, y), high = low;
      for (int dy = -kReach; dy <= kReach; ++dy) {
        for (int dx = -kReach; dx <= kReach; ++dx) {
          low = std::min(low, map.mean(x + dx, y + dy));
          high = std::max(high, map.mean(x + dx, y + dy));
        }
      }
      out(x, y) = low >= kEven * high;
    }
  }
  return out;
}

struct Tile {
  double weight = 0, phase = 0;  // sum of weights; mean phase
  Eigen::VectorXd row;           // mean of the terms
};

}  // namespace

Eigen::VectorXd ReferencePhase::row(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d e = (pixel - middle_).cwiseQuotient(half_);
  double t[2][kDegree + 1];
  for (int a = 0; a < 2; ++a) {
    t[a][0] = 1;
    t[a][1] = e[a];
    for (int i = 2; i <= kDegree; ++i) t[a][i] = 2 * e[a] * t[a][i - 1] - t[a][i - 2];
  }
  Eigen::VectorXd out(kTerms);
  Eigen::Index k = 0;
  for (int i = 0; i <= kDegree; ++i) {
    for (int j = 0; i + j <= kDegree; ++j) out[k++] = t[0][i] * t[1][j];
  }
  return out;
}

bool ReferencePhase::covers(const Eigen::Vector2d& pixel) const {
  return (pixel - middle_).cwiseQuotient(half_).cwiseAbs().maxCoeff() <= 1.0 && error_rad(pixel).norm() <= widest_rad_;
}

Result<ReferencePhase> ReferencePhase::fit(const decode::PhaseMap& map) {
  const Image<std::uint8_t> good = undisturbed(map);
  Eigen::Vector2d low(map.width(), map.height()), high(0, 0);
  for (int y = 0; y < map.height(); ++y) {
    for (int x = 0; x < map.width(); ++x) {
      if (!good(x, y)) continue;
      low = low.cwiseMin(Eigen::Vector2d(x, y));
      high = high.cwiseMax(Eigen::Vector2d(x, y));
    }
  }
  ReferencePhase out;
  out.middle_ = 0.5 * (low + high);
  out.half_ = (0.5 * (high - low)).cwiseMax(1.0);
  std::vector<Tile> tiles;
  for (int y0 = 0; y0 < map.height(); y0 += kTile) {
    for (int x0 = 0; x0 < map.width(); x0 += kTile) {
      Tile tile{.row = Eigen::VectorXd::Zero(kTerms)};
      int n = 0;
      for (int y = y0; y < std::min(y0 + kTile, map.height()); ++y) {
        for (int x = x0; x < std::min(x0 + kTile, map.width()); ++x) {
          if (!good(x, y)) continue;
          const double w = 1.0 / std::pow(static_cast<double>(map.u_phase_rad(x, y)), 2);
          tile.weight += w;
          tile.phase += w * map.phase_rad(x, y);
          tile.row += w * out.row({x, y});
          ++n;
        }
      }
      if (n < kMostInTile / 8) continue;
      tile.phase /= tile.weight;
      tile.row /= tile.weight;
      tiles.push_back(std::move(tile));
    }
  }
  const auto too_few = [](std::size_t n) {
    return unanswerable(
        fmt::format("the reference capture shows {} of the {} patches of even brightness that its phase map needs; "
                    "light the board fully, and use one with larger squares or nearer to the camera",
                    n, kNeeded));
  };
  if (tiles.size() < kNeeded) return too_few(tiles.size());
  constexpr int kPasses = 4;
  for (int pass = 0; pass < kPasses; ++pass) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(kTerms, kTerms);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(kTerms);
    for (const Tile& t : tiles) {
      normal += t.weight * t.row * t.row.transpose();
      right += t.weight * t.phase * t.row;
    }
    const Eigen::VectorXd unit = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> llt(unit.asDiagonal() * normal * unit.asDiagonal());
    if (llt.info() != Eigen::Success || !(llt.matrixLLT().diagonal().minCoeff() > 1e-5)) return too_few(tiles.size());
    out.c_ = unit.asDiagonal() * llt.solve(unit.asDiagonal() * right);
    std::vector<double> sizes;
    double squares = 0;
    for (const Tile& t : tiles) {
      const double r2 = t.weight * std::pow(t.phase - t.row.dot(out.c_), 2);
      squares += r2;
      sizes.push_back(std::sqrt(r2));
    }
    // Eq. 2: with U = diag(unit) and L of the scaled system, C = s^2 U L^-T L^-1 U.
    const double s = std::sqrt(squares / static_cast<double>(tiles.size() - kTerms));
    out.root_ =
        s * (unit.asDiagonal() * Eigen::MatrixXd(llt.matrixU().solve(Eigen::MatrixXd::Identity(kTerms, kTerms))));
    const double limit = 5 * 1.4826 * median(sizes);
    std::vector<Tile> kept;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (sizes[i] <= limit) kept.push_back(tiles[i]);
    }
    if (kept.size() == tiles.size()) break;
    tiles = std::move(kept);
    if (tiles.size() < kNeeded) return too_few(tiles.size());
  }
  for (const Tile& t : tiles) out.widest_rad_ = std::max(out.widest_rad_, (out.root_.transpose() * t.row).norm());
  return out;
}

}  // namespace fringecal::calib

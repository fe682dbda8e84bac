#include "hw/virtual/printed_board.h"

#include "hw/virtual/random.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace fringecal::virt {
namespace {

bool is_chessboard(const model::Board& b) { return b.kind == model::BoardKind::chessboard; }

double row_shift(const model::Board& b, int row) {
  return b.kind == model::BoardKind::asymmetric_circles && (row & 1) != 0 ? 0.5 : 0.0;
}

}  // namespace

PrintedBoard::PrintedBoard(const PatternBoard& shape, const Preset& preset, std::uint64_t instrument_seed)
    : board_(shape.board) {
  const double scale = 1.0 + shape.pitch_error_relative;
  pitch_mm_ = scale * Eigen::Vector2d(board_.pitch_x_mm, board_.pitch_y_mm);
  const double last_column = board_.columns - 1 + row_shift(board_, 1);
  middle_ = 0.5 * Eigen::Vector2d(last_column, board_.rows - 1);
  const double outside = is_chessboard(board_) ? 1.0 + preset.boards.white_margin_pitches : 1.0;
  half_size_mm_ = (middle_ + Eigen::Vector2d::Constant(outside)).cwiseProduct(pitch_mm_);
  bow_per_mm2_ = shape.bow_mm / middle_.cwiseProduct(pitch_mm_).squaredNorm();
  black_ = preset.boards.black_albedo;
  dot_radius_ = 0.5 * preset.boards.dot_diameter_pitches;
  Stream random(instrument_seed,
                fmt::format("printing {} {} {}", static_cast<int>(board_.kind), board_.columns, board_.rows));
  for (int k = 0; k < board_.corners(); ++k) {
    const double x = random.normal(), y = random.normal();
    errors_mm_.push_back(shape.u_print_mm * Eigen::Vector2d(x, y));
  }
}

Eigen::Vector2d PrintedBoard::error_mm(const Eigen::Vector2d& g) const {
  const double x = std::clamp(g.x(), 0.0, board_.columns - 1.0), y = std::clamp(g.y(), 0.0, board_.rows - 1.0);
  const int i = std::min(static_cast<int>(x), board_.columns - 2), j = std::min(static_cast<int>(y), board_.rows - 2);
  const double a = x - i, b = y - j;
  const auto* e = errors_mm_.data() + j * board_.columns + i;
  return (1 - b) * ((1 - a) * e[0] + a * e[1]) + b * ((1 - a) * e[board_.columns] + a * e[board_.columns + 1]);
}

Eigen::Vector2d PrintedBoard::grid(const Eigen::Vector2d& place_mm) const {
  Eigen::Vector2d g = place_mm.cwiseQuotient(pitch_mm_) + middle_;
  for (int step = 0; step < 2; ++step) g = (place_mm - error_mm(g)).cwiseQuotient(pitch_mm_) + middle_;  // eq. 1
  return g;
}

Eigen::Vector3d PrintedBoard::corner_mm(int column, int row) const {
  const double shift = row_shift(board_, row);
  const Eigen::Vector2d g(column + shift, row);
  // An asymmetric grid's error is interpolated at the shifted place, as albedo_at() and grid() see it.
  const Eigen::Vector2d p = pitch_mm_.cwiseProduct(g - middle_) + error_mm(g);
  return {p.x(), p.y(), bow_per_mm2_ * p.squaredNorm()};
}

double PrintedBoard::albedo_at(const Eigen::Vector2d& g) const {
  if (is_chessboard(board_)) {
    const int i = static_cast<int>(std::floor(g.x())), j = static_cast<int>(std::floor(g.y()));
    if (i < -1 || j < -1 || i > board_.columns - 1 || j > board_.rows - 1) return 1.0;
    return ((i + j) & 1) == 0 ? black_ : 1.0;
  }
  const int j = static_cast<int>(std::lround(g.y()));
  if (j < 0 || j >= board_.rows) return 1.0;
  const double shift = row_shift(board_, j);
  const int i = static_cast<int>(std::lround(g.x() - shift));
  if (i < 0 || i >= board_.columns) return 1.0;
  const Eigen::Vector2d off = (g - Eigen::Vector2d(i + shift, j)).cwiseProduct(pitch_mm_) / pitch_mm_.x();
  return off.squaredNorm() < dot_radius_ * dot_radius_ ? black_ : 1.0;
}

bool PrintedBoard::near_edge(const Eigen::Vector2d& place_mm, double reach_mm) const {
  const Eigen::Vector2d g = grid(place_mm);
  const Eigen::Vector2d reach = Eigen::Vector2d::Constant(reach_mm).cwiseQuotient(pitch_mm_);
  if (is_chessboard(board_)) {
    const Eigen::Vector2d off(g.x() - std::round(g.x()), g.y() - std::round(g.y()));
    const bool inside = g.x() > -1 - reach.x() && g.y() > -1 - reach.y() && g.x() < board_.columns + reach.x() &&
                        g.y() < board_.rows + reach.y();
    return inside && (std::abs(off.x()) < reach.x() || std::abs(off.y()) < reach.y());
  }
  const double j = std::clamp(std::round(g.y()), 0.0, board_.rows - 1.0);
  const double shift = row_shift(board_, static_cast<int>(j));
  const double i = std::clamp(std::round(g.x() - shift), 0.0, board_.columns - 1.0) + shift;
  const double distance = (g - Eigen::Vector2d(i, j)).cwiseProduct(pitch_mm_).norm();
  return std::abs(distance - dot_radius_ * pitch_mm_.x()) < reach_mm;
}

PrintedBoard::Seen PrintedBoard::seen(const Eigen::Vector2d& place_mm, const Eigen::Vector2d& dx,
                                      const Eigen::Vector2d& dy, const PointSpread& spread) const {
  const Eigen::Vector2d g0 = grid(place_mm), gx = grid(place_mm + dx) - g0, gy = grid(place_mm + dy) - g0;
  const auto samples = spread.samples(PointSpread::kFine);
  double sum = 0;
  Eigen::Vector2d first = Eigen::Vector2d::Zero();
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& s : samples) {
    const double albedo = albedo_at(g0 + s.x() * gx + s.y() * gy);
    sum += albedo;
    first += albedo * s;
    second += albedo * s * s.transpose();
  }
  if (!(sum > 0)) return {0.0, Eigen::Vector2d::Zero(), Eigen::Matrix2d::Zero()};
  first /= sum;
  return {sum / static_cast<double>(samples.size()), first, second / sum - first * first.transpose()};
}

}  // namespace fringecal::virt

#include "metrology/residual_whiteness.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <map>

namespace fringecal::metrology {
namespace {

constexpr int kCells = 8;  // of the image, along each side

struct Mean {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
};

/// Pose, cell of the image, corner of the board.
std::array<int, 3> groups_of(const CornerResidual& r, const model::Scanner& s) {
  const auto cell = [](double at, int size) {
    return std::min(kCells - 1, std::max(0, static_cast<int>(kCells * at / size)));
  };
  return {r.pose, cell(r.pixel_px.y(), s.camera.height_px) * kCells + cell(r.pixel_px.x(), s.camera.width_px),
          r.row * s.board->columns + r.column};
}

}  // namespace

std::vector<CornerResidual> corner_residuals(const model::Scanner& s) {
  std::vector<CornerResidual> out;
  for (std::size_t pose = 0; pose < s.observations.size(); ++pose) {
    for (const auto& c : s.observations[pose].corners) {
      if (!c.used) continue;
      const auto seen = s.camera.project(s.cam_from_board[pose] * s.corner_mm(c.column, c.row));
      if (seen) out.push_back({static_cast<int>(pose), c.column, c.row, c.pixel, c.pixel - *seen});
    }
  }
  return out;
}

Result<std::vector<Whiteness>> residual_whiteness(const model::Scanner& s) {
  if (!s.board) return unanswerable(fmt::format("the Scanner '{}' does not know its board", s.name));
  const auto residuals = corner_residuals(s);
  if (residuals.size() < 50) {
    return unanswerable(
        fmt::format("{} corners are too few to judge their residuals; 50 are needed", residuals.size()));
  }
  double squares = 0;
  for (const auto& r : residuals) squares += r.residual_px.squaredNorm();
  const double n = static_cast<double>(residuals.size()), variance = squares / (2.0 * n);
  if (!(variance > 0)) return unanswerable("the residuals are all zero");
  std::vector<Whiteness> out;
  const char* const names[] = {"pose", "image", "board"};
  for (std::size_t k = 0; k < 3; ++k) {
    std::map<int, Mean> groups;
    for (const auto& r : residuals) {
      auto& g = groups[groups_of(r, s)[k]];
      g.sum += r.residual_px;
      ++g.count;
    }
    Whiteness w;
    w.over = names[k];
    w.groups = static_cast<int>(groups.size());
    for (const auto& [at, g] : groups) w.q += g.sum.squaredNorm() / g.count / (2.0 * variance * w.groups);  // eq. 1
    w.limit = 1.0 + 4.0 / std::sqrt(static_cast<double>(w.groups));
    if (!w.white()) w.common_px = std::sqrt((w.q - 1.0) * 2.0 * variance * w.groups / n);
    out.push_back(w);
  }
  return out;
}

std::string words_of(const Whiteness& w) {
  if (w.white()) {
    return fmt::format("residuals over the {}: noise (q = {:.2f} of {} groups, at most {:.2f} by chance)", w.over, w.q,
                       w.groups, w.limit);
  }
  return fmt::format(
      "residuals over the {}: not noise, {:.3f} px in common (q = {:.2f} of {} groups, at most {:.2f} by chance): the "
      "model lacks something there",
      w.over, w.common_px, w.q, w.groups, w.limit);
}

}  // namespace fringecal::metrology

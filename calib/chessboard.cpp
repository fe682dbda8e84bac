#include "calib/board_corners.h"

#include <ceres/tiny_solver.h>
#include <ceres/tiny_solver_autodiff_function.h>
#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

// The detector's time grows with the area; beyond this width it looks at a smaller copy, and the refinement works on
// the picture itself.
constexpr int kDetectionWidth = 2000;

/// 8 bit by the 0.1 and 99.9 percentiles.
cv::Mat to_8bit(const Image<float>& image) {
  std::vector<float> sorted = image.values();
  const auto at = [&](double share) {
    const auto n = static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + n, sorted.end());
    return sorted[static_cast<std::size_t>(n)];
  };
  const float low = at(0.001), high = std::max(at(0.999), low + 1e-6F);
  const cv::Mat view(image.height(), image.width(), CV_32F, const_cast<float*>(image.data()));
  cv::Mat out;
  view.convertTo(out, CV_8U, 255.0 / (high - low), -255.0 * low / (high - low));
  return out;
}

/// Eq. 1 on the window around a start; unknowns: c, the two directions, ln s, a, m, g.
struct Saddle {
  const Image<float>* image;
  int x0, y0, half;
  double level, contrast;  // scale of the grey values, so that all unknowns are of order one

  int NumResiduals() const { return (2 * half + 1) * (2 * half + 1); }

  template <class T>
  bool operator()(const T* p, T* residual) const {
    using std::cos;
    using std::exp;
    using std::sin;
    using std::tanh;
    const T sharpness = exp(-p[4]);
    const T n1x = -sin(p[2]), n1y = cos(p[2]), n2x = -sin(p[3]), n2y = cos(p[3]);
    int k = 0;
    for (int dy = -half; dy <= half; ++dy) {
      for (int dx = -half; dx <= half; ++dx) {
        const T x = T(double(dx)) - p[0], y = T(double(dy)) - p[1];
        const T product = tanh((n1x * x + n1y * y) * sharpness) * tanh((n2x * x + n2y * y) * sharpness);
        const double value = ((*image)(x0 + dx, y0 + dy) - level) / contrast;
        residual[k++] =
            p[5] * product + p[6] + (p[7] * T(double(dx)) + p[8] * T(double(dy))) / T(double(half)) - T(value);
      }
    }
    return true;
  }
};

struct Neighbours {
  Eigen::Vector2d along_row, along_column;  // to the next corner
};

/// The refined corner; the start where the fit leaves the window (a reflection, a neighbour's edge).
Eigen::Vector2d refine(const Image<float>& image, const Eigen::Vector2d& start, const Neighbours& to) {
  const double spacing = std::min(to.along_row.norm(), to.along_column.norm());
  // 0.35 of a square: the next edges, one square away, stay out by more than their blur.
  const int half = std::clamp(static_cast<int>(0.35 * spacing), 3, 15);
  const int x0 = static_cast<int>(std::lround(start.x())), y0 = static_cast<int>(std::lround(start.y()));
  if (x0 - half < 0 || y0 - half < 0 || x0 + half >= image.width() || y0 + half >= image.height()) return start;
  double sum = 0, low = image(x0, y0), high = low;
  for (int y = y0 - half; y <= y0 + half; ++y) {
    for (int x = x0 - half; x <= x0 + half; ++x) {
      const double v = image(x, y);
      sum += v;
      low = std::min(low, v);
      high = std::max(high, v);
    }
  }
  if (!(high > low)) return start;
  const Saddle saddle{&image, x0, y0, half, sum / ((2 * half + 1) * (2 * half + 1)), 0.5 * (high - low)};

  struct Function : Saddle {
    explicit Function(const Saddle& s) : Saddle(s) {}
  } function(saddle);
  using Auto = ceres::TinySolverAutoDiffFunction<Function, Eigen::Dynamic, 9>;
  Auto auto_function(function);
  std::optional<Eigen::Vector2d> best;
  double best_cost = 0;
  // The sign of a is not known: both starts, the better end.
  for (const double sign : {1.0, -1.0}) {
    ceres::TinySolver<Auto> solver;
    solver.options.max_num_iterations = 40;
    Eigen::Matrix<double, 9, 1> p;
    p << start.x() - x0, start.y() - y0, std::atan2(to.along_row.y(), to.along_row.x()),
        std::atan2(to.along_column.y(), to.along_column.x()), 0.0, 0.8 * sign, 0.0, 0.0, 0.0;
    solver.Solve(auto_function, &p);
    const double cost = solver.summary.final_cost;
    if (!p.allFinite() || !std::isfinite(cost)) continue;
    const Eigen::Vector2d place(x0 + p[0], y0 + p[1]);
    if ((place - start).norm() > 0.5 * half) continue;
    if (!best || cost < best_cost) {
      best = place;
      best_cost = cost;
    }
  }
  return best.value_or(start);
}

}  // namespace

Result<std::vector<Eigen::Vector2d>> find_chessboard(const Image<float>& image, const model::Board& board) {
  const cv::Size pattern(board.columns, board.rows);
  cv::Mat picture = to_8bit(image);
  double shrink = 1.0;
  if (picture.cols > kDetectionWidth) {
    shrink = static_cast<double>(kDetectionWidth) / picture.cols;
    cv::resize(picture, picture, cv::Size(), shrink, shrink, cv::INTER_AREA);
  }
  std::vector<cv::Point2f> corners;
  bool found = false;
  try {
    found = cv::findChessboardCorners(
        picture, pattern, corners,
        cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_FAST_CHECK);
    if (!found) {
      found = cv::findChessboardCornersSB(
          picture, pattern, corners, cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY);
    }
  } catch (const cv::Exception&) {
    found = false;
  }
  if (!found || static_cast<int>(corners.size()) != board.corners()) {
    return unanswerable(
        fmt::format("no chessboard of {} x {} inner corners is seen whole; check columns and rows of the "
                    "board file, the light and the focus",
                    board.columns, board.rows));
  }
  std::vector<Eigen::Vector2d> places;
  // Pixel (0, 0) is a centre in both: a centre x of the small copy lies at (x + 0.5) / shrink - 0.5.
  for (const auto& c : corners) places.emplace_back((c.x + 0.5) / shrink - 0.5, (c.y + 0.5) / shrink - 0.5);
  const std::vector<Eigen::Vector2d> start = places;
  const auto at = [&](int column, int row) { return start[static_cast<std::size_t>(row * board.columns + column)]; };
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const int c0 = std::max(0, column - 1), c1 = std::min(board.columns - 1, column + 1);
      const int r0 = std::max(0, row - 1), r1 = std::min(board.rows - 1, row + 1);
      const Neighbours to{(at(c1, row) - at(c0, row)) / (c1 - c0), (at(column, r1) - at(column, r0)) / (r1 - r0)};
      places[static_cast<std::size_t>(row * board.columns + column)] = refine(image, at(column, row), to);
    }
  }
  return places;
}

}  // namespace fringecal::calib

#include "calib/board_corners.h"

#include <ceres/tiny_solver.h>
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

cv::Mat smaller(const cv::Mat& picture, double shrink) {
  if (shrink == 1.0) return picture;
  cv::Mat out;
  cv::resize(picture, out, cv::Size(), shrink, shrink, cv::INTER_AREA);
  return out;
}

/// Eq. 1 on the window around a start, with its derivatives; unknowns: c, the two directions, ln s, a, m, g.
struct Saddle {
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = 9 };

  const Image<float>* image;
  int x0, y0, half;
  double level, contrast;  // scale of the grey values, so that all unknowns are of order one

  int NumResiduals() const { return (2 * half + 1) * (2 * half + 1); }

  /// derivatives: column by column, or null.
  bool operator()(const double* p, double* residual, double* derivatives) const {
    const double sharpness = std::exp(-p[4]);
    const Eigen::Vector2d n1(-std::sin(p[2]), std::cos(p[2])), n2(-std::sin(p[3]), std::cos(p[3]));
    const int n = NumResiduals();
    int k = 0;
    for (int dy = -half; dy <= half; ++dy) {
      for (int dx = -half; dx <= half; ++dx, ++k) {
        const Eigen::Vector2d d(dx - p[0], dy - p[1]);
        const double t1 = std::tanh(n1.dot(d) * sharpness), t2 = std::tanh(n2.dot(d) * sharpness);
        const double gx = static_cast<double>(dx) / half, gy = static_cast<double>(dy) / half;
        const double value = ((*image)(x0 + dx, y0 + dy) - level) / contrast;
        residual[k] = p[5] * t1 * t2 + p[6] + p[7] * gx + p[8] * gy - value;
        if (!derivatives) continue;
        // By what stands in the two tanh.
        const double by1 = p[5] * t2 * (1 - t1 * t1) * sharpness, by2 = p[5] * t1 * (1 - t2 * t2) * sharpness;
        const double by[] = {-by1 * n1.x() - by2 * n2.x(),
                             -by1 * n1.y() - by2 * n2.y(),
                             -by1 * (n1.y() * d.x() - n1.x() * d.y()),
                             -by2 * (n2.y() * d.x() - n2.x() * d.y()),
                             -by1 * n1.dot(d) - by2 * n2.dot(d),
                             t1 * t2,
                             1.0,
                             gx,
                             gy};
        for (int j = 0; j < 9; ++j) derivatives[j * n + k] = by[j];
      }
    }
    return true;
  }
};

struct Neighbours {
  Eigen::Vector2d along_row, along_column;  // to the next corner
};

/// The corner as one window shows it; no value where the fit leaves it (a reflection, a neighbour's edge).
std::optional<Eigen::Vector2d> refined_once(const Image<float>& image, const Eigen::Vector2d& start,
                                            const Neighbours& to) {
  const double spacing = std::min(to.along_row.norm(), to.along_column.norm());
  // 0.35 of a square: the next edges, one square away, stay out by more than their blur.
  const int half = std::clamp(static_cast<int>(0.35 * spacing), 3, 15);
  const int x0 = static_cast<int>(std::lround(start.x())), y0 = static_cast<int>(std::lround(start.y()));
  if (x0 - half < 0 || y0 - half < 0 || x0 + half >= image.width() || y0 + half >= image.height()) return std::nullopt;
  double sum = 0, low = image(x0, y0), high = low;
  for (int y = y0 - half; y <= y0 + half; ++y) {
    for (int x = x0 - half; x <= x0 + half; ++x) {
      const double v = image(x, y);
      sum += v;
      low = std::min(low, v);
      high = std::max(high, v);
    }
  }
  if (!(high > low)) return std::nullopt;
  const Saddle saddle{&image, x0, y0, half, sum / ((2 * half + 1) * (2 * half + 1)), 0.5 * (high - low)};

  Eigen::Matrix<double, 9, 1> first;
  first << start.x() - x0, start.y() - y0, std::atan2(to.along_row.y(), to.along_row.x()),
      std::atan2(to.along_column.y(), to.along_column.x()), 0.0, 0.8, 0.0, 0.0, 0.0;
  // The sign of a: the one whose pattern is nearer to the picture; the other where that does not end at a corner.
  Eigen::VectorXd with(saddle.NumResiduals()), against(saddle.NumResiduals());
  saddle(first.data(), with.data(), nullptr);
  first[5] = -first[5];
  saddle(first.data(), against.data(), nullptr);
  if (with.squaredNorm() < against.squaredNorm()) first[5] = -first[5];
  for (int attempt = 0; attempt < 2; ++attempt, first[5] = -first[5]) {
    ceres::TinySolver<Saddle> solver;
    solver.options.max_num_iterations = 40;
    Eigen::Matrix<double, 9, 1> p = first;
    solver.Solve(saddle, &p);
    if (!p.allFinite() || !std::isfinite(solver.summary.final_cost)) continue;
    const Eigen::Vector2d place(x0 + p[0], y0 + p[1]);
    if ((place - start).norm() <= 0.5 * half) return place;
  }
  return std::nullopt;
}

/// The refined corner: its window is centred on its own pixel, so that it does not depend on where the detector put it (a
/// window a pixel away moves a corner by a thousandth of a pixel). The start where no window has a corner.
Eigen::Vector2d refine(const Image<float>& image, const Eigen::Vector2d& start, const Neighbours& to) {
  Eigen::Vector2d place = start;
  for (int pass = 0; pass < 4; ++pass) {
    const auto next = refined_once(image, place, to);
    if (!next) return place;
    const bool same =
        std::lround(next->x()) == std::lround(place.x()) && std::lround(next->y()) == std::lround(place.y());
    place = *next;
    if (same) break;
  }
  return place;
}

}  // namespace

Result<std::vector<Eigen::Vector2d>> find_chessboard(const Image<float>& image, const model::Board& board) {
  const cv::Size pattern(board.columns, board.rows);
  const cv::Mat picture = to_8bit(image);
  const double fits = std::min(1.0, static_cast<double>(kDetectionWidth) / picture.cols);
  double shrink = fits;
  std::vector<cv::Point2f> corners;
  bool found = false;
  try {
    // The quad search misses boards that are plain to see when its thresholds split a square, and takes seconds for it; on
    // a copy of another size they fall elsewhere. Last the slow search by saddle points.
    const int search = cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE;
    for (const double copy : {0.5, 1.0, 0.25}) {
      shrink = copy * fits;
      found = cv::findChessboardCorners(smaller(picture, shrink), pattern, corners, search | cv::CALIB_CB_FAST_CHECK);
      if (found) break;
    }
    if (!found) {
      shrink = fits;
      found =
          cv::findChessboardCornersSB(smaller(picture, shrink), pattern, corners,
                                      cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY);
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
  places.reserve(corners.size());
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

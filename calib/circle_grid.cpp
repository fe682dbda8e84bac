#include "calib/board_corners.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace fringecal::calib {
namespace {

struct Blob {
  Eigen::Vector2d center;
  double area_px2 = 0;
};

/// Connected regions that look like ellipses: the area fits the second moments of an ellipse.
std::vector<Blob> ellipses(const cv::Mat& picture, bool dark) {
  cv::Mat mask, labels, statistics, centroids;
  const int window = (std::max(31, picture.cols / 12)) | 1;
  cv::adaptiveThreshold(picture, mask, 255, cv::ADAPTIVE_THRESH_MEAN_C,
                        dark ? cv::THRESH_BINARY_INV : cv::THRESH_BINARY, window, dark ? 8 : -8);
  const int count = cv::connectedComponentsWithStats(mask, labels, statistics, centroids, 8, CV_32S);
  std::vector<Blob> blobs;
  for (int label = 1; label < count; ++label) {
    const cv::Rect box(statistics.at<int>(label, cv::CC_STAT_LEFT), statistics.at<int>(label, cv::CC_STAT_TOP),
                       statistics.at<int>(label, cv::CC_STAT_WIDTH), statistics.at<int>(label, cv::CC_STAT_HEIGHT));
    const int area = statistics.at<int>(label, cv::CC_STAT_AREA);
    if (area < 20 || area > picture.cols * picture.rows / 16) continue;
    if (box.x == 0 || box.y == 0 || box.br().x == picture.cols || box.br().y == picture.rows) continue;
    const cv::Moments m = cv::moments(labels(box) == label, true);
    const double determinant = (m.mu20 * m.mu02 - m.mu11 * m.mu11) / (m.m00 * m.m00);
    const double elliptic_area = 4.0 * std::numbers::pi * std::sqrt(std::max(0.0, determinant));
    if (std::abs(elliptic_area / m.m00 - 1.0) > 0.1) continue;
    // Centre of gravity of the grey values' distance from the surround, over the region and a rim of its blur.
    const int rim = 3;
    const cv::Rect wide = cv::Rect(box.x - rim, box.y - rim, box.width + 2 * rim, box.height + 2 * rim) &
                          cv::Rect(0, 0, picture.cols, picture.rows);
    cv::Mat region = labels(wide) == label, grown;
    cv::dilate(region, grown, cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * rim + 1, 2 * rim + 1}));
    const double surround = cv::mean(picture(wide), grown == 0)[0];
    double weight = 0, x = 0, y = 0;
    for (int r = 0; r < wide.height; ++r) {
      for (int c = 0; c < wide.width; ++c) {
        if (grown.at<std::uint8_t>(r, c) == 0) continue;
        const double w = dark ? surround - picture.at<std::uint8_t>(wide.y + r, wide.x + c)
                              : picture.at<std::uint8_t>(wide.y + r, wide.x + c) - surround;
        weight += w;
        x += w * (wide.x + c);
        y += w * (wide.y + r);
      }
    }
    if (weight > 0) blobs.push_back({{x / weight, y / weight}, m.m00});
  }
  return blobs;
}

/// Centre of the ellipse that a circle (centre c, radius r, board) becomes under H, minus the picture of c.
Eigen::Vector2d eccentricity(const Eigen::Matrix3d& h, const Eigen::Vector2d& c, double r) {
  Eigen::Matrix3d q;
  q << 1, 0, -c.x(), 0, 1, -c.y(), -c.x(), -c.y(), c.squaredNorm() - r * r;
  const Eigen::Matrix3d inverse = h.inverse();
  const Eigen::Matrix3d conic = inverse.transpose() * q * inverse;
  const Eigen::Vector2d center = conic.topLeftCorner<2, 2>().inverse() * -conic.topRightCorner<2, 1>();
  const Eigen::Vector3d image = h * Eigen::Vector3d(c.x(), c.y(), 1.0);
  return center - image.head<2>() / image.z();
}

/// |det| of the derivative of the homography at a point.
double local_area_scale(const Eigen::Matrix3d& h, const Eigen::Vector2d& p) {
  const double w = h.row(2).dot(Eigen::Vector3d(p.x(), p.y(), 1.0));
  return std::abs(h.determinant() / (w * w * w));
}

}  // namespace

Result<std::vector<Eigen::Vector2d>> find_circle_grid(const Image<float>& image, const model::Board& board) {
  const cv::Mat view(image.height(), image.width(), CV_32F, const_cast<float*>(image.data()));
  cv::Mat picture;
  double low = 0, high = 0;
  cv::minMaxLoc(view, &low, &high);
  view.convertTo(picture, CV_8U, 255.0 / std::max(high - low, 1e-6), -255.0 * low / std::max(high - low, 1e-6));

  const bool asymmetric = board.kind == model::BoardKind::asymmetric_circles;
  const cv::Size pattern(board.columns, board.rows);
  for (const bool dark : {true, false}) {
    std::vector<Blob> blobs = ellipses(picture, dark);
    if (static_cast<int>(blobs.size()) < board.corners()) continue;
    std::vector<cv::Point2f> candidates, centers;
    for (const Blob& b : blobs) {
      candidates.emplace_back(static_cast<float>(b.center.x()), static_cast<float>(b.center.y()));
    }
    bool found = false;
    try {
      const int flags = asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
      found = cv::findCirclesGrid(candidates, pattern, centers, flags, cv::Ptr<cv::FeatureDetector>()) ||
              cv::findCirclesGrid(candidates, pattern, centers, flags | cv::CALIB_CB_CLUSTERING,
                                  cv::Ptr<cv::FeatureDetector>());
    } catch (const cv::Exception&) {
      found = false;
    }
    if (!found || static_cast<int>(centers.size()) != board.corners()) continue;

    std::vector<Eigen::Vector2d> places;
    std::vector<double> areas;
    std::vector<cv::Point2d> on_board, in_image;
    for (std::size_t k = 0; k < centers.size(); ++k) {
      const Eigen::Vector2d near(centers[k].x, centers[k].y);
      const auto blob = std::min_element(blobs.begin(), blobs.end(), [&](const Blob& a, const Blob& b) {
        return (a.center - near).squaredNorm() < (b.center - near).squaredNorm();
      });
      places.push_back(blob->center);
      areas.push_back(blob->area_px2);
      const int column = static_cast<int>(k) % board.columns, row = static_cast<int>(k) / board.columns;
      const Eigen::Vector3d place = board.corner_mm(column, row);
      on_board.emplace_back(place.x(), place.y());
      in_image.emplace_back(blob->center.x(), blob->center.y());
    }
    const cv::Mat h_cv = cv::findHomography(on_board, in_image, 0);
    if (h_cv.empty()) continue;
    Eigen::Matrix3d h;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) h(r, c) = h_cv.at<double>(r, c);
    }
    // The radius is not in the board's file: the median of what the areas say.
    std::vector<double> radii;
    for (std::size_t k = 0; k < places.size(); ++k) {
      const double scale = local_area_scale(h, {on_board[k].x, on_board[k].y});
      radii.push_back(std::sqrt(areas[k] / (std::numbers::pi * scale)));
    }
    std::nth_element(radii.begin(), radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2), radii.end());
    const double radius = radii[radii.size() / 2];
    for (std::size_t k = 0; k < places.size(); ++k) {
      places[k] -= eccentricity(h, {on_board[k].x, on_board[k].y}, radius);
    }
    return places;
  }
  return unanswerable(
      fmt::format("no grid of {} x {} circles is seen whole; check kind, columns and rows of the board file, "
                  "the light and the focus",
                  board.columns, board.rows));
}

}  // namespace fringecal::calib

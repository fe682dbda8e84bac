// A camera solved to the rounding by other code than camera_solve.cpp: the joint solve's normal equations (bundle_system.h)
// without priors, started from its own initialisation; and how far two solutions lie apart, in px over all corners.
#pragma once

#include "calib/camera_solve.h"
#include "calib/initialise.h"
#include "calib/joint_solve.h"

#include <algorithm>
#include <span>

namespace fringecal::test {

/// The views' corners must be the same places in the same order.
inline Result<calib::CameraSolution> tight_camera_solve(std::span<const calib::PlanarView> views, int width_px,
                                                        int height_px) {
  calib::Bundle b;
  b.camera.width_px = width_px;
  b.camera.height_px = height_px;
  b.targets_mm = views.front().board_mm;
  b.cam_from_board.resize(views.size());
  for (std::size_t j = 0; j < views.size(); ++j) {
    for (std::size_t i = 0; i < views[j].pixels.size(); ++i) {
      b.sights.push_back({static_cast<int>(j), static_cast<int>(i), views[j].pixels[i], 1.0, {}, {}, true});
    }
  }
  if (const auto started = calib::initialise_camera(b); !started) return tl::unexpected(started.error());
  const auto report = calib::solve_bundle(b, {.outliers = calib::Outliers::keep, .fixed_components = true});
  if (!report) return tl::unexpected(report.error());
  return calib::CameraSolution{.camera = b.camera, .cam_from_board = b.cam_from_board, .squares_px2 = report->chi2};
}

/// The largest distance of a corner's two pictures.
inline double distance_px(const calib::CameraSolution& a, const calib::CameraSolution& b,
                          std::span<const calib::PlanarView> views) {
  double largest = 0;
  for (std::size_t j = 0; j < views.size(); ++j) {
    for (const auto& place : views[j].board_mm) {
      const Eigen::Vector3d on_board(place.x(), place.y(), 0);
      const auto p = a.camera.project(a.cam_from_board[j] * on_board),
                 q = b.camera.project(b.cam_from_board[j] * on_board);
      largest = std::max(largest, p && q ? (*p - *q).norm() : HUGE_VAL);
    }
  }
  return largest;
}

}  // namespace fringecal::test

#include "tests/calib/other_libraries.h"

#include "core/error.h"
#include "tests/calib/synthetic_board_views.h"

#include <opencv2/calib3d.hpp>

extern "C" {
#include <mrcal/mrcal.h>
}

namespace fringecal::test {
namespace {

struct CvViews {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
};

CvViews cv_views(const std::vector<calib::PlanarView>& views) {
  CvViews out;
  for (const auto& v : views) {
    out.object.emplace_back();
    out.image.emplace_back();
    for (std::size_t i = 0; i < v.pixels.size(); ++i) {
      out.object.back().emplace_back(static_cast<float>(v.board_mm[i].x()), static_cast<float>(v.board_mm[i].y()),
                                     0.0F);
      out.image.back().emplace_back(static_cast<float>(v.pixels[i].x()), static_cast<float>(v.pixels[i].y()));
    }
  }
  return out;
}

}  // namespace

LibrarySolution solve_with_opencv(const std::vector<calib::PlanarView>& views, int width_px, int height_px,
                                  calib::DistortionTerms terms, int iterations) {
  const CvViews v = cv_views(views);
  int flags = 0;
  if (terms != calib::DistortionTerms::full) flags |= cv::CALIB_FIX_K3;
  if (terms == calib::DistortionTerms::radial) flags |= cv::CALIB_ZERO_TANGENT_DIST;
  cv::Mat matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  const double rms =
      cv::calibrateCamera(v.object, v.image, {width_px, height_px}, matrix, distortion, rotations, translations, flags,
                          {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, iterations, 1e-16});
  LibrarySolution out;
  auto& c = out.camera;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx_px = matrix.at<double>(0, 0);
  c.fy_px = matrix.at<double>(1, 1);
  c.cx_px = matrix.at<double>(0, 2);
  c.cy_px = matrix.at<double>(1, 2);
  for (int i = 0; i < 5; ++i) c.distortion[static_cast<std::size_t>(i)] = distortion.at<double>(i);
  std::size_t corners = 0;
  for (const auto& view : views) corners += view.pixels.size();
  out.squares_px2 = rms * rms * static_cast<double>(corners);  // its rms is per point
  return out;
}

LibrarySolution solve_with_mrcal(const std::vector<calib::PlanarView>& views, int width_px, int height_px, int columns,
                                 double pitch_mm) {
  const CvViews v = cv_views(views);
  const cv::Mat start = cv::initCameraMatrix2D(v.object, v.image, {width_px, height_px}, 1.0);
  double intrinsics[8] = {start.at<double>(0, 0), start.at<double>(1, 1), start.at<double>(0, 2),
                          start.at<double>(1, 2)};
  std::vector<mrcal_pose_t> frames(views.size());
  std::vector<mrcal_observation_board_t> observations(views.size());
  std::vector<mrcal_point3_t> pool;
  for (std::size_t j = 0; j < views.size(); ++j) {
    cv::Mat r, t;
    cv::solvePnP(v.object[j], v.image[j], start, cv::noArray(), r, t);
    frames[j] = {};
    for (int i = 0; i < 3; ++i) {
      frames[j].r.xyz[i] = r.at<double>(i);
      frames[j].t.xyz[i] = t.at<double>(i);
    }
    observations[j] = {};
    observations[j].icam.intrinsics = 0;
    observations[j].icam.extrinsics = -1;
    observations[j].iframe = static_cast<int>(j);
    for (const auto& p : views[j].pixels) {
      mrcal_point3_t point = {};
      point.xyz[0] = p.x();
      point.xyz[1] = p.y();
      point.xyz[2] = 1.0;
      pool.push_back(point);
    }
  }
  const int rows = static_cast<int>(views.front().pixels.size()) / columns;
  mrcal_lensmodel_t lens = {};
  lens.type = MRCAL_LENSMODEL_OPENCV4;
  mrcal_problem_selections_t selections = {};
  selections.do_optimize_intrinsics_core = true;
  selections.do_optimize_intrinsics_distortions = true;
  selections.do_optimize_frames = true;
  const mrcal_problem_constants_t constants = {};
  const int size[] = {width_px, height_px};
  const auto boards = static_cast<int>(views.size());
  const mrcal_stats_t stats =
      mrcal_optimize(nullptr, 0, nullptr, 0, intrinsics, nullptr, frames.data(), nullptr, nullptr, 1, 0, boards, 0, 0,
                     observations.data(), nullptr, boards, 0, pool.data(), &lens, size, selections, &constants,
                     pitch_mm, columns, rows, false, false);
  require(stats.rms_reproj_error__pixels >= 0, "mrcal solves the views of this test");
  LibrarySolution out;
  auto& c = out.camera;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx_px = intrinsics[0];
  c.fy_px = intrinsics[1];
  c.cx_px = intrinsics[2];
  c.cy_px = intrinsics[3];
  for (std::size_t i = 0; i < 4; ++i) c.distortion[i] = intrinsics[4 + i];
  // Its rms is per coordinate.
  out.squares_px2 =
      stats.rms_reproj_error__pixels * stats.rms_reproj_error__pixels * 2.0 * static_cast<double>(pool.size());
  return out;
}

std::vector<calib::PlanarView> planar_views(int boards, int columns, int rows, double pitch_mm, double noise_px) {
  model::Scanner scanner = known_scanner();
  scanner.camera.distortion = {-0.10, 0.06, 0, 0, 0};
  model::Board board;
  board.columns = columns;
  board.rows = rows;
  board.pitch_x_mm = board.pitch_y_mm = pitch_mm;
  std::vector<calib::PlanarView> out;
  for (const auto& o : views(scanner, board, boards, {.u_pixel_px = noise_px})) {
    calib::PlanarView v;
    for (const auto& c : o.corners) {
      v.board_mm.push_back(board.corner_mm(c.column, c.row).head<2>());
      // OpenCV keeps its points in float: the same corners for all.
      v.pixels.push_back(c.pixel.cast<float>().cast<double>());
    }
    out.push_back(std::move(v));
  }
  return out;
}

}  // namespace fringecal::test

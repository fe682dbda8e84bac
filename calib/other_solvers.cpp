#include "calib/other_solvers.h"

#include "calib/joint_solve.h"
#include "core/error.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#if FRINGECAL_HAVE_MRCAL
extern "C" {
#include <mrcal/mrcal.h>
}
#endif

#include <algorithm>
#include <cmath>

namespace fringecal::calib {
namespace {

struct CvViews {
  std::vector<std::vector<cv::Point3f>> object;
  std::vector<std::vector<cv::Point2f>> image;
};

CvViews cv_views(std::span<const PlanarView> views) {
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

/// The sum of squares at a library's solution, from its lens and poses: OpenCV's own rms is off by 1e-5 of itself.
double squares_of(std::span<const PlanarView> views, const model::Camera& camera, const std::vector<Rigid3>& poses) {
  double sum = 0;
  for (std::size_t j = 0; j < views.size(); ++j) {
    for (std::size_t i = 0; i < views[j].pixels.size(); ++i) {
      const Eigen::Vector2d& place = views[j].board_mm[i];
      const auto seen = camera.project(poses[j] * Eigen::Vector3d(place.x(), place.y(), 0));
      sum += seen ? (*seen - views[j].pixels[i]).squaredNorm() : HUGE_VAL;
    }
  }
  return sum;
}

#if FRINGECAL_HAVE_MRCAL
/// libmrcal's solver; loaded once, never unloaded.
decltype(&mrcal_optimize) mrcal_solver() {
  static void* const library = dlopen("libmrcal.so.2", RTLD_NOW | RTLD_LOCAL);
  return library ? reinterpret_cast<decltype(&mrcal_optimize)>(dlsym(library, "mrcal_optimize")) : nullptr;
}

/// The grid that all corners stand on; no value where they do not.
struct Grid {
  double pitch_mm = 0;
  int columns = 0, rows = 0;
  int index_of(const Eigen::Vector2d& place) const {
    return static_cast<int>(std::lround(place.y() / pitch_mm)) * columns +
           static_cast<int>(std::lround(place.x() / pitch_mm));
  }
};

std::optional<Grid> grid_of(std::span<const PlanarView> views) {
  Grid grid;
  double least = HUGE_VAL;
  Eigen::Vector2d last = Eigen::Vector2d::Zero();
  for (const auto& v : views) {
    for (const auto& p : v.board_mm) {
      if (p.x() > 1e-9) least = std::min(least, p.x());
      last = last.cwiseMax(p);
    }
  }
  if (!std::isfinite(least)) return std::nullopt;
  grid.pitch_mm = least;
  grid.columns = static_cast<int>(std::lround(last.x() / least)) + 1;
  grid.rows = static_cast<int>(std::lround(last.y() / least)) + 1;
  for (const auto& v : views) {
    for (const auto& p : v.board_mm) {
      const Eigen::Vector2d on = (p / least).array().round() * least;
      if (p.minCoeff() < -1e-9 || (on - p).norm() > 1e-9 * last.norm()) return std::nullopt;
    }
  }
  return grid;
}
#endif

}  // namespace

Result<OtherSolution> solve_with_opencv(std::span<const PlanarView> views, int width_px, int height_px,
                                        DistortionTerms terms, int iterations) {
  const CvViews v = cv_views(views);
  int flags = 0;
  if (terms != DistortionTerms::full) flags |= cv::CALIB_FIX_K3;
  if (terms == DistortionTerms::radial) flags |= cv::CALIB_ZERO_TANGENT_DIST;
  cv::Mat matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  try {
    cv::calibrateCamera(v.object, v.image, {width_px, height_px}, matrix, distortion, rotations, translations, flags,
                        {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, iterations, 1e-16});
  } catch (const cv::Exception& e) {
    return unanswerable(fmt::format("OpenCV does not solve these views: {}", e.err));
  }
  OtherSolution out;
  auto& c = out.camera;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx_px = matrix.at<double>(0, 0);
  c.fy_px = matrix.at<double>(1, 1);
  c.cx_px = matrix.at<double>(0, 2);
  c.cy_px = matrix.at<double>(1, 2);
  for (int i = 0; i < 5; ++i) c.distortion[static_cast<std::size_t>(i)] = distortion.at<double>(i);
  std::vector<Rigid3> poses;
  for (std::size_t j = 0; j < views.size(); ++j) {
    const double* const r = rotations[j].ptr<double>();
    const double* const t = translations[j].ptr<double>();
    poses.push_back({rotation_from_vector({r[0], r[1], r[2]}), {t[0], t[1], t[2]}});
  }
  out.squares_px2 = squares_of(views, c, poses);
  if (!std::isfinite(out.squares_px2)) return unanswerable("OpenCV does not solve these views");
  return out;
}

Result<OtherSolution> solve_with_mrcal(std::span<const PlanarView> views, int width_px, int height_px,
                                       DistortionTerms terms) {
  require(terms == DistortionTerms::radial_tangential || terms == DistortionTerms::full,
          "mrcal estimates four or five distortion coefficients");
#if FRINGECAL_HAVE_MRCAL
  const auto optimize = mrcal_solver();
  if (!optimize) {
    return unanswerable(fmt::format("libmrcal cannot be loaded ({}); install the Debian package libmrcal2", dlerror()));
  }
  const auto grid = grid_of(views);
  if (!grid) return unanswerable("mrcal solves boards that are a grid with equal pitches; this one is not");
  const CvViews v = cv_views(views);
  const cv::Mat start = cv::initCameraMatrix2D(v.object, v.image, {width_px, height_px}, 1.0);
  double intrinsics[9] = {start.at<double>(0, 0), start.at<double>(1, 1), start.at<double>(0, 2),
                          start.at<double>(1, 2)};
  std::vector<mrcal_pose_t> frames(views.size());
  std::vector<mrcal_observation_board_t> observations(views.size());
  const auto per_board = static_cast<std::size_t>(grid->columns) * static_cast<std::size_t>(grid->rows);
  mrcal_point3_t unseen = {};
  unseen.xyz[2] = -1.0;  // a negative weight: left out
  std::vector<mrcal_point3_t> pool(views.size() * per_board, unseen);
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
    for (std::size_t i = 0; i < views[j].pixels.size(); ++i) {
      auto& point = pool[j * per_board + static_cast<std::size_t>(grid->index_of(views[j].board_mm[i]))];
      point.xyz[0] = views[j].pixels[i].x();
      point.xyz[1] = views[j].pixels[i].y();
      point.xyz[2] = 1.0;
    }
  }
  mrcal_lensmodel_t lens = {};
  lens.type = terms == DistortionTerms::full ? MRCAL_LENSMODEL_OPENCV5 : MRCAL_LENSMODEL_OPENCV4;
  mrcal_problem_selections_t selections = {};
  selections.do_optimize_intrinsics_core = true;
  selections.do_optimize_intrinsics_distortions = true;
  selections.do_optimize_frames = true;
  const mrcal_problem_constants_t constants = {};
  const int size[] = {width_px, height_px};
  const auto boards = static_cast<int>(views.size());
  const mrcal_stats_t stats =
      optimize(nullptr, 0, nullptr, 0, intrinsics, nullptr, frames.data(), nullptr, nullptr, 1, 0, boards, 0, 0,
               observations.data(), nullptr, boards, 0, pool.data(), &lens, size, selections, &constants,
               grid->pitch_mm, grid->columns, grid->rows, false, false);
  OtherSolution out;
  auto& c = out.camera;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx_px = intrinsics[0];
  c.fy_px = intrinsics[1];
  c.cx_px = intrinsics[2];
  c.cy_px = intrinsics[3];
  const std::size_t count = terms == DistortionTerms::full ? 5 : 4;
  for (std::size_t i = 0; i < count; ++i) c.distortion[i] = intrinsics[4 + i];
  std::vector<Rigid3> poses;
  poses.reserve(frames.size());
  for (const mrcal_pose_t& f : frames) {
    poses.push_back({rotation_from_vector({f.r.xyz[0], f.r.xyz[1], f.r.xyz[2]}), {f.t.xyz[0], f.t.xyz[1], f.t.xyz[2]}});
  }
  out.squares_px2 = squares_of(views, c, poses);
  const double rms = stats.rms_reproj_error__pixels;
  if (!(rms >= 0) || !std::isfinite(out.squares_px2) || !(c.fx_px > 0)) {
    return unanswerable("mrcal does not solve these views");
  }
  return out;
#else
  (void)views, (void)width_px, (void)height_px;
  return unanswerable(
      "this fringecal was built without libmrcal; install the Debian package libmrcal-dev and build it again");
#endif
}

Result<CrossCheck> cross_check(std::span<const PlanarView> views, int width_px, int height_px, DistortionTerms terms,
                               OtherSolver solver) {
  std::vector<PlanarView> rounded(views.begin(), views.end());
  for (auto& v : rounded) {
    for (auto& p : v.pixels) p = p.cast<float>().cast<double>();
    for (auto& p : v.board_mm) p = p.cast<float>().cast<double>();
  }
  CrossCheck out;
  out.terms =
      terms == DistortionTerms::radial && solver == OtherSolver::mrcal ? DistortionTerms::radial_tangential : terms;
  auto ours = solve_camera(rounded, width_px, height_px, {.terms = out.terms});
  if (!ours) return tl::unexpected(ours.error());
  auto theirs = solver == OtherSolver::mrcal ? solve_with_mrcal(rounded, width_px, height_px, out.terms)
                                             : solve_with_opencv(rounded, width_px, height_px, out.terms, 1000);
  if (!theirs) return tl::unexpected(theirs.error());
  out.ours = std::move(*ours);
  out.theirs = *theirs;
  for (const Rigid3& pose : out.ours.cam_from_board) {
    out.distance_mm += pose.translation_mm.z() / static_cast<double>(out.ours.cam_from_board.size());
  }
  constexpr int kGrid = 25;
  double squares = 0;
  int count = 0;
  for (int y = 0; y < kGrid; ++y) {
    for (int x = 0; x < kGrid; ++x) {
      const auto ray = out.ours.camera.ray({x * (width_px - 1.0) / (kGrid - 1), y * (height_px - 1.0) / (kGrid - 1)});
      if (!ray) continue;
      const auto a = out.ours.camera.project(*ray), b = out.theirs.camera.project(*ray);
      const double d = (*a - *b).norm();  // eq. 1
      out.max_px = std::max(out.max_px, d);
      squares += d * d;
      ++count;
    }
  }
  if (count == 0) return unanswerable("the lens found has no inverse anywhere in the image");
  out.rms_px = std::sqrt(squares / count);
  out.max_mm = out.max_px * out.distance_mm / out.ours.camera.fx_px;
  return out;
}

}  // namespace fringecal::calib

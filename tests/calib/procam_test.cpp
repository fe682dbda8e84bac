// A real camera-projector pair: five chessboard poses, the projector's vertical coordinate in Gray code of 10 bits with
// inverses (kamino410/procam-calibration; the shared data's README has the reference values).
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "calib/camera_solve.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/import_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace fringecal {
namespace {

namespace fs = std::filesystem;
using calib::CalibrationMethod;
using calib::DistortionTerms;

const fs::path kData = fs::path(FRINGECAL_SHARED_DATA) / "procam-gray";

constexpr const char* kPlan = R"([codes.y]
gray_bits = 10
phase_steps = 0
stripes_per_period = 1
period = 1.0
unit = "px"
[[sequence]]
files = "graycode_{}.png"
first = 20
patterns = ["gray 0..9 with inverses", "white", "black"]
)";

/// A printed board on a plate: 75 mm squares placed to about 0.1 mm.
model::Board printed_board() {
  model::Board b;
  b.columns = 9;
  b.rows = 7;
  b.pitch_x_mm = b.pitch_y_mm = 75.0;
  b.u_print_mm = 0.1;
  b.u_pitch_relative = 1e-3;
  return b;
}

class Procam : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!fs::exists(kData / "pose_0")) return;
    const fs::path plan = fs::path(::testing::TempDir()) / "fringecal_procam_plan.toml";
    write_atomically(plan, kPlan);
    for (int i = 0; i < 5; ++i) {
      const std::string name = "pose_" + std::to_string(i);
      const Capture capture = import_capture(kData / name, plan);
      plan_ = capture.info.plan;
      auto seen = calib::observe_board(capture, printed_board(), name);
      ASSERT_TRUE(seen) << name << ": " << seen.error().sentence;
      views_.push_back(*seen);
    }
  }
  void SetUp() override {
    if (views_.empty()) GTEST_SKIP() << "shared data not present: " << kData.string();
  }

  static Result<model::Scanner> solve(const calib::CalibrationOptions& options) {
    const auto found = calib::calibrate(views_, printed_board(), 1280, 1024, plan_, options);
    if (found) {
      const auto& s = *found;
      const auto& r = s.residuals;
      std::printf(
          "%s\ncamera f %.2f +- %.2f, %.2f c %.2f, %.2f; projector f %.2f +- %.2f, c %.2f; rms %.4f px per coordinate, "
          "%.4f projector px, grid %.3f mm; %d corners left out\n",
          s.method.c_str(), s.camera.fx_px, *s.uncertainty.u("camera.fx_px"), s.camera.fy_px, s.camera.cx_px,
          s.camera.cy_px, s.projector.y->f, *s.uncertainty.u("projector.y.f"), s.projector.y->u0, r.camera_rms_px,
          r.projector_rms, r.grid_rms_mm, r.corners_rejected);
    }
    return found;
  }

  static std::vector<model::BoardObservation> views_;
  static PatternPlan plan_;
};
std::vector<model::BoardObservation> Procam::views_;
PatternPlan Procam::plan_;

TEST_F(Procam, CameraAloneAgreesWithTheReferenceForTheSameTerms) {
  // 0.2 % of f and 4 px of c are what the project asks; another corner refinement on the same pictures moves f by 1 to
  // 3 px and c by 1 to 2 px, and k2 of a board that fills a third of the field is hardly determined.
  const auto radial = solve({.camera_terms = DistortionTerms::radial, .method = CalibrationMethod::staged});
  ASSERT_TRUE(radial) << radial.error().sentence;
  EXPECT_NEAR(radial->camera.fx_px, 3453.80, 0.002 * 3453.80);
  EXPECT_NEAR(radial->camera.fy_px, 3452.51, 0.002 * 3452.51);
  EXPECT_NEAR(radial->camera.cx_px, 611.02, 4.0);
  EXPECT_NEAR(radial->camera.cy_px, 527.11, 4.0);
  EXPECT_NEAR(radial->camera.distortion[0], -0.2386, 0.03);
  // The reference's rms is per point; better corners lower it.
  EXPECT_LT(radial->residuals.camera_rms_px * std::sqrt(2.0), 0.3113);

  const auto full = solve({.camera_terms = DistortionTerms::full, .method = CalibrationMethod::staged});
  ASSERT_TRUE(full) << full.error().sentence;
  EXPECT_NEAR(full->camera.fx_px, 3452.39, 0.002 * 3452.39);
  EXPECT_NEAR(full->camera.fy_px, 3449.93, 0.002 * 3449.93);
  EXPECT_NEAR(full->camera.cx_px, 587.17, 4.0);
  EXPECT_NEAR(full->camera.cy_px, 521.45, 4.0);
}

TEST_F(Procam, TheReferencesOwnCornersGiveItsFigures) {
  // OpenCV's corners of the white pictures, refined in windows of 11 x 11: the reference's. Our own corners give the figures
  // of the test above, and a smaller rms.
  std::vector<calib::PlanarView> views;
  for (int i = 0; i < 5; ++i) {
    const GrayImage image = read_gray_image(kData / ("pose_" + std::to_string(i)) / "graycode_40.png");
    auto white = std::get<Image8>(image);
    const cv::Mat picture(white.height(), white.width(), CV_8U, white.data());
    std::vector<cv::Point2f> corners;
    ASSERT_TRUE(cv::findChessboardCorners(picture, {9, 7}, corners)) << i;
    cv::cornerSubPix(picture, corners, {5, 5}, {-1, -1}, {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 100, 1e-6});
    calib::PlanarView view;
    for (int k = 0; k < 63; ++k) {
      view.board_mm.emplace_back(75.0 * (k % 9), 75.0 * (k / 9));
      view.pixels.emplace_back(corners[static_cast<std::size_t>(k)].x, corners[static_cast<std::size_t>(k)].y);
    }
    views.push_back(std::move(view));
  }
  const auto found = calib::solve_camera(views, 1280, 1024, {});
  ASSERT_TRUE(found) << found.error().sentence;
  const auto& c = found->camera;
  const double rms_px = std::sqrt(2.0) * found->rms_px;  // per point, as OpenCV has it
  std::printf("f %.3f %.3f c %.3f %.3f k %.5f %.5f rms %.5f px\n", c.fx_px, c.fy_px, c.cx_px, c.cy_px, c.distortion[0],
              c.distortion[1], rms_px);
  // The last digits that the reference is printed with; another machine's float arithmetic in the refinement moves a corner
  // by 1e-5 px and f by 1e-3.
  EXPECT_NEAR(c.fx_px, 3453.80, 0.02);
  EXPECT_NEAR(c.fy_px, 3452.51, 0.02);
  EXPECT_NEAR(c.cx_px, 611.02, 0.02);
  EXPECT_NEAR(c.cy_px, 527.11, 0.02);
  EXPECT_NEAR(c.distortion[0], -0.2386, 2e-4);
  EXPECT_NEAR(c.distortion[1], -0.012, 2e-3);
  EXPECT_NEAR(rms_px, 0.3113, 0.002 * 0.3113);
}

TEST_F(Procam, ProjectorFocalLengthAgreesWithTheReferenceFromBothDirections) {
  for (const auto method : {CalibrationMethod::staged, CalibrationMethod::joint}) {
    const auto found = solve({.camera_terms = DistortionTerms::radial, .method = method});
    ASSERT_TRUE(found) << found.error().sentence;
    // 1.5 % is what the project asks of one code direction with five poses.
    EXPECT_NEAR(found->projector.y->f, 1895.7, 0.015 * 1895.7);
  }
}

TEST_F(Procam, ProjectorLiesWithinThreeOfItsOwnUncertaintiesOfBothDirectionsTogether) {
  // The solution from both code directions with the same terms: f = 1889.3, c_y = 853.5 (its own u of 3.2 and 8.1 px comes
  // on top and is not counted here).
  for (const auto method : {CalibrationMethod::staged, CalibrationMethod::joint}) {
    const auto found = solve({.camera_terms = DistortionTerms::radial, .method = method});
    ASSERT_TRUE(found) << found.error().sentence;
    EXPECT_LT(std::abs(found->projector.y->f - 1889.3), 3.0 * *found->uncertainty.u("projector.y.f"));
    EXPECT_LT(std::abs(found->projector.y->u0 - 853.5), 3.0 * *found->uncertainty.u("projector.y.u0"));
    // The board is creased and was bent anew in every pose: five poses say so, and u must.
    EXPECT_THAT(found->method, ::testing::HasSubstr("widened")) << found->method;
  }
}

TEST_F(Procam, JointAndPlainCameraDifferByWhatBothAreUncertainBy) {
  // A board that contradicts itself: plain least squares puts what the board bends into f, and its own poses scatter f by
  // 1 %; both say so, and the joint solve names the pose with the crease (pose_1).
  const auto joint = solve({.camera_terms = DistortionTerms::radial}),
             plain = solve({.camera_terms = DistortionTerms::radial, .method = CalibrationMethod::staged});
  ASSERT_TRUE(joint && plain);
  const double u = std::hypot(*joint->uncertainty.u("camera.fx_px"), *plain->uncertainty.u("camera.fx_px"));
  EXPECT_LT(std::abs(joint->camera.fx_px - plain->camera.fx_px), 2 * u);
  EXPECT_THAT(joint->method, ::testing::HasSubstr("look at pose_1 first")) << joint->method;
}

TEST_F(Procam, LeavingOutOnePoseMovesTheJointFocalLengthAsStated) {
  const calib::CalibrationOptions options{.camera_terms = DistortionTerms::radial};
  const auto all = solve(options);
  ASSERT_TRUE(all) << all.error().sentence;
  const auto n = static_cast<double>(views_.size());
  double sum = 0, squares = 0;
  for (std::size_t out = 0; out < views_.size(); ++out) {
    auto kept = views_;
    kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(out));
    const auto found = calib::calibrate(kept, printed_board(), 1280, 1024, plan_, options);
    ASSERT_TRUE(found) << found.error().sentence;
    const double moved = found->camera.fx_px - all->camera.fx_px;
    std::printf("without %s: f %+.2f px\n", views_[out].name.c_str(), moved);
    sum += moved;
    squares += moved * moved;
  }
  const double jackknife = std::sqrt((n - 1) / n * (squares - sum * sum / n)), u = *all->uncertainty.u("camera.fx_px");
  std::printf("scatter of f from pose to pose %.2f px, stated %.2f px\n", jackknife, u);
  // Five poses know their own scatter as chi2 of four degrees of freedom does: 18.5 / 4 is passed once in a thousand.
  EXPECT_LT(jackknife, std::sqrt(18.5 / 4) * u);
}

TEST_F(Procam, RobustJointSolveReproducesTheGrid) {
  const auto found = solve({});
  ASSERT_TRUE(found) << found.error().sentence;
  // The board is creased near one corner (pose_1 is off by up to 2.5 px there): those corners are left out, not all of
  // a pose.
  EXPECT_GT(found->residuals.corners_rejected, 5);
  EXPECT_LT(found->residuals.corners_rejected, 315 / 4);
  EXPECT_LT(found->residuals.camera_rms_px, 0.1);
  // A printed board: 0.1 mm; depth from 0.05 projector px at 3100 mm over a base line of 670 mm: 0.05 / 1880 x 3100^2 /
  // 670 = 0.38 mm in Z; for the good corners the sum, 0.48 mm. The figure has all 315 corners: some 9 in the crease are off
  // by up to 2.5 px of 0.9 mm, which adds sqrt(9 / 315) x 2.2 mm = 0.38 mm in quadrature: 0.61 mm.
  EXPECT_LT(found->residuals.grid_rms_mm, 0.61);
}

}  // namespace
}  // namespace fringecal

// A real camera-projector pair: five chessboard poses, the projector's vertical coordinate in Gray code of 10 bits with
// inverses (kamino410/procam-calibration; the shared data's README has the reference values).
#include "calib/board_detection.h"
#include "calib/calibrate.h"
#include "core/file.h"
#include "core/import_plan.h"

#include <gtest/gtest.h>

#include <filesystem>

namespace fringecal {
namespace {

namespace fs = std::filesystem;
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

  static void print(const model::Scanner& s) {
    std::printf("%s\n", s.method.c_str());
    std::printf("f %.2f %.2f c %.2f %.2f k %.4f %.4f %.5f %.5f %.4f | proj f %.2f u0 %.2f k %.4f %.4f t %.2f %.2f %.2f\n", s.camera.fx_px, s.camera.fy_px,
                s.camera.cx_px, s.camera.cy_px, s.camera.distortion[0], s.camera.distortion[1], s.camera.distortion[2],
                s.camera.distortion[3], s.camera.distortion[4], s.projector.y->f, s.projector.y->u0, s.projector.distortion[0],
                s.projector.distortion[1], s.proj_from_cam.translation_mm.x(), s.proj_from_cam.translation_mm.y(), s.proj_from_cam.translation_mm.z());
    for (const auto& n : s.uncertainty.names) std::printf(" %s u=%.3g", n.c_str(), *s.uncertainty.u(n));
    const auto& r = s.residuals;
    std::printf("\nrms cam %.4f (point %.4f) proj %.4f grid %.4f mm; used %d rejected %d it %d L %.1f\n", r.camera_rms_px, r.camera_rms_px * std::sqrt(2.0),
                r.projector_rms, r.grid_rms_mm, r.corners_used, r.corners_rejected, r.iterations, s.working_distance_mm);
  }

  static std::vector<model::BoardObservation> views_;
  static PatternPlan plan_;
};
std::vector<model::BoardObservation> Procam::views_;
PatternPlan Procam::plan_;

TEST_F(Procam, Prints) {
  for (const auto& o : views_) {
    double u = 0; int n = 0;
    for (const auto& c : o.corners) if (c.y) { u += c.y->u; ++n; }
    std::printf("%s u_pixel %.3f u_y %.3f n %d first %.2f %.2f\n", o.name.c_str(), o.corners[0].u_pixel_px, u / n, n, o.corners[0].pixel.x(), o.corners[0].pixel.y());
  }
  for (const auto terms : {DistortionTerms::radial, DistortionTerms::full, DistortionTerms::automatic})
    for (const double u_print : {1e-4, 0.1})
      for (const double bow : {0.0, 1e-3}) {
        auto board = printed_board();
        board.u_print_mm = u_print;
        std::printf("--- terms %d print %g bow %g\n", int(terms), u_print, bow);
        const auto s = calib::calibrate(views_, board, 1280, 1024, plan_, {.camera_terms = terms, .outliers = calib::Outliers::keep, .u_bow_relative = bow});
        if (s) print(*s); else std::printf("%s\n", s.error().sentence.c_str());
      }
}

}  // namespace
}  // namespace fringecal

// The reported covariance against the scatter of repeats.
#include "calib/calibrate.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include <cmath>

namespace fringecal {
namespace {

double true_value(const model::Scanner& s, const std::string& name) {
  const auto& c = s.camera;
  const auto& t = s.proj_from_cam.translation_mm;
  if (name == "camera.fx_px") return c.fx_px;
  if (name == "camera.fy_px") return c.fy_px;
  if (name == "camera.cx_px") return c.cx_px;
  if (name == "camera.cy_px") return c.cy_px;
  if (name == "projector.x.f") return s.projector.x->f;
  if (name == "projector.x.u0") return s.projector.x->u0;
  if (name.ends_with("translation_x_mm")) return t.x();
  if (name.ends_with("translation_y_mm")) return t.y();
  if (name.ends_with("translation_z_mm")) return t.z();
  const std::array<std::string, 5> terms = {"k1", "k2", "p1", "p2", "k3"};
  for (std::size_t i = 0; i < terms.size(); ++i) {
    if (name == "camera." + terms[i]) return c.distortion[i];
    if (name == "projector." + terms[i]) return s.projector.distortion[i];
  }
  ADD_FAILURE() << "no true value of " << name;
  return 0;
}

TEST(CalibrationCovariance, IsTheScatterOfRepeats) {
  const model::Scanner truth = test::known_scanner();
  model::Board board = test::known_board();
  board.columns = 7;
  board.rows = 5;
  board.pitch_x_mm = board.pitch_y_mm = 40;
  board.u_print_mm = 0.010;
  board.u_pitch_relative = 1e-4;
  constexpr int kRepeats = 60;
  std::vector<std::string> names;
  Eigen::VectorXd squares;
  double mahalanobis = 0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const auto seen =
        test::views(truth, board, 15,
                    {.print_mm = 0.010, .pitch_relative = 1e-4, .seed = 100 + static_cast<std::uint64_t>(repeat)});
    const auto found = calib::calibrate(seen, board, 1392, 1040, test::known_plan(),
                                        {.camera_terms = calib::DistortionTerms::radial_tangential});
    ASSERT_TRUE(found) << found.error().sentence;
    names = found->uncertainty.names;
    const auto n = static_cast<Eigen::Index>(names.size());
    Eigen::VectorXd error(n);
    // R = exp(w) R_estimate; the error of the estimate is the w that leads from the truth to it.
    const Eigen::Vector3d w =
        vector_from_rotation(found->proj_from_cam.rotation * truth.proj_from_cam.rotation.conjugate());
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::string& name = names[static_cast<std::size_t>(i)];
      if (name.find("rotation_") != std::string::npos) {
        error[i] = w[name.find("x_rad") != std::string::npos ? 0 : name.find("y_rad") != std::string::npos ? 1 : 2];
      } else {
        error[i] = true_value(*found, name) - true_value(truth, name);
      }
    }
    if (repeat == 0) squares.setZero(n);
    squares += error.cwiseAbs2().cwiseQuotient(found->uncertainty.covariance.diagonal());
    mahalanobis += error.dot(found->uncertainty.covariance.ldlt().solve(error)) / static_cast<double>(n);
  }
  // A standard deviation from 60 repeats is known to 1 / sqrt(120) = 9 %. Of 18 parameters the farthest out is expected
  // at 2.5 of these; 3.5 of them are 0.68 .. 1.32.
  for (Eigen::Index i = 0; i < squares.size(); ++i) {
    const double ratio = std::sqrt(squares[i] / kRepeats);
    EXPECT_GT(ratio, 0.68) << names[static_cast<std::size_t>(i)];
    EXPECT_LT(ratio, 1.32) << names[static_cast<std::size_t>(i)];
  }
  // e' C^-1 e / p over all: relative standard deviation sqrt(2 / (60 x 18)) = 4.3 %, so the root lies within 0.9 .. 1.1
  // at 4 of these; 0.8 .. 1.2 leaves room for the variance components, whose own scatter (2 %) widens the tails.
  EXPECT_GT(std::sqrt(mahalanobis / kRepeats), 0.8);
  EXPECT_LT(std::sqrt(mahalanobis / kRepeats), 1.2);
}

}  // namespace
}  // namespace fringecal

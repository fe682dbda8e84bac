// The reported covariance against the scatter of repeats.
#include "calib/calibrate.h"
#include "calib/model/triangulate.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

namespace fringecal {
namespace {

/// The address of a parameter by its name; null for a rotation.
double* parameter(model::Scanner& s, const std::string& name) {
  auto& c = s.camera;
  auto& t = s.proj_from_cam.translation_mm;
  const std::map<std::string, double*> named = {
      {"camera.fx_px", &c.fx_px},
      {"camera.fy_px", &c.fy_px},
      {"camera.cx_px", &c.cx_px},
      {"camera.cy_px", &c.cy_px},
      {"projector.x.f", &s.projector.x->f},
      {"projector.x.u0", &s.projector.x->u0},
      {"proj_from_cam.translation_x_mm", &t[0]},
      {"proj_from_cam.translation_y_mm", &t[1]},
      {"proj_from_cam.translation_z_mm", &t[2]},
      {"camera.k1", &c.distortion[0]},
      {"camera.k2", &c.distortion[1]},
      {"camera.p1", &c.distortion[2]},
      {"camera.p2", &c.distortion[3]},
      {"projector.k1", &s.projector.distortion[0]},
      {"projector.k2", &s.projector.distortion[1]},
  };
  const auto found = named.find(name);
  return found == named.end() ? nullptr : found->second;
}

int rotation_component(const std::string& name) {
  return name.ends_with("rotation_x_rad") ? 0 : name.ends_with("rotation_y_rad") ? 1 : 2;
}

model::Scanner moved(model::Scanner s, const std::string& name, double step) {
  if (double* p = parameter(s, name)) {
    *p += step;
  } else {
    const Eigen::Vector3d w = step * Eigen::Vector3d::Unit(rotation_component(name));
    s.proj_from_cam.rotation = rotation_from_vector(w) * s.proj_from_cam.rotation;
  }
  return s;
}

Eigen::Vector3d point_of(const model::Scanner& s, const Eigen::Vector2d& pixel, double u) {
  const auto point = model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::x, pixel, u);
  EXPECT_TRUE(point);
  return point.value_or(Eigen::Vector3d::Zero());
}

TEST(CalibrationCovariance, IsTheScatterOfRepeats) {
  const model::Scanner truth = test::known_scanner();
  model::Board board = test::known_board();
  board.columns = 7;
  board.rows = 5;
  board.pitch_x_mm = board.pitch_y_mm = 40;
  board.u_print_mm = 0.010;
  board.u_pitch_relative = 1e-4;
  // Points of the measuring volume, as the true scanner sees them.
  struct Seen {
    Eigen::Vector3d point;
    Eigen::Vector2d pixel;
    double u;
  };
  std::vector<Seen> volume;
  for (const double x : {-100.0, 100.0}) {
    for (const double y : {-70.0, 70.0}) {
      for (const double z : {1020.0, 1140.0}) {
        const Eigen::Vector3d p(x, y, z);
        volume.push_back({p, *truth.camera.project(p), *truth.projector.project(CodeAxis::x, truth.proj_from_cam * p)});
      }
    }
  }
  constexpr int kRepeats = 24;
  std::vector<std::string> names;
  Eigen::VectorXd squares;
  double point_squares = 0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const auto seen =
        test::views(truth, board, 10,
                    {.print_mm = 0.010, .pitch_relative = 1e-4, .seed = 100 + static_cast<std::uint64_t>(repeat)});
    auto found = calib::calibrate(seen, board, 1392, 1040, test::known_plan(),
                                  {.camera_terms = calib::DistortionTerms::radial_tangential});
    ASSERT_TRUE(found) << found.error().sentence;
    names = found->uncertainty.names;
    const Eigen::MatrixXd& covariance = found->uncertainty.covariance;
    const auto n = static_cast<Eigen::Index>(names.size());
    if (repeat == 0) squares.setZero(n);
    // R = exp(w) R_estimate: the error of the estimate is the w that leads from the truth to it.
    const Eigen::Vector3d w =
        vector_from_rotation(found->proj_from_cam.rotation * truth.proj_from_cam.rotation.conjugate());
    model::Scanner copy = truth;
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::string& name = names[static_cast<std::size_t>(i)];
      const double* estimate = parameter(*found, name);
      const double error = estimate ? *estimate - *parameter(copy, name) : w[rotation_component(name)];
      squares[i] += error * error / covariance(i, i);
    }
    for (const Seen& s : volume) {
      const Eigen::Vector3d at = point_of(*found, s.pixel, s.u);
      Eigen::MatrixXd by(3, n);
      for (Eigen::Index i = 0; i < n; ++i) {
        const double step = 1e-3 * std::sqrt(covariance(i, i));
        const auto& name = names[static_cast<std::size_t>(i)];
        by.col(i) = (point_of(moved(*found, name, step), s.pixel, s.u) - at) / step;
      }
      const Eigen::Matrix3d u2 = by * covariance * by.transpose();
      point_squares += (at - s.point).cwiseAbs2().cwiseQuotient(u2.diagonal()).mean();
    }
  }
  // A standard deviation from 24 repeats is known to 1 / sqrt(48) = 14 %; of 18 parameters the farthest out is expected
  // at 2.3 of these; 3.5 of them are 0.5 .. 1.5.
  for (Eigen::Index i = 0; i < squares.size(); ++i) {
    const double ratio = std::sqrt(squares[i] / kRepeats);
    EXPECT_GT(ratio, 0.5) << names[static_cast<std::size_t>(i)];
    EXPECT_LT(ratio, 1.5) << names[static_cast<std::size_t>(i)];
  }
  // What the covariance is for: points triangulated through the scanner. The eight points of a calibration err
  // together, in some five independent ways (places, tilts, scale), so the mean square over 24 repeats has a relative
  // standard deviation of sqrt(2 / (24 x 5)) = 13 %, its root 6.5 %; 0.8 .. 1.2 are three of these.
  const double ratio = std::sqrt(point_squares / (kRepeats * static_cast<double>(volume.size())));
  EXPECT_GT(ratio, 0.8);
  EXPECT_LT(ratio, 1.2);
  std::printf("points: scatter over stated uncertainty %.3f\n", ratio);
}

}  // namespace
}  // namespace fringecal

// The stated covariance against the scatter of repeats, from synthetic corners that have every error the model knows.
// FRINGECAL_LONG=1: 400 calibrations instead of 40.
#include "calib/calibrate.h"
#include "calib/model/triangulate.h"
#include "core/parallel.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include <cmath>
#include <cstdlib>

namespace fringecal {
namespace {

model::Board printed_board() {
  model::Board b = test::known_board();
  b.columns = 7;
  b.rows = 5;
  b.pitch_x_mm = b.pitch_y_mm = 40;
  b.u_print_mm = 0.010;
  b.u_pitch_relative = 1e-4;
  return b;
}

/// Estimate minus truth in the order of the covariance. R = exp(w) R_estimate: the error of the estimate is the w that
/// leads from the truth to it.
Eigen::VectorXd error_of(const model::Scanner& found, const model::Scanner& truth) {
  const auto& names = found.uncertainty.names;
  const Eigen::Vector3d w =
      vector_from_rotation(found.proj_from_cam.rotation * truth.proj_from_cam.rotation.conjugate());
  Eigen::VectorXd e(static_cast<Eigen::Index>(names.size()));
  for (Eigen::Index i = 0; i < e.size(); ++i) {
    const std::string& name = names[static_cast<std::size_t>(i)];
    const auto rotation = name.find("rotation_");
    e[i] = rotation == std::string::npos ? found.value_of(name) - truth.value_of(name)
                                         : w[name[rotation + std::string("rotation_").size()] - 'x'];
  }
  return e;
}

struct Repeat {
  Eigen::VectorXd normalised;  // error over stated u, per parameter
  double mahalanobis2 = 0;     // e^T C^-1 e
  double points2 = 0;          // mean over points and coordinates of (error / u)^2
};

/// Points of the measuring volume as the true scanner sees them.
struct Seen {
  Eigen::Vector3d point;
  Eigen::Vector2d pixel;
  double u;
};

TEST(CalibrationCovariance, IsTheScatterOfRepeats) {
  const int repeats = std::getenv("FRINGECAL_LONG") ? 400 : 40;
  const model::Scanner truth = test::known_scanner();
  const model::Board board = printed_board();
  std::vector<Seen> volume;
  for (const double x : {-100.0, 100.0}) {
    for (const double y : {-70.0, 70.0}) {
      for (const double z : {1020.0, 1140.0}) {
        const Eigen::Vector3d p(x, y, z);
        volume.push_back({p, *truth.camera.project(p), *truth.projector.project(CodeAxis::x, truth.proj_from_cam * p)});
      }
    }
  }
  std::vector<Repeat> done(static_cast<std::size_t>(repeats));
  std::vector<std::string> failures(done.size()), names;
  parallel_for(repeats, [&](int k) {
    const auto at = static_cast<std::size_t>(k);
    const auto seen = test::views(truth, board, 12,
                                  {.print_mm = 0.010,
                                   .pitch_relative = 1e-4,
                                   .bow_mm = 0.05,
                                   .bend_mm = 0.02,
                                   .phase_offset_mm = 0.0003,
                                   .seed = 100 + static_cast<std::uint64_t>(k)});
    const auto found = calib::calibrate(seen, board, 1392, 1040, test::known_plan(),
                                        {.camera_terms = calib::DistortionTerms::radial_tangential});
    if (!found) {
      failures[at] = std::to_string(k) + ": " + found.error().sentence;
      return;
    }
    const Eigen::MatrixXd& covariance = found->uncertainty.covariance;
    const Eigen::VectorXd e = error_of(*found, truth), u = covariance.diagonal().cwiseSqrt();
    Repeat& r = done[at];
    r.normalised = e.cwiseQuotient(u);
    r.mahalanobis2 = e.dot(covariance.ldlt().solve(e));
    const auto point_of = [&](const model::Scanner& s, const Seen& v) {
      const auto p = model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::x, v.pixel, v.u);
      return p.value_or(Eigen::Vector3d::Zero());
    };
    for (const Seen& v : volume) {
      const Eigen::Vector3d place = point_of(*found, v);
      Eigen::MatrixXd by(3, e.size());
      for (Eigen::Index i = 0; i < e.size(); ++i) {
        const double step = 1e-3 * u[i];
        by.col(i) = (point_of(found->changed_by(step * Eigen::VectorXd::Unit(e.size(), i)), v) - place) / step;
      }
      const Eigen::Matrix3d u2 = by * covariance * by.transpose();
      r.points2 +=
          (place - v.point).cwiseAbs2().cwiseQuotient(u2.diagonal()).mean() / static_cast<double>(volume.size());
    }
    if (k == 0) names = found->uncertainty.names;
  });
  for (const auto& f : failures) EXPECT_EQ(f, "");
  ASSERT_FALSE(HasFailure()) << "every calibration has a result";

  const auto n = static_cast<Eigen::Index>(names.size());
  Eigen::VectorXd squares = Eigen::VectorXd::Zero(n), within = Eigen::VectorXd::Zero(n);
  double points2 = 0, mahalanobis2 = 0;
  for (const Repeat& r : done) {
    squares += r.normalised.cwiseAbs2() / repeats;
    within += (r.normalised.cwiseAbs().array() < 1.96).cast<double>().matrix() / repeats;
    points2 += r.points2 / repeats;
    mahalanobis2 += r.mahalanobis2 / (repeats * static_cast<double>(n));
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    std::printf("%-34s normalised sd %.3f, within 1.96 u: %.1f %%\n", names[static_cast<std::size_t>(i)].c_str(),
                std::sqrt(squares[i]), 100 * within[i]);
  }
  // All together is printed, not judged: along the softest combinations the solution curves by more than the standard
  // deviation of the stiffest ones (calibrate.h); with a tenth of the noise the figure is 1.
  std::printf("%d calibrations: points %.3f, all together %.3f, mean coverage %.2f %%\n", repeats, std::sqrt(points2),
              std::sqrt(mahalanobis2), 100 * within.mean());

  // A standard deviation from N repeats is known to 1 / sqrt(2 N): 11 % of 40, 3.5 % of 400. Of 18 parameters the farthest
  // out is expected at 2.1 of these; 3.3 of them are asked (0.1 % each).
  const double sd_of_sd = 1.0 / std::sqrt(2.0 * repeats);
  for (Eigen::Index i = 0; i < n; ++i) {
    EXPECT_NEAR(std::sqrt(squares[i]), 1.0, 3.3 * sd_of_sd) << names[static_cast<std::size_t>(i)];
  }
  // What the covariance is for: points triangulated through the scanner. The eight points of a calibration err together, in
  // some five independent ways (places, tilts, scale).
  EXPECT_NEAR(std::sqrt(points2), 1.0, 3.3 / std::sqrt(2.0 * 5.0 * repeats));
  // 95 % regions of single parameters: the share within 1.96 u over all parameters and repeats. 18 N readings in some ten
  // independent ways have a standard deviation of sqrt(0.05 x 0.95 / (10 N)): 0.34 % at 400; 2 % is what is asked, 3 of
  // them where there are fewer repeats.
  EXPECT_NEAR(within.mean(), 0.95, std::max(0.02, 3.0 * std::sqrt(0.05 * 0.95 / (10.0 * repeats))));
}

}  // namespace
}  // namespace fringecal

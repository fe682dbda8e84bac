// A flat beside the board: what it does to a measured plane, and whether the stated uncertainty says so. Synthetic corners with
// every error the model knows, flats that are bowed within their certificate. FRINGECAL_LONG=1: 200 instruments instead of 8.
#include "calib/flat_witness.h"
#include "calib/calibrate.h"
#include "calib/model/triangulate.h"
#include "core/parallel.h"
#include "fitting/fit.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>

namespace fringecal {
namespace {

constexpr double kFlatness_mm = 0.005;

/// Pixels of a bowed plate at a pose (its z away from the camera), as the true scanner reads them.
model::BoardObservation flat_at(const model::Scanner& truth, const Rigid3& cam_from_flat, const Eigen::Vector3d& bow_mm,
                                double offset_mm) {
  model::BoardObservation out{"flat", {}};
  const Eigen::Matrix3d axes = cam_from_flat.rotation_matrix();
  for (int row = 0; row < 22; ++row) {
    for (int column = 0; column < 29; ++column) {
      model::CornerObservation cell;
      cell.column = column;
      cell.row = row;
      cell.pixel = {24.0 + 48 * column, 24.0 + 47 * row};
      const Eigen::Vector3d ray = *truth.camera.ray(cell.pixel);
      Eigen::Vector3d at;
      double height = 0;
      for (int pass = 0; pass < 3; ++pass) {
        at = (axes.col(2).dot(cam_from_flat.translation_mm) + height) / axes.col(2).dot(ray) * ray;
        const Eigen::Vector2d e =
            (axes.transpose() * (at - cam_from_flat.translation_mm)).head<2>() / 250.0;  // half the field's diagonal
        height = bow_mm.dot(Eigen::Vector3d(e.x() * e.x(), e.y() * e.y(), e.x() * e.y()));
      }
      cell.x = Uncertain{*truth.projector.project(CodeAxis::x, truth.proj_from_cam * at) + offset_mm, 1e-5};
      out.corners.push_back(cell);
    }
  }
  return out;
}

Rigid3 facing(double distance_mm, double turn_rad) {
  return {rotation_from_vector({0.3 * turn_rad, turn_rad, 0}), {0, 0, distance_mm}};
}

/// Deviations of a true plane from the plane through what a scanner makes of it.
std::vector<double> deviations(const model::Scanner& s, const model::BoardObservation& plane) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& c : plane.corners) {
    points.push_back(
        model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::x, c.pixel, c.x->value).value());
  }
  const auto fit = fitting::fit_plane(points);
  return {fit->quality.distances_mm.begin(), fit->quality.distances_mm.end()};
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// What the covariance says rms() should be: the root of the mean variance of the deviations.
double stated_rms(const model::Scanner& s, const model::BoardObservation& plane) {
  const auto here = deviations(s, plane);
  const Eigen::Index n = s.uncertainty.covariance.rows();
  Eigen::MatrixXd by(static_cast<Eigen::Index>(here.size()), n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double step = 0.1 * std::sqrt(s.uncertainty.covariance(i, i));
    const auto there = deviations(s.changed_by(step * Eigen::VectorXd::Unit(n, i)), plane);
    for (std::size_t k = 0; k < here.size(); ++k) by(static_cast<Eigen::Index>(k), i) = (there[k] - here[k]) / step;
  }
  return std::sqrt((by * s.uncertainty.covariance).cwiseProduct(by).rowwise().sum().mean());
}

TEST(FlatWitness, StraightensSpaceAsFarAsItsCertificateAllows) {
  const int repeats = std::getenv("FRINGECAL_LONG") ? 200 : 8;
  const model::Scanner truth = test::known_scanner();
  model::Board board = test::known_board();
  board.u_print_mm = 0.010;
  board.u_pitch_relative = 1e-4;
  const auto plane = flat_at(truth, facing(1090, 0.2), Eigen::Vector3d::Zero(), 0.0);  // another place, another plate
  std::vector<double> without(static_cast<std::size_t>(repeats)), with = without, normalised = without;
  std::vector<std::string> failures(without.size());
  parallel_for(repeats, [&](int k) {
    const auto at = static_cast<std::size_t>(k);
    std::mt19937_64 engine(900 + static_cast<std::uint64_t>(k));
    const auto uniform = [&] { return static_cast<double>(engine() >> 11) * 0x1.0p-52 - 1.0; };
    const auto seen = test::views(truth, board, 15,
                                  {.u_pixel_px = 0.006,
                                   .u_coordinate_mm = 6e-5,
                                   .print_mm = 0.010,
                                   .bow_mm = 0.1,
                                   .phase_offset_mm = 0.0002,
                                   .seed = 700 + static_cast<std::uint64_t>(k)});
    calib::CalibrationOptions options{.camera_terms = calib::DistortionTerms::radial_tangential};
    const auto corners_alone = calib::calibrate(seen, board, 1392, 1040, test::known_plan(), options);
    const Eigen::Vector3d bow = kFlatness_mm * Eigen::Vector3d{uniform(), uniform(), uniform()};
    for (int view = 0; view < 4; ++view) {
      options.flats.push_back(flat_at(truth, facing(1077, 0.001 * view), bow, 0.00035 * uniform()));
      for (auto& c : options.flats.back().corners) {  // noise of 1e-5: the sum of twelve even draws
        for (int i = 0; i < 12; ++i) c.x->value += 0.5e-5 * uniform();
      }
    }
    options.u_flatness_mm = calib::u_flatness_mm(kFlatness_mm);
    const auto both = calib::calibrate(seen, board, 1392, 1040, test::known_plan(), options);
    if (!corners_alone || !both) {
      failures[at] = (corners_alone ? both : corners_alone).error().sentence;
      return;
    }
    without[at] = rms(deviations(*corners_alone, plane));
    with[at] = rms(deviations(*both, plane));
    normalised[at] = with[at] / stated_rms(*both, plane);
    if (both->flats.size() != 4 || both->cam_from_flat.size() != 4) failures[at] = "the views are not kept";
  });
  for (const auto& f : failures) ASSERT_EQ(f, "");
  std::printf(
      "%d instruments: a plane's deviation %.4f mm rms by corners alone, %.4f with the flat; over stated %.3f\n",
      repeats, rms(without), rms(with), rms(normalised));
  EXPECT_LT(rms(with), 0.7 * rms(without));
  // What is left are the three terms of the plate's own bow and little else: 3 N squares, with a standard deviation of
  // sqrt(2 / 3 N) for their mean, half of it for its root; three of these. A uniform bow scatters less than that.
  EXPECT_NEAR(rms(normalised), 1.0, 3.0 * 0.5 * std::sqrt(2.0 / (3.0 * repeats)) + 0.05);
}

TEST(FlatWitness, RefusesACaptureWithoutFringes) {
  Capture dark;
  dark.info.width_px = 64;
  dark.info.height_px = 48;
  const auto view = calib::observe_flat(dark, "dark");
  ASSERT_FALSE(view);
  EXPECT_NE(view.error().sentence.find("flat plate"), std::string::npos) << view.error().sentence;
}

}  // namespace
}  // namespace fringecal

// The paper's parameters from a board moved by known steps: readings are made here, by rays through a Scanner's lenses
// (calib/model), of a board that is bowed, misprinted and moved not quite squarely.
// FRINGECAL_LONG=1: 400 repeats instead of 24.
#include "calib/stepped_board.h"

#include "calib/reference_phase.h"
#include "core/parallel.h"
#include "tests/metrology/exact_phase_map.h"
#include "tests/support/long_tests.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fringecal::calib {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

model::Board board_with(double u_print_mm) {
  model::Board b;
  b.columns = 7;
  b.rows = 6;
  b.pitch_x_mm = b.pitch_y_mm = 40;
  b.u_print_mm = u_print_mm;
  b.u_pitch_relative = 1e-5;
  return b;
}

/// What is wrong with the readings: multiples of what SteppedUncertainty and the board state, and the bow in mm.
struct Wrong {
  double noise = 0, bow_mm = 0;
  unsigned seed = 1;
};

SteppedBoard stepped_readings(const model::Scanner& s, const Wrong& wrong) {
  std::mt19937_64 engine(wrong.seed);
  std::normal_distribution<double> unit;
  const auto draw = [&](double sd) { return wrong.noise * sd * unit(engine); };
  SteppedBoard out;
  out.board = board_with(0.01);
  // A reading's pixel of 1.4 mm here: 0.005 px are 7 um, as 0.03 px of the paper's camera.
  out.u.pixel_px = 0.005;
  out.u.phase_rad = 0.01;
  const Rigid3 world_from_cam = s.world_from_cam(), proj_from_world = s.world_from_proj().inverse();
  const Vector3d eye = world_from_cam.translation_mm;
  const Eigen::Rotation2Dd turn(0.02);
  const Vector2d at(3, -2), half(120, 100), square(draw(out.u.square_rad), draw(out.u.square_rad));
  const double scale = 1 + draw(out.board.u_pitch_relative);
  std::vector<Vector2d> corners;
  for (int row = 0; row < out.board.rows; ++row) {
    for (int column = 0; column < out.board.columns; ++column) {
      const Vector2d e(draw(out.board.u_print_mm), draw(out.board.u_print_mm));
      corners.push_back(scale * (Vector2d(40.0 * column, 40.0 * row) - half + e));
    }
  }
  // The board's rows run against Y, as a picture's do.
  const auto world_xy = [&](const Vector2d& on_board) {
    return Vector2d(at + turn * Vector2d(on_board.x(), -on_board.y()));
  };
  const auto height = [&](const Vector2d& xy) {
    const Vector2d p = (turn.inverse() * (xy - at)).cwiseQuotient(half);
    return wrong.bow_mm * p.squaredNorm();
  };
  // Where the ray through a pixel meets the bowed board whose middle stands at z.
  const auto hit = [&](const Vector2d& pixel, double z) {
    const Vector3d direction = world_from_cam.rotation * *s.camera.ray(pixel);
    Vector3d p = eye;
    for (int i = 0; i < 8; ++i) p = eye + (z + height(p.head<2>() - z * square) - eye.z()) / direction.z() * direction;
    return p;
  };
  const auto phase = [&](const Vector3d& p) {
    return s.projector.x->code.phase_from_u(*s.projector.project(CodeAxis::x, proj_from_world * p));
  };
  const double offset_of_reference = draw(out.u.phase_offset_rad);
  for (const double z : {-75.0, -50.0, -25.0, 0.0, 25.0, 50.0, 75.0}) {
    const int step = static_cast<int>(out.z_mm.size());
    out.z_mm.push_back(z);
    const double offset = z == 0 ? offset_of_reference : draw(out.u.phase_offset_rad);
    const double true_z = z == 0 ? 0 : z + draw(out.u.step_mm);
    for (int row = 0; row < out.board.rows; ++row) {
      for (int column = 0; column < out.board.columns; ++column) {
        const Vector2d on = world_xy(corners[static_cast<std::size_t>(row * out.board.columns + column)]);
        const Vector2d xy = on + true_z * square;
        const Vector3d p(xy.x(), xy.y(), true_z + height(on));
        const Vector2d pixel =
            *s.camera.project(world_from_cam.inverse() * p) + Vector2d(draw(out.u.pixel_px), draw(out.u.pixel_px));
        // Phases are read at the pixel as found, whatever is there.
        out.readings.push_back({step, column, row, pixel, phase(hit(pixel, true_z)) + offset + draw(out.u.phase_rad),
                                phase(hit(pixel, 0)) + offset_of_reference + draw(out.u.phase_rad)});
      }
    }
  }
  return out;
}

/// The paper's geometry with the default instrument's lenses.
model::Scanner distorted() {
  model::Scanner s = test::ideal_scanner();
  s.camera.distortion = {-0.10, 0.06, 0, 0, 0};
  s.projector.distortion = {-0.08, 0.03, 0, 0, 0};
  return s;
}

TEST(SteppedBoard, GivesTheGeometryBackWhereItIsThePapers) {
  const model::Scanner s = test::ideal_scanner();
  const model::Chen2008Model truth = model::chen2008_from(s);
  model::Chen2008Model start = truth;
  start.L_mm *= 1.01;
  start.b_mm *= 0.98;
  start.alpha_rad += 0.01;
  start.p_R_mm *= 1.01;
  start.phi_O_rad += 0.5;
  const auto found = fit_stepped_board(stepped_readings(s, {}), start);
  ASSERT_TRUE(found) << found.error().sentence;
  // Rounding of the readings, 1e-12 of 1000 mm, times what the covariance amplifies: u(L) of some 0.3 mm from 0.01 mm. The
  // priors hold nothing off: all that they hold is zero in truth.
  EXPECT_NEAR(found->model.L_mm, truth.L_mm, 1e-5);
  EXPECT_NEAR(found->model.b_mm, truth.b_mm, 1e-5);
  EXPECT_NEAR(found->model.alpha_rad, truth.alpha_rad, 1e-7);
  EXPECT_NEAR(found->model.p_R_mm, truth.p_R_mm, 1e-7);
  EXPECT_NEAR(found->model.phi_O_rad, truth.phi_O_rad, 1e-5);
  EXPECT_NEAR(found->model.kc1_per_mm2, 0, 1e-9);
  EXPECT_NEAR(found->model.kp1_per_mm2, 0, 1e-12);
  EXPECT_LT(found->rms_xyz_mm.norm(), 1e-6);
}

TEST(SteppedBoard, ErrsAsItsCovarianceSays) {
  const int repeats = test::long_tests() ? 400 : 24;
  const model::Scanner s = distorted();
  const model::Chen2008Model start = model::chen2008_from(s);
  // What the estimate errs about: the closed form's own best on the same readings without error.
  const auto truth = fit_stepped_board(stepped_readings(s, {.bow_mm = 0.1}), start);
  ASSERT_TRUE(truth) << truth.error().sentence;
  std::vector<Eigen::Matrix<double, 9, 1>> z(static_cast<std::size_t>(repeats), Eigen::Matrix<double, 9, 1>::Zero());
  std::vector<std::string> failures(z.size());
  parallel_for(repeats, [&](int k) {
    const auto at = static_cast<std::size_t>(k);
    const auto found = fit_stepped_board(
        stepped_readings(s, {.noise = 1, .bow_mm = 0.1, .seed = 10 + static_cast<unsigned>(k)}), start);
    if (!found) {
      failures[at] = found.error().sentence;
      return;
    }
    z[at] = (found->values - truth->values).cwiseQuotient(found->covariance.diagonal().cwiseSqrt());
  });
  for (const auto& f : failures) ASSERT_EQ(f, "");
  for (std::size_t i = 0; i < kSteppedNames.size(); ++i) {
    double squares = 0;
    for (const auto& one : z) squares += one[static_cast<Eigen::Index>(i)] * one[static_cast<Eigen::Index>(i)];
    const double sd = std::sqrt(squares / repeats);
    std::printf("%-12s u = %.3g, normalised sd %.3f\n", kSteppedNames[i],
                std::sqrt(truth->covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i))), sd);
    // A standard deviation from N repeats is known to 1 / sqrt(2 N); 3.3 of these, for nine parameters.
    EXPECT_NEAR(sd, 1.0, 3.3 / std::sqrt(2.0 * repeats)) << kSteppedNames[i];
  }
}

TEST(SteppedBoard, DiffersFromTheFullModelByWhatBothAreUncertainBy) {
  // A geometry that is not the paper's (a turned camera, tangential terms), and a full model that is off by two of its
  // standard uncertainties in L's and p_R's ingredients: the difference has its sign and is within 4 of its u.
  const model::Scanner truth = test::sample_scanner();
  model::Scanner full = truth;
  full.uncertainty.names = {"projector.x.f", "projector.x.u0", "proj_from_cam.translation_x_mm"};
  full.uncertainty.covariance = Eigen::Vector3d(4e-4, 1e-6, 0.01).asDiagonal();
  full = full.changed_by(Eigen::Vector3d(0.04, 0, 0));
  const auto found = compare_stepped_board(stepped_readings(truth, {.noise = 1, .bow_mm = 0.1, .seed = 3}), full);
  ASSERT_TRUE(found) << found.error().sentence;
  for (std::size_t i = 0; i < kSteppedNames.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    std::printf("%-12s direct %.8g, computed %.8g, difference / u %+.2f\n", kSteppedNames[i], found->direct.values[k],
                found->computed.values[k], found->difference[k] / found->u_difference[k]);
    EXPECT_LT(std::abs(found->difference[k]), 4 * found->u_difference[k]) << kSteppedNames[i];
  }
  // A longer f shrinks p_R = L p / f: by 0.04 / 32 at the same L, and u(f) of half of that is in the computed one.
  EXPECT_LT(found->computed.values[3], found->direct.values[3]);
  EXPECT_GT(found->computed.covariance(3, 3), 0);
}

TEST(ReferencePhase, IsNotMisledByThePrintsEdges) {
  // A phase in perspective over a chessboard of 40 px squares; within 2 px of an edge it is read 0.05 rad too large, as it is
  // where blur mixes dark and bright. Without noise what is left is the truncation at degree 7, 0.03^8 of 150 rad, and the
  // float of the map, 1.5e-5 rad at 150 rad, averaged.
  decode::PhaseMap map;
  map.code = {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
  constexpr int kWidth = 600, kHeight = 500;
  map.phase_rad = map.mean = map.u_phase_rad = Image<float>(kWidth, kHeight);
  map.validity = Image<std::uint8_t>(kWidth, kHeight);
  const auto truth = [](double x, double y) { return 0.25 * x / (1 + 1e-4 * x + 5e-5 * y); };
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool edge = std::min(x % 40, 39 - x % 40) < 2 || std::min(y % 40, 39 - y % 40) < 2;
      const bool white = (x / 40 + y / 40) % 2 == 0;
      map.mean(x, y) = white ? 150.0F : 20.0F;
      map.u_phase_rad(x, y) = white ? 0.01F : 0.2F;
      map.phase_rad(x, y) = static_cast<float>(truth(x, y) + (edge ? 0.05 : 0.0));
    }
  }
  const auto found = ReferencePhase::fit(map);
  ASSERT_TRUE(found) << found.error().sentence;
  int covered = 0;
  for (int y = 20; y < kHeight - 20; y += 13) {
    for (int x = 20; x < kWidth - 20; x += 13) {
      if (!found->covers(Vector2d(x, y))) continue;
      ++covered;
      EXPECT_NEAR(found->at_rad(Vector2d(x, y)), truth(x, y), 5e-5) << x << ", " << y;
    }
  }
  EXPECT_GT(covered, 1000);
}

TEST(SteppedBoard, RefusesTwoSteps) {
  auto readings = stepped_readings(test::ideal_scanner(), {});
  std::erase_if(readings.readings, [](const auto& r) { return r.step > 1; });
  readings.z_mm = {0, 20};
  const auto found = fit_stepped_board(readings, model::chen2008_from(test::ideal_scanner()));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, ::testing::HasSubstr("at least 3 steps"));
}

}  // namespace
}  // namespace fringecal::calib

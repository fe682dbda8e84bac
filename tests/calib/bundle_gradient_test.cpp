// The derivatives that bundle_rows.cpp writes out, against numeric ones; and the step of the eliminated system against
// the dense one.
#include "calib/bundle_rows.h"
#include "calib/bundle_system.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include <functional>

namespace fringecal::calib {
namespace {

FringeCode grating() {
  return {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
}

/// Nine corners, two poses, all terms away from zero, readings off by up to a few of their uncertainties.
Bundle sample() {
  Bundle b;
  b.camera = {.width_px = 1392,
              .height_px = 1040,
              .fx_px = 3721,
              .fy_px = 3719,
              .cx_px = 708,
              .cy_px = 512,
              .distortion = {-0.1, 0.06, 2e-4, -1.5e-4, 0.3}};
  b.projector.emplace();
  b.projector->x = model::ProjectorAxis{grating(), 32, 7.8};
  b.projector->y = model::ProjectorAxis{grating(), 31, 7.2};
  b.projector->distortion = {-0.08, 0.03, 1e-4, 2e-4, 0.1};
  b.proj_from_cam = {rotation_from_vector({0.1, 0.4, -0.05}), {400, 3, 1}};
  for (int i = 0; i < 9; ++i) b.targets_mm.emplace_back(60.0 * (i % 3), 50.0 * (i / 3));
  b.cam_from_board = {{rotation_from_vector({0.3, -0.2, 0.1}), {-60, -40, 1000}},
                      {rotation_from_vector({-0.2, 0.4, 0.0}), {-40, -60, 1100}}};
  b.pitch_error = 1e-4;
  b.bow_mm = {0.1, -0.05, 0.03};
  b.bend_mm = {{0.01, 0.02, -0.03}, {-0.02, 0.01, 0.02}};
  b.phase_offset = {{1e-4, -2e-4}, {3e-4, 1e-4}};
  for (int i = 0; i < 9; ++i) b.print_mm.emplace_back(0.01 * (i % 2), -0.02 + 0.005 * i, 0.01 * (i % 3));
  const auto shapes = rows::bow_shapes(b);
  for (int pose = 0; pose < 2; ++pose) {
    for (int i = 0; i < 9; ++i) {
      Sight s{pose, i, {0, 0}, 0.05, Uncertain{0, 0.001}, Uncertain{0, 0.001}, true};
      rows::SightRows r;
      EXPECT_TRUE(rows::evaluate(b, rows::frame_of(b, static_cast<std::size_t>(pose)),
                                 shapes[static_cast<std::size_t>(i)], s, rows::With::residuals, r));
      s.pixel = {r.row[0].residual + 0.03 * (i % 4 - 1), r.row[1].residual - 0.04 * (i % 3)};
      s.x->value = r.row[2].residual + 0.0005 * (i % 5);
      s.y->value = r.row[3].residual - 0.0004 * (i % 3);
      b.sights.push_back(s);
    }
  }
  rows::set_slopes(b);
  return b;
}

/// Adds h to the unknown of a column, as the sight of pose 0, target 5 sees it.
void move(Bundle& b, int column, double h) {
  const auto at = [&](int first) { return static_cast<std::size_t>(column - first); };
  const auto turn = [&](Eigen::Quaterniond& q, int first) {
    q = rotation_from_vector(h * Eigen::Vector3d::Unit(column - first)) * q;
  };
  double* const camera[] = {&b.camera.fx_px, &b.camera.fy_px, &b.camera.cx_px, &b.camera.cy_px};
  double* const axis[] = {&b.projector->x->f, &b.projector->x->u0, &b.projector->y->f, &b.projector->y->u0};
  if (column < rows::kCameraK) {
    *camera[column] += h;
  } else if (column < rows::kAxis) {
    b.camera.distortion[at(rows::kCameraK)] += h;
  } else if (column < rows::kProjectorK) {
    *axis[at(rows::kAxis)] += h;
  } else if (column < rows::kProjectorW) {
    b.projector->distortion[at(rows::kProjectorK)] += h;
  } else if (column < rows::kProjectorT) {
    turn(b.proj_from_cam.rotation, rows::kProjectorW);
  } else if (column < rows::kPitch) {
    b.proj_from_cam.translation_mm[column - rows::kProjectorT] += h;
  } else if (column < rows::kBow) {
    b.pitch_error += h;
  } else if (column < rows::kFlatBow) {
    b.bow_mm[column - rows::kBow] += h;
  } else if (column < rows::kDense) {
    b.flat_bow_mm[column - rows::kFlatBow] += h;
  } else if (column < rows::kPoseT) {
    turn(b.cam_from_board[0].rotation, rows::kPoseW);
  } else if (column < rows::kOffset) {
    b.cam_from_board[0].translation_mm[column - rows::kPoseT] += h;
  } else if (column < rows::kBend) {
    b.phase_offset[0][column - rows::kOffset] += h;
  } else if (column < rows::kPoseEnd) {
    b.bend_mm[0][column - rows::kBend] += h;
  } else {
    b.print_mm[5][column - rows::kPrint] += h;
  }
}

TEST(BundleGradient, OfEveryColumnIsTheNumericOne) {
  const Bundle b = sample();
  const Eigen::Vector3d shape = rows::bow_shapes(b)[5];
  rows::SightRows analytic;
  ASSERT_TRUE(rows::evaluate(b, rows::frame_of(b, 0), shape, b.sights[5], rows::With::derivatives, analytic));
  for (int column = 0; column < rows::kColumns; ++column) {
    const auto difference = [&](double h) {
      std::array<double, 4> out{};
      for (const double sign : {1.0, -1.0}) {
        Bundle moved = b;
        move(moved, column, sign * h);
        rows::SightRows r;
        EXPECT_TRUE(rows::evaluate(moved, rows::frame_of(moved, 0), shape, b.sights[5], rows::With::residuals, r));
        for (std::size_t k = 0; k < 4; ++k) out[k] += sign * r.row[k].residual / (2.0 * h);
      }
      return out;
    };
    // Central differences at h and h/2, extrapolated: the error is of order h^4 and the rounding of residuals of 1e3 px
    // (or 10 mm), 1e-13, over h. With h = 1e-3 of parameters of order 1 that is 1e-10 of the largest derivatives, which are
    // up to 4e3 px.
    const double h = 1e-3;
    const auto coarse = difference(h), fine = difference(0.5 * h);
    for (std::size_t k = 0; k < 4; ++k) {
      const double numeric = (4.0 * fine[k] - coarse[k]) / 3.0,
                   written = analytic.row[k].by[static_cast<std::size_t>(column)];
      EXPECT_NEAR(written, numeric, 1e-8 * std::max(std::abs(numeric), k < 2 ? 10.0 : 0.1))
          << "row " << k << ", column " << column;
    }
  }
}

TEST(BundleRows, ReadThePhaseWhereTheCornerWasFound) {
  // A corner misprinted within the board's face moves the pixel and, by the slope times that, the phase: the projector's rows
  // do not notice in first order. What is left is of second order: four times as much for twice the misprint, up to third
  // order, 0.04 mm of 1000 mm.
  const auto rows_of = [](double misprint_mm) {
    Bundle b = sample();
    b.print_mm[5].head<2>() += misprint_mm * Eigen::Vector2d(1, -0.5);
    rows::SightRows r;
    EXPECT_TRUE(rows::evaluate(b, rows::frame_of(b, 0), rows::bow_shapes(b)[5], b.sights[5], rows::With::residuals, r));
    return r;
  };
  const auto none = rows_of(0), once = rows_of(0.02), twice = rows_of(0.04);
  EXPECT_GT(std::abs(once.row[0].residual - none.row[0].residual), 0.05);
  for (const std::size_t k : {2U, 3U}) {
    const double change = once.row[k].residual - none.row[k].residual;
    EXPECT_NEAR(twice.row[k].residual - none.row[k].residual, 4 * change, 1e-3 * std::abs(change)) << "row " << k;
  }
}

TEST(BundleGradient, OfASightOnAFlatIsTheNumericOne) {
  Bundle b = sample();
  b.flats = 2;  // its poses, taken as a plate's
  b.flat_half_mm = 150;
  b.flat_bow_mm = {0.02, -0.01, 0.015};
  Sight s{0, kOnFlat, {820, 330}, 1.0, Uncertain{7.0, 0.001}, Uncertain{7.5, 0.001}, true};
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  rows::SightRows analytic;
  ASSERT_TRUE(rows::evaluate(b, rows::frame_of(b, 0), none, s, rows::With::derivatives, analytic));
  EXPECT_FALSE(analytic.has[0] || analytic.has[1]) << "the camera is not asked: the pixel is exact";
  for (int column = 0; column < rows::kColumns; ++column) {
    std::array<double, 4> numeric{};
    const double h = 1e-4;
    for (const double sign : {1.0, -1.0}) {
      Bundle moved = b;
      move(moved, column, sign * h);
      rows::SightRows r;
      ASSERT_TRUE(rows::evaluate(moved, rows::frame_of(moved, 0), none, s, rows::With::residuals, r));
      for (std::size_t k = 2; k < 4; ++k) numeric[k] += sign * r.row[k].residual / (2.0 * h);
    }
    for (const std::size_t k : {2U, 3U}) {
      // Written out, the slope of the bow, 2 x 0.02 / 150 = 3e-4 of the plate's own, is left out of the place's derivative.
      const double written = analytic.row[k].by[static_cast<std::size_t>(column)];
      EXPECT_NEAR(written, numeric[k], 1e-3 * std::max(std::abs(numeric[k]), 1e-3))
          << "row " << k << ", column " << column;
    }
  }
}

TEST(BundleRows, AreNotThereForAPointBehindTheLens) {
  Bundle b = sample();
  b.cam_from_board[0].translation_mm.z() = -500;
  rows::SightRows r;
  EXPECT_FALSE(rows::evaluate(b, rows::frame_of(b, 0), rows::bow_shapes(b)[5], b.sights[5], rows::With::residuals, r));
}

TEST(BundleSystem, LeveragesOfReadingsAndComponentsAddUpToTheUnknowns) {
  const Bundle b = sample();
  const Components c{
      .print_mm = 0.01, .relief_mm = 0.01, .bend_mm = 0.02, .phase_offset = 1e-3, .pitch = 1e-4, .bow_mm = 0.1};
  BundleSystem system(b, {DistortionTerms::radial, DistortionTerms::radial}, c);
  ASSERT_TRUE(system.linearise(b));
  const auto posterior = system.posterior(b);
  ASSERT_TRUE(posterior) << posterior.error().sentence;
  // tr(N^-1 J^T J) over all rows, the priors' among them, is the number of unknowns: lenses 6 + 6, relative pose 6, pitch
  // 1, bow 3, 2 x (6 pose + 2 offsets + 3 bends), 27 of corners. A prior's leverage is posterior / prior variance.
  double sum = 0;
  for (const auto& r : posterior->readings) sum += r.leverage;
  for (const Scatter* s : {&posterior->print, &posterior->relief, &posterior->bend, &posterior->phase_offset})
    sum += s->count - s->redundancy;
  const auto& names = system.names();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double sd = names[i] == "board scale" ? c.pitch : names[i].starts_with("board") ? c.bow_mm : 0.0;
    if (sd > 0) sum += posterior->shared(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) / (sd * sd);
  }
  // The condition of the scaled normal equations of two poses and nine corners, some 1e8, times the rounding.
  EXPECT_NEAR(sum, 6 + 6 + 6 + 1 + 3 + 2 * 11 + 27, 1e-5);
}

TEST(BundleSystem, UndampedStepsReachAStationaryPoint) {
  Bundle b = sample();
  const Components c{
      .print_mm = 0.01, .relief_mm = 0.01, .bend_mm = 0.02, .phase_offset = 1e-3, .pitch = 1e-4, .bow_mm = 0.1};
  BundleSystem system(b, {DistortionTerms::radial, DistortionTerms::radial}, c);
  double decrement2 = 1;
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(system.linearise(b));
    const auto step = system.newton(0.0);
    ASSERT_TRUE(step);
    decrement2 = -system.slope(*step);
    b = system.moved(b, *step, 1.0);
  }
  // Newton's decrement at the minimum: rounding of a cost of order 10.
  EXPECT_LT(decrement2, 1e-12);
}

}  // namespace
}  // namespace fringecal::calib

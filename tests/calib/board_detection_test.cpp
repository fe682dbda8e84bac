// Boards rendered through a known homography, and phase maps of a known plane.
#include "calib/board_detection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <numbers>
#include <random>

namespace fringecal {
namespace {

/// pixel <- board (mm), a board tilted by some 30 degrees.
Eigen::Matrix3d homography(double turn_rad = 0.1) {
  Eigen::Matrix3d perspective, turn, place;
  perspective << 2.6, 0.05, 0, -0.1, 2.2, 0, 4e-4, 7e-4, 1;
  turn << std::cos(turn_rad), -std::sin(turn_rad), 0, std::sin(turn_rad), std::cos(turn_rad), 0, 0, 0, 1;
  place << 1, 0, 320.3, 0, 1, 240.7, 0, 0, 1;
  return place * turn * perspective;
}

Eigen::Vector2d map(const Eigen::Matrix3d& h, const Eigen::Vector2d& p) {
  return (h * Eigen::Vector3d(p.x(), p.y(), 1.0)).hnormalized();
}

model::Board board_of(model::BoardKind kind, int columns, int rows) {
  model::Board b;
  b.kind = kind;
  b.columns = columns;
  b.rows = rows;
  b.pitch_x_mm = 20;
  b.pitch_y_mm = kind == model::BoardKind::asymmetric_circles ? 10 : 20;
  return b;
}

Eigen::Vector2d middle_of(const model::Board& b) { return 0.5 * b.corner_mm(b.columns - 1, b.rows - 1).head<2>(); }

/// 640 x 480, 8 x 8 samples per pixel (a box of one pixel for a blur), noise of one grey level, 16 bit from 8 x 256.
GrayImage render(const model::Board& b, const Eigen::Matrix3d& h) {
  const Eigen::Matrix3d back = h.inverse();
  const Eigen::Vector2d middle = middle_of(b);
  Image16 image(640, 480);
  std::mt19937 random(5);
  const auto shade = [&](const Eigen::Vector2d& on_board) {
    const Eigen::Vector2d p = on_board + middle;
    if (b.kind == model::BoardKind::chessboard) {
      const int i = static_cast<int>(std::floor(p.x() / b.pitch_x_mm)), j = static_cast<int>(std::floor(p.y() / b.pitch_y_mm));
      if (i < -1 || j < -1 || i >= b.columns || j >= b.rows) return 200.0;
      return (i + j) % 2 == 0 ? 40.0 : 200.0;
    }
    for (int row = 0; row < b.rows; ++row) {
      for (int column = 0; column < b.columns; ++column) {
        if ((b.corner_mm(column, row).head<2>() - p).norm() < 5.0) return 40.0;
      }
    }
    return 200.0;
  };
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      double sum = 0;
      for (int k = 0; k < 64; ++k) {
        sum += shade(map(back, {x + (k % 8 - 3.5) / 8, y + (k / 8 - 3.5) / 8}));  // NOLINT: whole eighths
      }
      double noise = -6;
      for (int k = 0; k < 12; ++k) noise += static_cast<double>(random()) / 4294967296.0;
      image(x, y) = static_cast<std::uint16_t>(std::lround(256.0 * (sum / 64 + noise)));
    }
  }
  return image;
}

/// Root mean square distance of the corners from the truth, per coordinate.
double rms_px(const model::BoardObservation& o, const model::Board& b, const Eigen::Matrix3d& h) {
  double sum = 0;
  for (const auto& c : o.corners) {
    sum += (c.pixel - map(h, b.corner_mm(c.column, c.row).head<2>() - middle_of(b))).squaredNorm();
  }
  return std::sqrt(sum / (2.0 * static_cast<double>(o.corners.size())));
}

TEST(DetectBoard, FindsTheCornersOfAChessboard) {
  const auto b = board_of(model::BoardKind::chessboard, 9, 7);
  const auto found = calib::detect_board(render(b, homography()), b);
  ASSERT_TRUE(found) << found.error().sentence;
  ASSERT_EQ(found->corners.size(), 63u);
  // Noise alone: one edge of 15 px with a step of 160 and a noise of 1 places its line to 1 / (160 / 2) / sqrt(15) = 0.003 px;
  // the box blur is not the tanh of the model: by symmetry that moves nothing at a corner, but perspective over the
  // window (0.5 % of 7 px, half of it even) leaves some 0.01 px. OpenCV's own refinement stays at 0.03.
  EXPECT_LT(rms_px(*found, b, homography()), 0.015);
  // The stated uncertainty is what the scatter says, within the factor that a few dozen degrees of freedom leave.
  EXPECT_GT(found->corners[0].u_pixel_px, 0.3 * rms_px(*found, b, homography()));
  EXPECT_LT(found->corners[0].u_pixel_px, 0.03);
}

TEST(DetectBoard, CountsFromTheSameCornerWithinAQuarterTurn) {
  const auto b = board_of(model::BoardKind::chessboard, 7, 5);
  for (const double turn : {-1.3, 0.0, 1.3}) {
    const auto found = calib::detect_board(render(b, homography(turn)), b);
    ASSERT_TRUE(found) << found.error().sentence;
    EXPECT_LT(rms_px(*found, b, homography(turn)), 0.05) << turn;
  }
}

TEST(DetectBoard, TellsTheEndsApartByTheColoursWhereTheyDiffer) {
  const auto b = board_of(model::BoardKind::chessboard, 8, 5);
  const auto found = calib::detect_board(render(b, homography(3.0)), b);
  ASSERT_TRUE(found) << found.error().sentence;
  EXPECT_LT(rms_px(*found, b, homography(3.0)), 0.05);
}

TEST(DetectBoard, FindsTheCentresOfCirclesNotThoseOfTheirPictures) {
  for (const auto kind : {model::BoardKind::circles, model::BoardKind::asymmetric_circles}) {
    const auto b = kind == model::BoardKind::circles ? board_of(kind, 7, 6) : board_of(kind, 5, 9);
    const auto found = calib::detect_board(render(b, homography()), b);
    ASSERT_TRUE(found) << found.error().sentence;
    // Uncorrected, the centres of the ellipses lie 0.03 to 0.06 px off (7e-4 x 2.4 x 5^2 px). Noise of 1 level over a rim of
    // some 100 px of a disc of 400 px and 160 levels: 0.01 px; the 8-bit picture adds as much again.
    EXPECT_LT(rms_px(*found, b, homography()), 0.025);
  }
}

TEST(DetectBoard, SaysWhatItLookedForWhereThereIsNone) {
  const auto found = calib::detect_board(Image8(640, 480, 90), board_of(model::BoardKind::chessboard, 9, 7));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, ::testing::HasSubstr("9 x 7"));
}

/// A phase map of a plane board: u = (a0 + a . p) / (1 + b . p), with a ripple of the step errors and noise.
decode::PhaseMap plane_map(bool staircase, double ripple_rad, double noise_rad) {
  decode::PhaseMap m;
  m.axis = CodeAxis::x;
  m.code = {.gray_bits = staircase ? 10 : 7, .phase_steps = staircase ? 0 : 4, .stripes_per_period = staircase ? 1 : 2,
            .period = staircase ? 1.0 : 0.24, .unit = staircase ? "px" : "mm"};
  m.phase_rad = m.u_phase_rad = m.modulation = m.mean = Image<float>(640, 480);
  m.validity = Image<std::uint8_t>(640, 480);
  std::mt19937 random(9);
  const double per_px = m.code.period / (staircase ? 2.0 : 18.0);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      double noise = -6;
      for (int k = 0; k < 12; ++k) noise += static_cast<double>(random()) / 4294967296.0;
      double u = per_px * (20.0 + 1.0 * x + 0.15 * y) / (1.0 + 2e-4 * x - 1e-4 * y);
      if (staircase) u = m.code.stripe_width() * (std::floor(u / m.code.stripe_width()) + 0.5);
      const double phase = m.code.phase_from_u(u);
      m.phase_rad(x, y) = static_cast<float>(phase + ripple_rad * std::sin(2 * phase + 0.4) + noise_rad * noise);
      m.u_phase_rad(x, y) = static_cast<float>(staircase ? 1.8 : noise_rad);
    }
  }
  return m;
}

double plane_u(const decode::PhaseMap& m, const Eigen::Vector2d& p) {
  const double per_px = m.code.period / (m.code.phase_steps == 0 ? 2.0 : 18.0);
  return per_px * (20.0 + p.x() + 0.15 * p.y()) / (1.0 + 2e-4 * p.x() - 1e-4 * p.y());
}

model::BoardObservation grid_of_corners() {
  model::BoardObservation o;
  for (int row = 0; row < 7; ++row) {
    for (int column = 0; column < 9; ++column) {
      model::CornerObservation c;
      c.column = column;
      c.row = row;
      c.pixel = {60.3 + 63.7 * column + 1.2 * row, 50.6 + 61.2 * row - 0.9 * column};
      o.corners.push_back(c);
    }
  }
  return o;
}

TEST(CornerPhase, IsRightWithinItsUncertaintyDespiteRippleAndWrongFringeNumbers) {
  auto map = plane_map(false, 0.03, 0.02);
  for (int y = 45; y < 52; ++y) map.phase_rad(61, y) += static_cast<float>(2 * std::numbers::pi);
  auto o = grid_of_corners();
  calib::add_projector_coordinates(o, map);
  double z2 = 0, squares = 0;
  for (const auto& c : o.corners) {
    ASSERT_TRUE(c.x);
    const double error = c.x->value - plane_u(map, c.pixel);
    squares += error * error;
    z2 += error * error / (c.x->u * c.x->u);
  }
  const double to_rad = 2 * std::numbers::pi / 0.24;
  // Noise: 0.02 rad over 19 x 17 pixels is 1.1 mrad. The ripple of two cycles a period leaves, of 30 mrad, what a box of
  // 19 px does not cancel of a wave of 9 px (rounding of the box to whole pixels): up to 1 / (2 pi) of 0.5 px / 9 px x 30
  // mrad x 2 = 1 mrad. Together below 2.5 mrad.
  EXPECT_LT(std::sqrt(squares / 63) * to_rad, 2.5e-3);
  // The stated uncertainty counts the ripple as correlated noise: not less than the truth by more than a third, and not ten
  // times more.
  EXPECT_LT(std::sqrt(z2 / 63), 1.35);
  EXPECT_GT(std::sqrt(z2 / 63), 0.1);
}

TEST(CornerPhase, ReadsAStaircaseToASmallPartOfAStep) {
  const auto map = plane_map(true, 0, 0);
  auto o = grid_of_corners();
  calib::add_projector_coordinates(o, map);
  double squares = 0, u = 0;
  for (const auto& c : o.corners) {
    ASSERT_TRUE(c.x);
    squares += std::pow(c.x->value - plane_u(map, c.pixel), 2);
    u = std::max(u, c.x->u);
  }
  // Steps of one stripe are uniform within +-0.5: 0.29. Ten stripes in the window leave 0.29 / sqrt(10) = 0.09 where every
  // row says the same; tilted stripes average further.
  EXPECT_LT(std::sqrt(squares / 63), 0.09);
  EXPECT_LT(u, 0.12);
}

TEST(CornerPhase, GivesNothingWhereThePhaseIsNotValid) {
  auto map = plane_map(false, 0, 0.02);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 100; ++x) map.validity(x, y) = static_cast<std::uint8_t>(decode::Validity::shadow);
  }
  auto o = grid_of_corners();
  calib::add_projector_coordinates(o, map);
  for (const auto& c : o.corners) EXPECT_EQ(c.x.has_value(), c.pixel.x() > 100) << c.pixel.transpose();
}

}  // namespace
}  // namespace fringecal

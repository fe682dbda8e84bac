#include "core/error.h"
#include "hw/virtual/printed_board.h"
#include "tests/hw/virtual_support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace fringecal::virt {
namespace {

PatternBoard chessboard() {
  PatternBoard out;
  out.board.columns = 12;
  out.board.rows = 9;
  out.board.pitch_x_mm = out.board.pitch_y_mm = 25.0;
  out.u_print_mm = 0.010;
  out.pitch_error_relative = 1e-5;
  return out;
}

// eq. 1 is inverted to 1e-8 mm; 0.1 um aside of the true corner the colours of the four squares must already be there.
TEST(PrintedBoard, ChangesColourExactlyAtItsTrueCorners) {
  const PrintedBoard board(chessboard(), read_preset("chen2008"), 7);
  constexpr double kAside = 1e-4;
  double square = 0;
  for (int j = 0; j < 9; ++j) {
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector2d corner = board.corner_mm(i, j).head<2>();
      const auto black = [&](double x, double y) { return board.albedo(corner + Eigen::Vector2d(x, y)) < 0.5; };
      const bool even = (i + j) % 2 == 0;  // square (i, j) stands right of and below corner (i, j)
      EXPECT_EQ(black(kAside, kAside), even);
      EXPECT_EQ(black(-kAside, -kAside), even);
      EXPECT_EQ(black(kAside, -kAside), !even);
      EXPECT_EQ(black(-kAside, kAside), !even);
      const Eigen::Vector2d nominal((i - 5.5) * 25.0 * (1 + 1e-5), (j - 4.0) * 25.0 * (1 + 1e-5));
      square += (corner - nominal).squaredNorm() / (2 * 12 * 9);
    }
  }
  // 216 draws: the rms has a standard error of 4.8 %; four of them.
  EXPECT_NEAR(std::sqrt(square), 0.010, 0.002);
}

TEST(PrintedBoard, IsAParaboloidWithItsBowAtTheOutermostCorners) {
  const PrintedBoard board(chessboard(), read_preset("chen2008"), 7);
  for (const auto& [i, j] : {std::pair(0, 0), std::pair(11, 0), std::pair(0, 8), std::pair(11, 8)}) {
    EXPECT_NEAR(board.corner_mm(i, j).z(), 0.15, 1e-4);  // bow times twice the printing error over the radius
  }
}

// An edge at d px from the middle: Phi(d / s) smeared over the pixel, here by Simpson's rule; 1/128 of the light is the
// samples' resolution. The light's centre on a black edge lies at the white side by sum-of-Gaussians; its sign is
// enough.
TEST(PrintedBoard, IsSeenThroughThePointSpread) {
  PatternBoard shape = chessboard();
  shape.u_print_mm = 0;
  const PrintedBoard board(shape, read_preset("chen2008"), 7);
  const PointSpread spread(0.6);
  const Eigen::Vector2d corner = board.corner_mm(4, 4).head<2>();
  for (const double d : {-1.2, -0.4, 0.0, 0.3, 0.9}) {
    // Square (4, 4) is black: right of the vertical edge, 10 mm below the corner. The pixel's middle d px left of the
    // edge.
    const auto seen = board.seen(corner + Eigen::Vector2d(-0.3 * d, 10), {0.3, 0}, {0, 0.3}, spread);
    double white = 0;
    for (int k = 0; k <= 200; ++k) {
      const double weight = (k == 0 || k == 200 ? 1.0 : k % 2 == 1 ? 4.0 : 2.0) / 600.0;
      white += weight * 0.5 * std::erfc(-(d + k / 200.0 - 0.5) / 0.6 / std::sqrt(2.0));
    }
    EXPECT_NEAR(seen.albedo, white + 0.05 * (1 - white), 0.95 / 128) << d;
    EXPECT_LT(seen.centroid.x(), 0);
    EXPECT_NEAR(seen.centroid.y(), 0, d > 0.2 ? 0.067 : 0.5);
  }
}

TEST(ReadScene, KeepsWhatToValueWritesAndRefusesTheRest) {
  const auto file =
      std::filesystem::temp_directory_path() / ("fringecal_scene_" + std::to_string(::getpid()) + ".toml");
  write_atomically(file, R"([[objects]]
name = "ball"
kind = "sphere"
diameter_mm = 38.0
position_mm = [1.0, 2.0, 3.0]
rotation_deg = [0.0, 90.0, 0.0]
texture = 0.1
)");
  const Scene scene = read_scene(file);
  ASSERT_EQ(scene.objects.size(), 1U);
  EXPECT_EQ(std::get<Sphere>(scene.objects[0].shape).diameter_mm, 38.0);
  EXPECT_NEAR((scene.objects[0].world_from_part * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 2, 2)).norm(), 0,
              1e-12);
  EXPECT_THAT(to_json(to_value(scene)), testing::HasSubstr("\"texture\": 0.1"));
  const auto refused = [&](const std::string& text) -> std::string {
    write_atomically(file, text);
    try {
      read_scene(file);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refused("[[objects]]\nname = 'a'\nkind = 'cone'\n"), testing::HasSubstr("cone"));
  EXPECT_THAT(refused(""), testing::HasSubstr("[[objects]]"));
  EXPECT_THAT(refused("[[objects]]\nname='a'\nkind='sphere'\ndiameter_mm=-1\n"), testing::HasSubstr("positive"));
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace fringecal::virt

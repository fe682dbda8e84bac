// Frames against the specification, with the model's formulas and test-local decoding; nothing of calib/decode.
#include "tests/hw/virtual_support.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

namespace fringecal::virt {
namespace {

constexpr double kPi = std::numbers::pi;

Pattern gray(int bit) { return {PatternKind::gray, CodeAxis::x, bit, false}; }
Pattern phase(int step) { return {PatternKind::phase, CodeAxis::x, step, false}; }

double mean_of_steps(const Capture& c, int x, int y) {
  double sum = 0;
  for (int k = 0; k < 4; ++k) sum += level(c, phase(k), x, y) / 4;
  return sum;
}

// Four steps see a third harmonic h as a ripple of h sin 4 phi: at most 0.02 rad, mean zero. Digits: 1/16 grey level
// uniform is 0.018 rms, over sqrt(2) B = 113 that is 1.6e-4 rad per pixel, 1e-6 for the mean of 1392 x 16. The blur of
// 0.6 px moves the phase by its curvature, below 1e-4 rad.
TEST(VirtualFrames, PhaseIsThatOfTheModelsProjection) {
  const ChangedPreset file(without_errors(16));
  const VirtualScanner scanner(file.file(), 3);
  const Capture c = scanner.capture(flat_at(-20), {}, 1);
  double sum = 0, largest = 0;
  int count = 0;
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 1392; ++x) {
      const double measured = std::atan2(level(c, phase(1), x, y) - level(c, phase(3), x, y),
                                         level(c, phase(0), x, y) - level(c, phase(2), x, y));
      const double u = u_of_plane_pixel(scanner, x, y, -20);
      if (u < 0.12 || u > 15.24) continue;
      const double error = std::remainder(measured - (2 * kPi * u / 0.24 - kPi), 2 * kPi);
      sum += error;
      largest = std::max(largest, std::abs(error));
      ++count;
    }
  }
  EXPECT_GT(count, 20000);
  EXPECT_NEAR(sum / count, 0, 1e-4);
  EXPECT_LT(largest, 0.023);
  EXPECT_GT(largest, 0.015);
}

// Least squares of a, B1, B3 over one region: rms of digits 0.018 / sqrt(n / 2) is 1e-3 grey levels of 80, so 1e-5 of
// the ratio; rho varies in the region by 0.05, which moves the ratio by 0.008 (0.05) = 4e-4 at most at the edge. The
// light's slope within the region is divided out by the mean of the steps.
TEST(VirtualFrames, ThirdHarmonicIsThatOfTheSpecification) {
  const ChangedPreset file(without_errors(16, {{"blur_px", "0.0"}}));
  const VirtualScanner scanner(file.file(), 3);
  const Capture c = scanner.capture(flat_at(0), {}, 1);
  for (const double rho : {0.0, -0.9}) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 1392; ++x) {
        const double u = u_of_plane_pixel(scanner, x, y, 0);
        if (std::abs((u - 7.83) / 7.68 - rho) > 0.05) continue;
        const double phi = 2 * kPi * u / 0.24 - kPi;
        const double light = (mean_of_steps(c, x, y) - 12.0);
        const Eigen::Vector3d row(1, std::cos(phi), std::cos(3 * phi));
        normal += row * row.transpose();
        right += row * (level(c, phase(0), x, y) - 12.0) / light;
      }
    }
    const Eigen::Vector3d fit = normal.ldlt().solve(right);
    // A pixel's own square blurs by 1/12 px^2: the third harmonic loses exp(-(9 - 1) / 2 k^2 / 12) against the first.
    const int middle = rho == 0.0 ? 696 : 40;
    const double k =
        2 * kPi / 0.24 * (u_of_plane_pixel(scanner, middle + 1, 8, 0) - u_of_plane_pixel(scanner, middle, 8, 0));
    EXPECT_NEAR(std::abs(fit[2] / fit[1]), (0.012 + 0.008 * rho * rho) * std::exp(-4 * k * k / 12), 4e-4) << rho;
    EXPECT_LT(fit[2] / fit[1], 0);  // cos x - cos(3 x) / 3 ...
  }
}

// B = 80 on the white board at the centre of R (the camera's blur takes exp(-(2 pi 0.6 / 25)^2 / 2) = 1.1 %), and the
// fall-off along the strip is cos^4 within the tilt of the projector (0.4 deg: 1 % at the edge).
TEST(VirtualFrames, ModulationAndFallOffAreThoseOfTheSpecification) {
  const ChangedPreset file(without_errors(16));
  const VirtualScanner scanner(file.file(), 3);
  const Capture c = scanner.capture(flat_at(0), {}, 1);
  const auto light_near = [&](double u_mm) {
    double best = 1e9, light = 0;
    for (int x = 0; x < 1392; ++x) {
      const double off = std::abs(u_of_plane_pixel(scanner, x, 8, 0) - u_mm);
      if (off < best) {
        best = off;
        light = mean_of_steps(c, x, 8) - 12.0;
      }
    }
    return light;
  };
  const double centre = light_near(7.83);
  // B / (light / 2) = 0.99 (2 / pi) 0.660 / 0.505 at 1 : 100 contrast, from the specification.
  EXPECT_NEAR(centre * 0.99 * 2 / kPi * std::pow(0.036, 0.125) / 0.505, 80.0, 0.4);
  const double tangent = 6.5 / 32;
  EXPECT_NEAR(light_near(7.83 + 6.5) / centre, std::pow(1 + tangent * tangent, -2.0), 0.012);
}

class GrayOf : public testing::TestWithParam<Changes> {};

// i is the stripe of the model's u; pixels within 4 um of a stripe's edge are left out: the digits move an edge by 0.03
// um, the camera's blur, where the light has a slope, by less than 1 um.
TEST_P(GrayOf, IsBinaryReflected) {
  Changes changes = without_errors(16);
  const Changes more = GetParam();
  changes.insert(changes.end(), more.begin(), more.end());
  const ChangedPreset file(changes);
  const VirtualScanner scanner(file.file(), 3);
  const FringeCode code = *scanner.plan().x;
  ASSERT_EQ(defect_of(scanner.plan()), "");
  const Capture c = scanner.capture(flat_at(10), {}, 1);
  int checked = 0;
  for (int y = 0; y < 16; y += 5) {
    for (int x = 0; x < 1392; ++x) {
      const double stripe = u_of_plane_pixel(scanner, x, y, 10) / code.stripe_width();
      const int i = static_cast<int>(std::floor(stripe));
      if (std::abs(stripe - std::round(stripe)) * code.stripe_width() < 0.004 || i < 1 || i > code.stripes() - 2)
        continue;
      double threshold = 0;
      for (int k = 0; k < code.phase_steps; ++k) threshold += level(c, phase(k), x, y) / code.phase_steps;
      int g = 0;
      for (int b = 0; b < code.gray_bits; ++b) g = 2 * g + (level(c, gray(b), x, y) > threshold ? 1 : 0);
      ASSERT_EQ(g, i ^ (i >> 1)) << x;
      ++checked;
    }
  }
  EXPECT_GT(checked, 2000);
}

INSTANTIATE_TEST_SUITE_P(
    Gratings, GrayOf,
    testing::Values(Changes{}, Changes{{"gray_bits", "5"}, {"period_mm", "0.96"}},
                    Changes{{"gray_bits", "6"}, {"stripes_per_period", "1"}, {"order", "\"phase first\""}},
                    Changes{{"gray_bits", "8"}, {"period_mm", "0.12"}, {"phase_steps", "8"}}));

// Edge of bit b, sub-pixel, as u of the model at the crossing of the middle level. The digits: 1/16 grey level at 22
// levels per pixel is 0.003 px, 0.03 um of grating; the line between two pixels on the blurred edge (3.6 px rms) is
// straight to 0.004 px. Shifts are 14 um (finest) to 97 um.
TEST(VirtualFrames, GrayEdgesStandOffByTheirSlideDistanceTimesTheta) {
  const double theta = 0.9e-3, pitch = 12.0, stripe = 0.12;
  const ChangedPreset aligned_file(without_errors(16));
  const ChangedPreset file(without_errors(16, {{"theta_mrad", "0.9"}}));
  const VirtualScanner aligned(aligned_file.file(), 3), scanner(file.file(), 3);
  const Capture level_of_half = aligned.capture(flat_at(0), {}, 1), c = scanner.capture(flat_at(0), {}, 1);
  const auto edge_shifts = [&](const Pattern& pattern, double first_edge_mm, double spacing_mm) {
    std::vector<double> shifts;
    const auto above = [&](int x) { return level(c, pattern, x, 8) - mean_of_steps(level_of_half, x, 8); };
    for (int x = 0; x + 1 < 1392; ++x) {
      const double a = above(x), b = above(x + 1);
      if ((a > 0) == (b > 0)) continue;
      const double u0 = u_of_plane_pixel(scanner, x, 8, 0), u1 = u_of_plane_pixel(scanner, x + 1, 8, 0);
      const double u = u0 + a / (a - b) * (u1 - u0);
      if (u < 0.5 || u > 14.8) continue;
      shifts.push_back(std::remainder(u - first_edge_mm, spacing_mm));
    }
    return shifts;
  };
  for (int bit = 0; bit < 7; ++bit) {
    const double width = stripe * (1 << (6 - bit));
    const auto shifts = edge_shifts(gray(bit), width, 2 * width);
    ASSERT_FALSE(shifts.empty()) << bit;
    for (const double shift : shifts) EXPECT_NEAR(shift, (7 + 2 - bit) * pitch * std::sin(theta), 2e-4) << bit;
  }
  // Where atan2 of the steps wraps: PS1 = PS3 with PS0 < PS2, the place of PS2's dark-to-bright middle: u = m p.
  for (int x = 0; x + 1 < 1392; ++x) {
    const auto difference = [&](int column) { return level(c, phase(1), column, 8) - level(c, phase(3), column, 8); };
    const double a = difference(x), b = difference(x + 1);
    if ((a > 0) == (b > 0) || level(c, phase(0), x, 8) > level(c, phase(2), x, 8)) continue;
    const double u0 = u_of_plane_pixel(scanner, x, 8, 0), u1 = u_of_plane_pixel(scanner, x + 1, 8, 0);
    const double u = u0 + a / (a - b) * (u1 - u0);
    if (u < 0.5 || u > 14.8) continue;
    EXPECT_NEAR(std::remainder(u, 0.24), 0.0, 2e-4);
  }
}

// d = difference of two stacks of one scene: var(d) = 2 sigma^2(S). n = 11 x 16 x 1392 pairs: the fit's coefficients
// have standard errors of 0.5 % at most; 3 % leaves room for nothing else than the clamp at 0, which starts 12 sigma
// away.
TEST(VirtualFrames, NoiseIsHalfShotAndHalfReadAtMidGrey) {
  Changes changes = without_errors(16);
  for (auto& [key, value] : changes) {
    if (key == "noise_rms") value = "1.0";
  }
  const ChangedPreset file(changes);
  const VirtualScanner scanner(file.file(), 3);
  const Capture one = scanner.capture(flat_at(0), {}, 1), two = scanner.capture(flat_at(0), {}, 2);
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (std::size_t k = 0; k < one.frames.size(); ++k) {
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 1392; ++x) {
        const double a = level(one, k, x, y), b = level(two, k, x, y);
        const Eigen::Vector2d row(1.0, 0.5 * (a + b) / 127.5);
        normal += row * row.transpose();
        right += row * 0.5 * (a - b) * (a - b);
      }
    }
  }
  const Eigen::Vector2d variance = normal.ldlt().solve(right);
  EXPECT_NEAR(variance[0], 0.5, 0.015);
  EXPECT_NEAR(variance[1], 0.5, 0.015);
}

// The saddle of a corner: the point from which all gradients around it look sideways, sum g g^T (q - p) = 0 over a
// window.
Eigen::Vector2d saddle_near(const Capture& c, Eigen::Vector2d q) {
  for (int iteration = 0; iteration < 20; ++iteration) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    const int cx = static_cast<int>(std::lround(q.x())), cy = static_cast<int>(std::lround(q.y()));
    for (int y = cy - 14; y <= cy + 14; ++y) {
      for (int x = cx - 14; x <= cx + 14; ++x) {
        const Eigen::Vector2d p(x, y), g(mean_of_steps(c, x + 1, y) - mean_of_steps(c, x - 1, y),
                                         mean_of_steps(c, x, y + 1) - mean_of_steps(c, x, y - 1));
        const double weight = std::exp(-(p - q).squaredNorm() / (2 * 4.0 * 4.0));
        normal += weight * g * g.transpose();
        right += weight * g * g.dot(p);
      }
    }
    q = normal.ldlt().solve(right);
  }
  return q;
}

// What the saddle of a perfect image is off by: the shading's slope along the edges (1e-3 per pixel), the bend of the
// edges at a corner by the printing errors (10 um in 25 mm), perspective within the window. All below 0.01 px together;
// a pixel's half, a transposed axis or a missing printing error (0.03 px) stand out.
TEST(VirtualFrames, CornersStandWhereTheModelProjectsTheirTruePlaces) {
  const ChangedPreset file(without_errors(500, {{"width_px", "500"}}));
  const VirtualScanner scanner(file.file(), 3);
  const model::Scanner truth = scanner.true_scanner({});
  for (const char* name : {"calibration 0", "calibration 3", "calibration 11"}) {
    const Scene scene = scanner.standard_scene(name);
    const Capture c = scanner.capture(scene, {}, 1);
    double square = 0;
    int count = 0;
    for (const Eigen::Vector3d& corner : scanner.true_corners_mm(std::get<PatternBoard>(scene.objects[0].shape))) {
      const Eigen::Vector3d in_cam =
          scanner.preset_from_cam({}).inverse() * (scene.objects[0].world_from_part * corner);
      const Eigen::Vector2d expected = truth.camera.project(in_cam).value();
      if ((expected.array() < 20).any() || (expected.array() > 479).any()) continue;
      const Eigen::Vector2d error = saddle_near(c, expected + Eigen::Vector2d(0.7, -0.4)) - expected;
      EXPECT_LT(error.norm(), 0.03) << name << " " << expected.transpose();
      square += error.squaredNorm() / 2;
      ++count;
    }
    ASSERT_GT(count, 15) << name;
    EXPECT_LT(std::sqrt(square / count), 0.01) << name;
  }
}

// The shadow of a ball: from the pupil (0, 0, 1000) through its centre (0, 0, 60) to (0, 0, -50); the camera, at X =
// 400, passes 42 mm beside the centre on its way there, so it sees the place.
TEST(VirtualFrames, ABallThrowsItsShadow) {
  const ChangedPreset file(without_errors(200, {{"width_px", "400"}}));
  const VirtualScanner scanner(file.file(), 3);
  Scene scene = flat_at(-50);
  SceneObject ball;
  ball.name = "ball";
  ball.shape = Sphere{50};
  ball.world_from_part.translation_mm = {0, 0, 60};
  scene.objects.push_back(ball);
  const auto pixel_of = [&](const Eigen::Vector3d& point) {
    const auto p = scanner.true_scanner({}).camera.project(scanner.preset_from_cam({}).inverse() * point).value();
    return std::pair(static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())));
  };
  const Capture with = scanner.capture(scene, {}, 1), without = scanner.capture(flat_at(-50), {}, 1);
  const auto [x, y] = pixel_of({0, 0, -50});
  ASSERT_TRUE(x >= 0 && x < 400 && y >= 0 && y < 200);
  EXPECT_NEAR(mean_of_steps(with, x, y), 12.0, 0.1);
  EXPECT_GT(mean_of_steps(without, x, y), 80.0);
  // The ball's own far side: below its equator on the camera's side, away from the projector.
  const auto [bx, by] = pixel_of(Eigen::Vector3d(0, 0, 60) + 25 * Eigen::Vector3d(0.98, 0, -0.2).normalized());
  EXPECT_NEAR(mean_of_steps(with, bx, by), 12.0, 0.1);
}

}  // namespace
}  // namespace fringecal::virt

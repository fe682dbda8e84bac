// Effective number of points, whiteness and form from the residuals over the pixel grid.
#include "tests/fitting/synthetic.h"

#include "fitting/fit.h"
#include "fitting/noise.h"
#include "tests/support/long_tests.h"

#include <gtest/gtest.h>

namespace fringecal::fitting {
namespace {

constexpr int kSide = 70, kMargin = 8;

/// Noise of standard deviation one on a grid, blurred by a Gaussian of sigma_px; zero: white.
std::vector<double> blurred_noise(double sigma_px, Random& random) {
  constexpr int kWide = kSide + 2 * kMargin;
  std::vector<double> white(kWide * kWide), rows(kWide * kWide), out(kSide * kSide);
  for (double& x : white) x = normal(random);
  double weights[2 * kMargin + 1], norm2 = 0;
  for (int h = -kMargin; h <= kMargin; ++h) {
    weights[h + kMargin] = sigma_px > 0 ? std::exp(-0.5 * h * h / (sigma_px * sigma_px)) : h == 0 ? 1.0 : 0.0;
    norm2 += weights[h + kMargin] * weights[h + kMargin];
  }
  for (int y = 0; y < kWide; ++y) {
    for (int x = kMargin; x < kWide - kMargin; ++x) {
      for (int h = -kMargin; h <= kMargin; ++h)
        rows[static_cast<std::size_t>(y * kWide + x)] +=
            weights[h + kMargin] * white[static_cast<std::size_t>(y * kWide + x + h)];
    }
  }
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      double sum = 0;
      for (int v = -kMargin; v <= kMargin; ++v)
        sum += weights[v + kMargin] * rows[static_cast<std::size_t>((y + kMargin + v) * kWide + x + kMargin)];
      out[static_cast<std::size_t>(y * kSide + x)] = sum / norm2;
    }
  }
  return out;
}

/// What a scanner sees of a sphere of 50 mm: the pixels of its front, and the points there.
struct Seen {
  std::vector<std::pair<int, int>> pixels;
  Cloud places, normals;
};
Seen sphere_seen() {
  Seen seen;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double u = (x - 0.5 * (kSide - 1)) / (0.5 * kSide), v = (y - 0.5 * (kSide - 1)) / (0.5 * kSide),
                   r2 = 0.72 * (u * u + v * v);
      if (u * u + v * v > 1.0) continue;
      const Eigen::Vector3d n(std::sqrt(0.72) * u, std::sqrt(0.72) * v, std::sqrt(1.0 - r2));
      seen.pixels.emplace_back(x, y);
      seen.places.push_back(25.0 * n);
      seen.normals.push_back(n);
    }
  }
  return seen;
}

std::vector<GridResidual> residuals_of(const Seen& seen, const FitQuality& quality) {
  std::vector<GridResidual> out;
  for (std::size_t i = 0; i < seen.pixels.size(); ++i)
    out.push_back({seen.pixels[i].first, seen.pixels[i].second, quality.distances_mm[i]});
  return out;
}

/// Of the distances by the centre and the radius.
Eigen::MatrixXd jacobian_of(const Seen& seen) {
  Eigen::MatrixXd out(static_cast<Eigen::Index>(seen.normals.size()), 4);
  for (std::size_t i = 0; i < seen.normals.size(); ++i)
    out.row(static_cast<Eigen::Index>(i)) << -seen.normals[i].transpose(), -1.0;
  return out;
}

struct Ratios {
  double diameter = 0, x = 0, z = 0, inflation = 0;
  int white = 0, form = 0;
};
Ratios repeat(double sigma_px, int repeats) {
  const Seen seen = sphere_seen();
  const Eigen::MatrixXd jacobian = jacobian_of(seen);
  Random random(31);
  double d2 = 0, x2 = 0, z2 = 0, u_d = 0, u_x = 0, u_z = 0;
  Ratios out;
  for (int i = 0; i < repeats; ++i) {
    const std::vector<double> noise = blurred_noise(sigma_px, random);
    Cloud cloud;
    for (std::size_t k = 0; k < seen.places.size(); ++k) {
      cloud.push_back(seen.places[k] +
                      0.02 * noise[static_cast<std::size_t>(seen.pixels[k].second * kSide + seen.pixels[k].first)] *
                          seen.normals[k]);
    }
    const auto fit = fit_sphere(cloud);
    const auto found = noise_of(residuals_of(seen, fit->quality), jacobian);
    out.white += found->kind == ResidualKind::white;
    out.form += found->kind == ResidualKind::form;
    out.inflation += found->inflation[3] / repeats;
    d2 += std::pow(fit->diameter_mm - 50.0, 2);
    x2 += std::pow(fit->center_mm.x(), 2);
    z2 += std::pow(fit->center_mm.z(), 2);
    u_d += found->inflation[3] * fit->u_diameter_mm;
    u_x += found->inflation[0] * fit->u_center_mm.x();
    u_z += found->inflation[2] * fit->u_center_mm.z();
  }
  out.diameter = std::sqrt(d2 / repeats) / (u_d / repeats);
  out.x = std::sqrt(x2 / repeats) / (u_x / repeats);
  out.z = std::sqrt(z2 / repeats) / (u_z / repeats);
  std::printf("blur %.1f px: scatter / u: diameter %.3f, x %.3f, z %.3f; inflation %.2f; white %d, form %d of %d\n",
              sigma_px, out.diameter, out.x, out.z, out.inflation, out.white, out.form, repeats);
  return out;
}

// 2000 repeats know the scatter to 1.6 %: 5 % is three of it, for white noise. 10 % for correlated noise: the estimate of
// the sum of correlations itself and the row of the Jacobian, which is not constant over the blur.
TEST(ResidualNoise, MakesUncertaintiesTheScatterOfRepeatsForWhiteNoise) {
  const Ratios ratios = repeat(0.0, 2000);
  EXPECT_NEAR(ratios.diameter, 1.0, 0.05);
  EXPECT_NEAR(ratios.x, 1.0, 0.05);
  EXPECT_NEAR(ratios.z, 1.0, 0.05);
  // |z| <= 4 loses 6e-5 of white residuals
  EXPECT_GE(ratios.white, 1997);
}
TEST(ResidualNoise, MakesUncertaintiesTheScatterOfRepeatsForCorrelatedNoise) {
  const Ratios ratios = repeat(0.7, 2000);
  EXPECT_NEAR(ratios.diameter, 1.0, 0.10);
  EXPECT_NEAR(ratios.x, 1.0, 0.10);
  EXPECT_NEAR(ratios.z, 1.0, 0.10);
  EXPECT_EQ(ratios.white, 0);
  EXPECT_LE(ratios.form, 20);
}

// A blur of 1.5 px over a grid of 70: 136 independent areas for four parameters, of which two depend on how the rim
// differs from the middle. 600 repeats know the ratio to 3 %; 10 % as above.
TEST(ResidualNoise, MakesUncertaintiesTheScatterOfRepeatsForWidelyCorrelatedNoise) {
  const Ratios ratios = repeat(1.5, test::long_tests() ? 2000 : 600);
  EXPECT_NEAR(ratios.diameter, 1.0, 0.10);
  EXPECT_NEAR(ratios.x, 1.0, 0.10);
  EXPECT_NEAR(ratios.z, 1.0, 0.10);
  EXPECT_EQ(ratios.white, 0);
}

TEST(ResidualNoise, SaysWhereTheResidualIsForm) {
  const Seen seen = sphere_seen();
  Random random(32);
  Cloud cloud;
  for (std::size_t k = 0; k < seen.places.size(); ++k) {
    const auto [x, y] = seen.pixels[k];
    const double form =
        0.03 * std::cos(2.0 * std::numbers::pi * 1.5 * (x + 0.4 * y) / kSide);  // one and a half waves over the front
    cloud.push_back(seen.places[k] + (form + 0.005 * normal(random)) * seen.normals[k]);
  }
  const auto fit = fit_sphere(cloud);
  ASSERT_TRUE(fit);
  const auto found = noise_of(residuals_of(seen, fit->quality), jacobian_of(seen));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->kind, ResidualKind::form);
  EXPECT_GT(std::abs(found->z), 10.0);
}

TEST(ResidualNoise, RefusesTooFewAndZeroResidualsAndEqualColumns) {
  EXPECT_FALSE(noise_of(std::vector<GridResidual>(99), Eigen::MatrixXd::Ones(99, 1)));
  std::vector<GridResidual> residuals;
  for (int i = 0; i < 200; ++i) residuals.push_back({i % 20, i / 20, 0.0});
  EXPECT_FALSE(noise_of(residuals, Eigen::MatrixXd::Ones(200, 1)));
  for (int i = 0; i < 200; ++i) residuals[static_cast<std::size_t>(i)].d_mm = i < 100 ? 1.0 : -1.0;
  EXPECT_TRUE(noise_of(residuals, Eigen::MatrixXd::Ones(200, 1)));
  EXPECT_FALSE(noise_of(residuals, Eigen::MatrixXd::Ones(200, 2)));
}

}  // namespace
}  // namespace fringecal::fitting

// Shapes in raw clouds: real scans, and a made one with a post and a base.
#include "tests/fitting/synthetic.h"

#include "core/point_file.h"
#include "fitting/find.h"
#include "tests/support/long_tests.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

namespace fringecal::fitting {
namespace {

// Free fits of the hand-cut sphere part are reported at R = 49.8 to 50.1 mm with rms 0.10 to 0.23 mm; 0.05 mm more on
// each side for another choice of the edge.
TEST(FindShapes, IsolatesTheSphereInEveryRawScanOfNist) {
  const std::string root = std::string(FRINGECAL_SHARED_DATA) + "/nist-sphere-scans";
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data not present: " << root;
  const NominalShape nominal[] = {{"sphere 100", ShapeKind::sphere, 100.0}};
  for (int i = 101; i <= 106; ++i) {
    SCOPED_TRACE(i);
    const auto points_mm = read_points_mm(root + "/SPH" + std::to_string(i) + ".xyz", LengthUnit::m);
    const auto found = find_shapes(points_mm, nominal);
    ASSERT_TRUE(found) << found.error().sentence;
    const FoundShape* sphere = nullptr;
    for (const FoundShape& shape : found->shapes) {
      if (shape.nominal == "sphere 100") sphere = &shape;
    }
    ASSERT_NE(sphere, nullptr);
    std::printf("SPH%d: R %.3f mm, sd %.3f mm, %zu points, margin %zu, silhouette %zu, beyond %zu of %zu\n", i,
                0.5 * sphere->diameter_mm, sphere->standard_deviation_mm, sphere->n_surface, sphere->n_margin,
                sphere->n_silhouette, sphere->n_beyond, points_mm.size());
    EXPECT_GT(0.5 * sphere->diameter_mm, 49.75);
    EXPECT_LT(0.5 * sphere->diameter_mm, 50.15);
    EXPECT_GT(sphere->standard_deviation_mm, 0.05);
    EXPECT_LT(sphere->standard_deviation_mm, 0.25);
  }
}

/// The cloud with stray points all over its box: the share of all points then.
Cloud with_stray(Cloud cloud, double share) {
  Random random(991);
  const std::size_t n = cloud.size(), stray = static_cast<std::size_t>(static_cast<double>(n) * share / (1.0 - share));
  Eigen::Vector3d low = cloud[0], high = cloud[0];
  for (const auto& p : cloud) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  for (std::size_t i = 0; i < stray; ++i) {
    cloud.push_back(low + Eigen::Vector3d{uniform(random), uniform(random), uniform(random)}.cwiseProduct(high - low));
  }
  return cloud;
}

// Against the same scan without them. What is called silhouette differs, and so the set. Scans of one sphere by one
// instrument differ by 0.15 mm in R and more, for their residuals are form, not noise: half of the reported range of 49.8
// to 50.1 mm is allowed here.
TEST(FindShapes, IsolatesTheSphereAmongFortyPercentStrayPoints) {
  const std::string root = std::string(FRINGECAL_SHARED_DATA) + "/nist-sphere-scans";
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data not present: " << root;
  const NominalShape nominal[] = {{"sphere 100", ShapeKind::sphere, 100.0}};
  for (int i = 101; i <= 106; i += test::long_tests() ? 1 : 3) {
    const auto points_mm = read_points_mm(root + "/SPH" + std::to_string(i) + ".xyz", LengthUnit::m);
    double clean_mm = 0.0;
    for (const double share : {0.0, 0.1, 0.2, 0.3, 0.4}) {
      if (share > 0.0 && share < 0.4 && !test::long_tests()) continue;
      SCOPED_TRACE(fmt::format("SPH{}, {} stray", i, share));
      const auto found = find_shapes(with_stray(points_mm, share), nominal);
      ASSERT_TRUE(found) << found.error().sentence;
      const FoundShape* sphere = nullptr;
      for (const FoundShape& shape : found->shapes) {
        if (shape.nominal == "sphere 100") sphere = &shape;
      }
      ASSERT_NE(sphere, nullptr);
      std::printf("SPH%d, stray %.0f %%: R %.3f mm, sd %.3f mm, %zu points\n", i, 100 * share,
                  0.5 * sphere->diameter_mm, sphere->standard_deviation_mm, sphere->n_surface);
      if (share == 0.0) clean_mm = sphere->diameter_mm;
      EXPECT_NEAR(0.5 * sphere->diameter_mm, 0.5 * clean_mm, 0.15);
    }
  }
}

/// A sphere of 40 mm on a post of 12 mm on a base plate, seen from above and the front; noise 0.02 mm.
struct Mounted {
  Cloud cloud;
  std::size_t of_sphere = 0;
};
Mounted mounted() {
  Mounted out;
  Random random(77);
  const auto noisy = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& n) {
    out.cloud.push_back(p + 0.02 * normal(random) * n);
  };
  for (int i = 0; i < 9000; ++i) {  // the half that faces (0, -1, 1)
    const double z = 2.0 * uniform(random) - 1.0, a = 2.0 * std::numbers::pi * uniform(random),
                 across = std::sqrt(1.0 - z * z);
    const Eigen::Vector3d n(across * std::cos(a), across * std::sin(a), z);
    if (n.dot(Eigen::Vector3d(0, -0.7, 0.7)) < 0.1 || z < -0.95) continue;
    noisy(20.0 * n, n);
    ++out.of_sphere;
  }
  for (int i = 0; i < 1500; ++i) {
    const double a = std::numbers::pi * (1.0 + uniform(random));
    const Eigen::Vector3d n(std::cos(a), std::sin(a), 0.0);
    noisy(6.0 * n + Eigen::Vector3d(0, 0, -19.0 - 21.0 * uniform(random)), n);
  }
  for (int i = 0; i < 4000; ++i)
    noisy({80.0 * (uniform(random) - 0.5), 60.0 * (uniform(random) - 0.6), -40.0}, {0, 0, 1});
  return out;
}

// Some 2700 points of 0.02 mm on half a sphere know the diameter to 0.001 mm, stray points within 0.07 mm of it are 1 %
// and shift it as much; the margins keep the post out. 0.01 mm is five times both.
TEST(FindShapes, CutsASphereFromItsPostAndBase) {
  const NominalShape nominals[] = {{"ball", ShapeKind::sphere, 40.0}, {"base", ShapeKind::plane, 0.0}};
  for (const double share : {0.0, 0.1, 0.2, 0.3, 0.4}) {
    SCOPED_TRACE(fmt::format("{} stray", share));
    const Mounted scene = mounted();
    const Cloud cloud = with_stray(scene.cloud, share);
    const auto found = find_shapes(cloud, nominals);
    ASSERT_TRUE(found) << found.error().sentence;
    const FoundShape *ball = nullptr, *base = nullptr;
    for (const FoundShape& shape : found->shapes) {
      if (shape.nominal == "ball") ball = &shape;
      if (shape.nominal == "base") base = &shape;
    }
    ASSERT_NE(ball, nullptr);
    ASSERT_NE(base, nullptr);
    for (const FoundShape& shape : found->shapes) {
      std::printf("  %s %s: %zu points, D %.4f mm\n", name_of(shape.kind), shape.nominal.c_str(), shape.n_surface,
                  shape.diameter_mm);
    }
    std::printf("stray %.0f %%: D %.4f mm, %zu of %zu points, margin %zu, silhouette %zu, beyond %zu\n", 100 * share,
                ball->diameter_mm, ball->n_surface, scene.of_sphere, ball->n_margin, ball->n_silhouette,
                ball->n_beyond);
    EXPECT_NEAR(ball->diameter_mm, 40.0, 0.01);
    EXPECT_LT(ball->place_mm.norm(), 0.01);
    EXPECT_NEAR(base->place_mm.z(), -40.0, 0.01);
    EXPECT_GT(ball->n_surface, scene.of_sphere / 2);
    EXPECT_GT(ball->n_silhouette, 0u);
    // every point has one shape and one reason, and the counts are theirs
    std::size_t surface = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      EXPECT_EQ(found->shape_of[i] < 0, found->reason[i] == PointReason::none);
      surface += found->reason[i] == PointReason::surface ? 1u : 0u;
    }
    std::size_t counted = 0;
    for (const FoundShape& shape : found->shapes) counted += shape.n_surface;
    EXPECT_EQ(surface, counted);
  }
}

/// A shape of a random scene and what find_shapes() is to say of it.
struct Truth {
  ShapeKind kind;
  Eigen::Vector3d place_mm, direction;  // centre; a point of the axis; of the plane
  double diameter_mm = 0;
};

/// Two to four partial shapes apart from one another, of one density of points, seen by a scanner above: caps of 40 to 90
/// degrees, sectors of 60 to 170 degrees, rectangles, of 500 points at least; tilted, noise 0.02 to 0.05 mm, in random
/// order.
struct Scene {
  Cloud cloud;
  std::vector<Truth> truths;
};
Scene random_scene(std::uint64_t seed) {
  Scene out;
  Random random(seed);
  const auto between = [&](double low, double high) { return low + (high - low) * uniform(random); };
  const double noise_mm = between(0.02, 0.05), per_mm2 = between(0.4, 2.0);
  const std::size_t count = 2 + random.below(3);
  for (std::size_t s = 0; s < count; ++s) {
    const Eigen::Vector3d at(110.0 * static_cast<double>(s % 2), 110.0 * static_cast<double>(s / 2), between(-30, 30));
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(between(0.0, 2.0 * std::numbers::pi), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(between(-0.6, 0.6), Eigen::Vector3d::UnitX()));
    const auto add = [&](double area_mm2, const auto& place_of) {
      for (int i = 0; i < static_cast<int>(std::max(500.0, area_mm2 * per_mm2)); ++i) {
        const auto [place, normal_there] = place_of();
        out.cloud.push_back(at + turn * (place + noise_mm * normal(random) * normal_there));
      }
    };
    using Oriented = std::pair<Eigen::Vector3d, Eigen::Vector3d>;
    const std::size_t kind = random.below(3);
    const double radius = between(8.0, 30.0);
    if (kind == 0) {
      const double low = std::cos(between(40.0, 90.0) * std::numbers::pi / 180.0);
      out.truths.push_back({ShapeKind::sphere, at, Eigen::Vector3d::Zero(), 2.0 * radius});
      add(2.0 * std::numbers::pi * radius * radius * (1.0 - low), [&] {
        const double z = between(low, 1.0), a = between(0.0, 2.0 * std::numbers::pi), across = std::sqrt(1.0 - z * z);
        const Eigen::Vector3d n(across * std::cos(a), across * std::sin(a), z);
        return Oriented{radius * n, n};
      });
    } else if (kind == 1) {
      const double half = 0.5 * between(60.0, 170.0) * std::numbers::pi / 180.0, length = between(20.0, 80.0);
      out.truths.push_back({ShapeKind::cylinder, at, turn * Eigen::Vector3d::UnitX(), 2.0 * radius});
      add(2.0 * half * radius * length, [&] {
        const double a = between(-half, half);
        const Eigen::Vector3d n(0.0, std::sin(a), std::cos(a));
        return Oriented{radius * n + Eigen::Vector3d(between(-0.5, 0.5) * length, 0, 0), n};
      });
    } else {
      const double width = between(20.0, 70.0), height = between(20.0, 70.0);
      out.truths.push_back({ShapeKind::plane, at, turn * Eigen::Vector3d::UnitZ(), 0.0});
      add(width * height, [&] {
        return Oriented{Eigen::Vector3d(width * between(-0.5, 0.5), height * between(-0.5, 0.5), 0.0),
                        Eigen::Vector3d::UnitZ()};
      });
    }
  }
  out.cloud = with_stray(std::move(out.cloud), 0.4);
  for (std::size_t i = out.cloud.size(); i > 1; --i) std::swap(out.cloud[i - 1], out.cloud[random.below(i)]);
  return out;
}

// Stray points within 3.5 deviations of a surface lie evenly on both of its sides and leave its size; the scatter of a
// diameter is its u: five of them, and 0.005 mm for what the edges of the set do. A plane's centroid has no place of its own
// but the plane: its distance from it, five times noise over the root of 500 points, is below 0.015 mm.
bool is_of(const FoundShape& found, const Truth& truth) {
  constexpr double kDirection = 0.01, kPlace_mm = 0.5;  // which shape it is, not how good
  if (found.kind != truth.kind) return false;
  const Eigen::Vector3d u = found.place_mm - truth.place_mm;
  if (truth.kind == ShapeKind::plane) {
    return found.direction.cross(truth.direction).norm() < kDirection && std::abs(truth.direction.dot(u)) < 0.015;
  }
  if (!(std::abs(found.diameter_mm - truth.diameter_mm) < 5.0 * found.u_diameter_mm + 0.005)) return false;
  if (truth.kind == ShapeKind::sphere) return u.norm() < kPlace_mm;
  return found.direction.cross(truth.direction).norm() < kDirection && truth.direction.cross(u).norm() < kPlace_mm;
}

TEST(FindShapes, FindsPartialShapesAndNothingElseAmongFortyPercentStrayPoints) {
  std::size_t present = 0, found_count = 0, false_count = 0;
  double farthest_mm = 0.0, farthest_u = 0.0;  // of the diameters found
  for (int seed = 1; seed <= (test::long_tests() ? 20 : 2); ++seed) {
    const Scene scene = random_scene(static_cast<std::uint64_t>(seed));
    const auto found = find_shapes(scene.cloud);
    ASSERT_TRUE(found) << found.error().sentence;
    std::vector<bool> is_known(found->shapes.size(), false);
    std::string missed;
    for (const Truth& truth : scene.truths) {
      ++present;
      bool is_found = false;
      for (std::size_t s = 0; s < found->shapes.size(); ++s) {
        if (is_known[s] || is_found || !is_of(found->shapes[s], truth)) continue;
        is_known[s] = is_found = true;
        if (truth.kind == ShapeKind::plane) continue;
        const double error_mm = std::abs(found->shapes[s].diameter_mm - truth.diameter_mm);
        farthest_mm = std::max(farthest_mm, error_mm);
        farthest_u = std::max(farthest_u, error_mm / found->shapes[s].u_diameter_mm);
      }
      found_count += is_found ? 1u : 0u;
      if (!is_found) missed += fmt::format("; missed: {} of {:.3f} mm", name_of(truth.kind), truth.diameter_mm);
    }
    for (std::size_t s = 0; s < found->shapes.size(); ++s) {
      if (is_known[s]) continue;
      ++false_count;
      const FoundShape& shape = found->shapes[s];
      missed += fmt::format("; false: {} of {:.3f} +- {:.3f} mm, {} points", name_of(shape.kind), shape.diameter_mm,
                            shape.u_diameter_mm, shape.n_surface);
    }
    std::printf("scene %d: %zu shapes, %zu points%s\n", seed, scene.truths.size(), scene.cloud.size(), missed.c_str());
  }
  std::printf("%zu shapes, %zu found, %zu missed, %zu false; diameters within %.4f mm, %.1f u\n", present, found_count,
              present - found_count, false_count, farthest_mm, farthest_u);
  EXPECT_EQ(found_count, present);
  EXPECT_EQ(false_count, 0u);
}

TEST(FindShapes, SaysWhereThereIsNone) {
  Random random(5);
  Cloud cloud;
  for (int i = 0; i < 3000; ++i) cloud.push_back({uniform(random), uniform(random), uniform(random)});
  EXPECT_FALSE(find_shapes(cloud));
  EXPECT_FALSE(find_shapes(Points(cloud).first(10)));
  EXPECT_FALSE(find_shapes(Cloud(500, Eigen::Vector3d(1, 2, 3))));
}

}  // namespace
}  // namespace fringecal::fitting

// Many pixels at once against one by one, and the same bytes on every width of vectors.
#include "calib/model/triangulate_span.h"

#include "calib/model/triangulate.h"
#include "tests/metrology/exact_phase_map.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstring>
#include <numbers>
#include <vector>

namespace fringecal::model {
namespace {

struct Result {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> slopes;
  friend bool operator==(const Result&, const Result&) = default;
};

/// Phases of a rough surface: every pixel has a depth of its own.
std::vector<float> rough_phases(const Scanner& scanner, const RayTable& rays, CodeAxis axis) {
  std::vector<float> phases;
  const auto& coded = scanner.projector.axis(axis);
  for (std::size_t i = 0; i < rays.x.size(); ++i) {
    const double depth = 950.0 + 250.0 * static_cast<double>(i * 7919 % 1000) / 1000.0;
    const Eigen::Vector3d point = depth * Eigen::Vector3d(rays.x.values()[i], rays.y.values()[i], 1.0);
    const auto u = scanner.projector.project(axis, scanner.proj_from_cam * point);
    phases.push_back(static_cast<float>(coded->code.phase_from_u(u.value())));
  }
  return phases;
}

Result run(const Scanner& scanner, const RayTable& rays, const std::vector<float>& phases, CodeAxis axis,
           std::size_t cut) {
  Result out{std::vector<Eigen::Vector3d>(phases.size()), std::vector<double>(phases.size())};
  SpanTask task = span_task(scanner.projector, scanner.proj_from_cam, axis);
  task.ray_x = rays.x.data();
  task.ray_y = rays.y.data();
  task.phase_rad = phases.data();
  task.points_mm = out.points.data();
  task.du_per_mm = out.slopes.data();
  for (std::size_t first = 0; first < phases.size(); first += cut) {
    triangulate_span(task, first, std::min(cut, phases.size() - first));
  }
  return out;
}

/// The sample scanner with all distortion terms, coded along both axes.
Scanner full_scanner() {
  Scanner s = test::sample_scanner();
  s.projector.distortion = {-0.08, 0.03, 4e-4, -3e-4, 0.01};
  s.projector.y = s.projector.x;
  s.projector.y->f = -31.0;
  // A base along y too, so that the code along y measures.
  s.proj_from_cam.translation_mm.y() += 300;
  return s;
}

TEST(TriangulateSpan, IsTriangulateForEveryPixelWithinATenthOfAMicrometre) {
  const Scanner scanner = full_scanner();
  const RayTable rays = ray_table(scanner.camera);
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    const auto phases = rough_phases(scanner, rays, axis);
    const Result all = run(scanner, rays, phases, axis, phases.size());
    double worst_mm = 0, worst_slope = 0;
    for (int y = 0; y < scanner.camera.height_px; ++y) {
      for (int x = 0; x < scanner.camera.width_px; ++x) {
        const std::size_t i = rays.x.index(x, y);
        const double u = scanner.projector.axis(axis)->code.u_from_phase(phases[i]);
        const auto point =
            triangulate(scanner.camera, scanner.projector, scanner.proj_from_cam, axis, Eigen::Vector2d(x, y), u);
        ASSERT_TRUE(point);
        ASSERT_GT(all.slopes[i], 0.0);
        worst_mm = std::max(worst_mm, (*point - all.points[i]).norm());
        const auto slope =
            du_per_mm(scanner.projector, scanner.proj_from_cam, axis, *point, Eigen::Vector3d(point->normalized()));
        worst_slope = std::max(worst_slope, std::abs(all.slopes[i] / slope.value() - 1.0));
      }
    }
    // The table is exact; what is left is double's rounding of the equation's root, some 1e-16 of 1000 mm over the
    // sine of the angle between ray and plane of light (0.3) and a few operations: below 1e-10 mm. Asked for: 1e-4 mm.
    EXPECT_LT(worst_mm, 1e-9);
    EXPECT_LT(worst_slope, 1e-8);  // the central difference's own error
  }
}

TEST(TriangulateSpan, GivesTheSameBytesOnEveryWidthOfVectorsAndHoweverItIsCut) {
  const Scanner scanner = full_scanner();
  const RayTable rays = ray_table(scanner.camera);
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    const auto phases = rough_phases(scanner, rays, axis);
    const Result best = run(scanner, rays, phases, axis, phases.size());
    for (const std::size_t cut : {1009u, 13u}) EXPECT_TRUE(run(scanner, rays, phases, axis, cut) == best) << cut;
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      EXPECT_TRUE(run(scanner, rays, phases, axis, 5000) == best) << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
}

TEST(TriangulateSpan, LeavesToTheOtherWhatHasNoPoint) {
  const Scanner scanner = full_scanner();
  const RayTable rays = ray_table(scanner.camera);
  auto phases = rough_phases(scanner, rays, CodeAxis::x);
  phases[100] = std::numeric_limits<float>::quiet_NaN();
  phases[200] = -3000.0f;  // a plane of light that meets the ray behind the camera, or nowhere
  const Result all = run(scanner, rays, phases, CodeAxis::x, phases.size());
  for (const std::size_t i : {100u, 200u}) {
    EXPECT_EQ(all.slopes[i], 0.0);
    EXPECT_TRUE(all.points[i].isZero());
  }
  EXPECT_GT(all.slopes[101], 0.0);
}

}  // namespace
}  // namespace fringecal::model

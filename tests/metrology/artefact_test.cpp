// Artefacts found and evaluated in clouds of known surfaces with known noise along the camera's rays.
#include "metrology/artefact.h"

#include "core/error.h"
#include "metrology/reconstruct.h"
#include "metrology/segment.h"
#include "tests/metrology/exact_phase_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <random>

namespace fringecal::metrology {
namespace {

using ::testing::HasSubstr;

/// The sample scanner with twice the pixels: 0.7 mm each on R.
model::Scanner fine_scanner() {
  auto s = test::sample_scanner();
  s.camera.width_px *= 2;
  s.camera.height_px *= 2;
  s.camera.fx_px *= 2;
  s.camera.fy_px *= 2;
  s.camera.cx_px *= 2;
  s.camera.cy_px *= 2;
  return s;
}

/// The nearest of several surfaces.
test::Surface nearest(std::vector<test::Surface> surfaces) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
    std::optional<double> first;
    for (const auto& surface : surfaces) {
      const auto l = surface(o, d);
      if (l && (!first || *l < *first)) first = l;
    }
    return first;
  };
}

const std::vector<Eigen::Vector3d> kCentres = {{-90, 10, 30}, {-20, -15, 25}, {70, 20, 40}};

PointCloud three_spheres(const model::Scanner& scanner, double noise_mm, unsigned seed) {
  const auto map = test::exact_map(
      scanner, nearest({test::sphere(kCentres[0], 15), test::sphere(kCentres[1], 19), test::sphere(kCentres[2], 25)}));
  auto cloud = reconstruct(map, scanner, {.edge_margin_px = 0, .normals = false}).cloud;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0.0, noise_mm);
  const Eigen::Vector3d camera = scanner.world_from_cam().translation_mm;
  for (auto& p : cloud.points) p.position_mm += normal(random) * (p.position_mm - camera).normalized();
  return cloud;
}

const std::vector<NominalArtefact> kNominals = {{"sphere 50", ArtefactKind::sphere, 50},
                                                {"sphere 30", ArtefactKind::sphere, 30},
                                                {"sphere 38", ArtefactKind::sphere, 38}};
const ArtefactOptions kOptions = {.max_gap_mm = 4.0, .min_points = 300};  // 0.7 mm per pixel instead of 0.3

TEST(MeasureArtefacts, FindsEachSphereByItsDiameterAndMeasuresIt) {
  const auto scanner = fine_scanner();
  const auto found = measure_artefacts(three_spheres(scanner, 0.03, 1), scanner, kNominals, kOptions);
  ASSERT_TRUE(found) << found.error().sentence;
  ASSERT_EQ(found->size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& m = (*found)[i];
    EXPECT_EQ(m.name, kNominals[i].name);
    // Four standard uncertainties: one such test in 16000 fails by chance.
    EXPECT_NEAR(*m.diameter_mm, kNominals[i].diameter_mm, 4 * m.u_diameter_noise_mm);
    EXPECT_LT(m.u_diameter_noise_mm, 0.02);
    // The noise lies along the ray: across the surface it is 0.03 cos(incidence), 1 to 0.5 of it within 60 degrees.
    EXPECT_GT(m.form_standard_deviation_mm, 0.015);
    EXPECT_LT(m.form_standard_deviation_mm, 0.031);
    EXPECT_GT(m.n_grazing, 0u);
    EXPECT_EQ(m.points_mm.size(), m.n_points);
    std::size_t in_picture = 0;
    for (const float d : m.deviation_mm.values()) in_picture += std::isfinite(d) ? 1 : 0;
    EXPECT_EQ(in_picture, m.n_points);
  }
  EXPECT_LT(((*found)[0].place_mm - kCentres[2]).norm(), 0.02);
}

TEST(MeasureArtefacts, KeepsOnlyPointsThatFaceBothCameraAndProjector) {
  const auto scanner = fine_scanner();
  const auto found = measure_artefacts(three_spheres(scanner, 0.03, 2), scanner, kNominals, kOptions);
  ASSERT_TRUE(found);
  const Eigen::Vector3d camera = scanner.world_from_cam().translation_mm,
                        projector = scanner.world_from_proj().translation_mm;
  for (const auto& p : (*found)[0].points_mm) {
    const Eigen::Vector3d n = (p - kCentres[2]).normalized();
    // The rule uses the fitted centre: 0.02 mm off on a radius of 25 mm is 0.001 in the cosine.
    ASSERT_GE(n.dot((camera - p).normalized()), 0.5 - 0.001);
    ASSERT_GE(n.dot((projector - p).normalized()), 0.5 - 0.001);
  }
}

TEST(MeasureArtefacts, DropsGrossErrorsAndCountsThem) {
  const auto scanner = fine_scanner();
  auto cloud = three_spheres(scanner, 0.03, 3);
  const Eigen::Vector3d camera = scanner.world_from_cam().translation_mm;
  std::size_t moved = 0;
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    Eigen::Vector3d& p = cloud.points[i].position_mm;
    const Eigen::Vector3d from_centre = p - kCentres[2];
    // Every fiftieth point that faces the camera well, 1 mm off: 33 times the noise, less than the gap of a segment.
    if (i % 50 != 0 || from_centre.norm() > 26 || from_centre.normalized().dot((camera - p).normalized()) < 0.9)
      continue;
    p += (camera - p).normalized();
    ++moved;
  }
  ASSERT_GT(moved, 3u);
  const auto found = measure_artefacts(cloud, scanner, kNominals, kOptions);
  ASSERT_TRUE(found);
  EXPECT_EQ((*found)[0].n_gross, moved);
  EXPECT_NEAR(*(*found)[0].diameter_mm, 50.0, 4 * (*found)[0].u_diameter_noise_mm);
}

TEST(MeasureArtefacts, NamesTheArtefactThatIsNotThere) {
  const auto scanner = fine_scanner();
  const std::vector<NominalArtefact> wanted = {{"sphere 30", ArtefactKind::sphere, 30},
                                               {"sphere 80", ArtefactKind::sphere, 80}};
  const auto found = measure_artefacts(three_spheres(scanner, 0.03, 4), scanner, wanted, kOptions);
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().sentence, HasSubstr("sphere 80"));
  EXPECT_THAT(found.error().sentence, HasSubstr("50."));  // and what was there instead
}

TEST(MeasureArtefacts, MeasuresAPlanesFormByTheNoiseAcrossIt) {
  const auto scanner = test::sample_scanner();
  auto cloud = reconstruct(test::exact_map(scanner, test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ())), scanner,
                           {.edge_margin_px = 0, .normals = false})
                   .cloud;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0.0, 0.03);
  for (auto& p : cloud.points) p.position_mm.z() += normal(random);
  const std::vector<NominalArtefact> wanted = {{"plane", ArtefactKind::plane, 0}};
  const auto found = measure_artefacts(cloud, scanner, wanted, {.max_gap_mm = 6.0});
  ASSERT_TRUE(found) << found.error().sentence;
  const auto& plane = found->front();
  EXPECT_FALSE(plane.diameter_mm.has_value());
  // The standard deviation of n = 76800 values scatters by 1/sqrt(2 n) = 0.26 %; four of that.
  EXPECT_NEAR(plane.form_standard_deviation_mm, 0.03, 0.03 * 0.0105);
}

TEST(SegmentsOf, KeepsWhatTouchesTogetherLargestFirst) {
  const auto scanner = fine_scanner();
  const auto cloud = three_spheres(scanner, 0.0, 1);
  const auto segments = segments_of(cloud, 4.0, 100);
  ASSERT_EQ(segments.size(), 3u);
  EXPECT_GE(segments[0].size(), segments[1].size());
  EXPECT_GE(segments[1].size(), segments[2].size());
  std::size_t total = 0;
  for (const auto& segment : segments) total += segment.size();
  EXPECT_EQ(total, cloud.points.size());
}

TEST(StatisticsOf, GivesMeanScatterAndTheLargestForm) {
  const std::vector<RepeatValue> repeats = {{30.01, 0.030}, {30.03, 0.034}, {30.02, 0.032}};
  const auto s = statistics_of(repeats);
  EXPECT_EQ(s.n, 3);
  // Exact decimals but for rounding.
  EXPECT_NEAR(*s.mean_diameter_mm, 30.02, 1e-12);
  EXPECT_NEAR(*s.repeatability_sd_mm, 0.01, 1e-12);
  EXPECT_DOUBLE_EQ(s.max_form_sd_mm, 0.034);
  EXPECT_NEAR(s.mean_form_sd_mm, 0.032, 1e-12);
  // Eq. 3: sqrt(0.01^2 / 3 + 0.002^2 + 0.0006^2)
  EXPECT_NEAR(u_of_error_mm(s, 0.002, 0.0006), std::sqrt(1e-4 / 3 + 4e-6 + 3.6e-7), 1e-12);
}

TEST(StatisticsOf, HasNoDiameterForAPlaneAndNoScatterForOneRepeat) {
  const std::vector<RepeatValue> plane = {{std::nullopt, 0.03}, {std::nullopt, 0.02}}, once = {{30.0, 0.03}};
  EXPECT_FALSE(statistics_of(plane).mean_diameter_mm.has_value());
  EXPECT_FALSE(statistics_of(once).repeatability_sd_mm.has_value());
  EXPECT_THROW(statistics_of({}), std::logic_error);
}

}  // namespace
}  // namespace fringecal::metrology

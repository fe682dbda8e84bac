// Reconstruction from exact phase maps: known surfaces seen through the scanner's own projection.
#include "metrology/reconstruct.h"

#include "calib/model/triangulate.h"
#include "core/error.h"
#include "metrology/calibration_uncertainty.h"
#include "tests/metrology/exact_phase_map.h"
#include "tests/support/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace fringecal::metrology {
namespace {

using test::exact_map;
using test::ideal_scanner;
using test::sample_scanner;
using ::testing::HasSubstr;

// phase_rad is a float: up to 400 rad its last place is 3.1e-5 rad, half of that rounds. One radian is at most 4 mm
// along the ray here: 6e-5 mm.
constexpr double kFloatPhaseMm = 6e-5;

TEST(Reconstruct, GivesBackAPlane) {
  const auto scanner = sample_scanner();
  const Eigen::Vector3d n = Eigen::Vector3d(0.2, -0.1, 1.0).normalized();
  const auto result = reconstruct(exact_map(scanner, test::plane({0, 0, 15}, n)), scanner, {.edge_margin_px = 0});
  EXPECT_EQ(result.cloud.points.size(), 320u * 240u);
  for (const auto& p : result.cloud.points) {
    ASSERT_LT(std::abs(n.dot(p.position_mm - Eigen::Vector3d(0, 0, 15))), kFloatPhaseMm);
  }
}

TEST(Reconstruct, GivesPointsThatProjectToTheirPixelAndTheirPhase) {
  const auto scanner = sample_scanner();
  const auto map = exact_map(scanner, test::sphere({10, 5, 30}, 40));
  const auto result = reconstruct(map, scanner, {.edge_margin_px = 0});
  ASSERT_GT(result.cloud.points.size(), 2000u);
  for (const auto& p : result.cloud.points) {
    const auto pixel = scanner.camera.project(scanner.world_from_cam().inverse() * p.position_mm);
    const auto u = scanner.projector.project(CodeAxis::x, scanner.world_from_proj().inverse() * p.position_mm);
    ASSERT_TRUE(pixel && u);
    // Rounding of double through two lens models of 1e3 px and 15 mm.
    ASSERT_NEAR(pixel->x(), p.pixel_x, 1e-8);
    ASSERT_NEAR(pixel->y(), p.pixel_y, 1e-8);
    ASSERT_NEAR(*u, map.u_at(p.pixel_x, p.pixel_y), 1e-10);
    ASSERT_NEAR((p.position_mm - Eigen::Vector3d(10, 5, 30)).norm(), 40.0, 3 * kFloatPhaseMm);  // grazing: longer rays
  }
}

TEST(Reconstruct, NormalsAreThoseOfTheSurface) {
  const auto scanner = sample_scanner();
  const Eigen::Vector3d centre(10, 5, 30);
  const auto result = reconstruct(exact_map(scanner, test::sphere(centre, 60)), scanner);
  std::size_t with_normal = 0;
  for (const auto& p : result.cloud.points) {
    if (p.normal.isZero()) continue;
    ++with_normal;
    // The chord over +-2 px of 1.4 mm seen up to 70 degrees off, 16 mm on a radius of 60, is symmetric but for the
    // change of scale: (16/60)^2 / 2 = 0.036 at the rim.
    ASSERT_GT(p.normal.dot((p.position_mm - centre).normalized()), 1 - 0.036);
    ASSERT_NEAR(p.normal.norm(), 1.0, 1e-12);
  }
  EXPECT_GT(with_normal, result.cloud.points.size() * 9 / 10);
}

TEST(Reconstruct, CarriesThePhaseNoiseAlongTheRay) {
  const auto scanner = sample_scanner();
  auto map = exact_map(scanner, test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ()));
  const auto before = reconstruct(map, scanner, {.edge_margin_px = 0}).cloud;
  for (float& phase : map.phase_rad.values()) phase += 0.01f;
  const auto after = reconstruct(map, scanner, {.edge_margin_px = 0}).cloud;
  ASSERT_EQ(before.points.size(), after.points.size());
  for (std::size_t i = 0; i < before.points.size(); i += 97) {
    // u(phi) of the map is 0.01 rad: the same step moves the point by u, to the curvature over 0.03 mm in 500 mm and
    // the float's rounding.
    const double moved = (after.points[i].position_mm - before.points[i].position_mm).norm();
    ASSERT_NEAR(moved, before.points[i].u_along_ray_mm, 2e-4 * moved + 2 * kFloatPhaseMm);
  }
}

TEST(Reconstruct, LeavesOutByNameWhatItCannotUse) {
  const auto scanner = sample_scanner();
  auto map = exact_map(scanner, test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ()));
  map.validity(100, 100) = 3;
  map.u_phase_rad(200, 50) = 5.0f;
  const auto result = reconstruct(map, scanner, {.edge_margin_px = 2});
  EXPECT_EQ(result.n_invalid, 1u);
  EXPECT_EQ(result.n_edge, 24u);  // 5 x 5 around it
  EXPECT_EQ(result.n_noisy, 1u);
  EXPECT_EQ(result.n_no_intersection, 0u);
  EXPECT_EQ(result.cloud.points.size(), 320u * 240u - 26u);
}

// Counted by hand: a speck of 3 x 3 pixels 40 mm above a board is a piece of its own (its edge is a jump), one pixel has half of
// the modulation. Without an edge margin the speck keeps its 9 points, and the board its own.
TEST(Reconstruct, LeavesOutDimAndIsolatedPointsWhereAsked) {
  const auto scanner = sample_scanner();
  const auto board = exact_map(scanner, test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ()));
  const auto above = exact_map(scanner, test::plane({0, 0, 40}, Eigen::Vector3d::UnitZ()));
  auto map = board;
  for (int y = 100; y < 103; ++y) {
    for (int x = 150; x < 153; ++x) map.phase_rad(x, y) = above.phase_rad(x, y);
  }
  const float usual = map.modulation(0, 0);
  ASSERT_GT(usual, 0);
  map.modulation(10, 20) = 0.5f * usual;
  const auto all = reconstruct(map, scanner, {.edge_margin_px = 0});
  EXPECT_EQ(all.n_isolated + all.n_low_modulation, 0u);
  const auto some = reconstruct(map, scanner, {.edge_margin_px = 0, .min_modulation = 0.75 * usual, .min_piece = 10});
  EXPECT_EQ(some.n_isolated, 9u);
  EXPECT_EQ(some.n_low_modulation, 1u);
  EXPECT_EQ(some.cloud.points.size(), all.cloud.points.size() - 10u);
  EXPECT_EQ(reconstruct(map, scanner, {.edge_margin_px = 0, .min_piece = 9}).n_isolated, 0u);
}

// The rule is on the normal found in the map; what it left is what an unfiltered cloud has within the angle.
TEST(Reconstruct, LeavesOutGrazingPointsWhereAsked) {
  const auto scanner = sample_scanner();
  const auto map = exact_map(scanner, test::sphere({0, 0, 0}, 60));
  const auto all = reconstruct(map, scanner), some = reconstruct(map, scanner, {.max_incidence_deg = 50});
  const Eigen::Vector3d camera = scanner.world_from_cam().translation_mm,
                        light = scanner.world_from_proj().translation_mm;
  std::size_t expected = 0;
  for (const auto& p : all.cloud.points) {
    const auto faces = [&](const Eigen::Vector3d& pupil) {
      return p.normal.dot((pupil - p.position_mm).normalized()) >= std::cos(50 * M_PI / 180);
    };
    expected += p.normal.isZero() || (faces(camera) && faces(light)) ? 1 : 0;
  }
  EXPECT_EQ(some.cloud.points.size(), expected);
  EXPECT_GT(some.n_grazing, all.cloud.points.size() / 10);
  EXPECT_EQ(some.n_grazing + some.cloud.points.size(), all.cloud.points.size());
}

TEST(Reconstruct, LeavesOutTheTwoSidesOfAStepInDepth) {
  const auto scanner = sample_scanner();
  const auto step = [&](const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
    // Z = 0 where the ray passes left of X = 0 there, else Z = 40.
    const auto low = test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ())(origin, direction);
    const auto high = test::plane({0, 0, 40}, Eigen::Vector3d::UnitZ())(origin, direction);
    return (origin + *low * direction).x() < 0 ? low : high;
  };
  const auto result = reconstruct(exact_map(scanner, step), scanner, {.edge_margin_px = 2});
  // Two columns on either side; where the edge leaps to the next column, a few more.
  EXPECT_GE(result.n_edge, 240u * 4u);
  EXPECT_LE(result.n_edge, 240u * 4u + 8u);
}

TEST(Reconstruct, IsInOrderAndTheSameEveryTime) {
  const auto scanner = sample_scanner();
  const auto map = exact_map(scanner, test::sphere({0, 0, 0}, 50));
  const auto a = reconstruct(map, scanner).cloud, b = reconstruct(map, scanner).cloud;
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    ASSERT_EQ(a.points[i].position_mm, b.points[i].position_mm);
    if (i > 0) {
      const auto &p = a.points[i - 1], &q = a.points[i];
      ASSERT_TRUE(p.pixel_y < q.pixel_y || (p.pixel_y == q.pixel_y && p.pixel_x < q.pixel_x));
    }
  }
}

TEST(Reconstruct, ClosedFormEqualsTheFullModelWhereThePapersGeometryIsExact) {
  const auto scanner = ideal_scanner();
  const auto map = exact_map(scanner, test::sphere({5, -8, 20}, 70));
  const auto full = reconstruct(map, scanner, {.edge_margin_px = 0}).cloud;
  const auto ideal = reconstruct(map, scanner, {.model = ReconstructionModel::ideal, .edge_margin_px = 0}).cloud;
  const auto paper = reconstruct(map, scanner, {.model = ReconstructionModel::chen2008, .edge_margin_px = 0}).cloud;
  ASSERT_GT(full.points.size(), 5000u);
  ASSERT_EQ(full.points.size(), ideal.points.size());
  ASSERT_EQ(full.points.size(), paper.points.size());
  // The same phase goes into all: only rounding is left.
  for (std::size_t i = 0; i < full.points.size(); ++i) {
    ASSERT_LT((full.points[i].position_mm - ideal.points[i].position_mm).norm(), 1e-6);
    ASSERT_LT((full.points[i].position_mm - paper.points[i].position_mm).norm(), 1e-6);
  }
}

TEST(Reconstruct, TakesTheFittedClosedFormWhereTheScannerHasOne) {
  auto scanner = ideal_scanner();
  const auto map = exact_map(scanner, test::plane({0, 0, 20}, Eigen::Vector3d::UnitZ()));
  // A base twice as long halves the height of small shifts: eqs. 1, 2.
  scanner.paper_model = model::FittedChen2008{.model = model::chen2008_from(scanner)};
  scanner.paper_model->model.b_mm *= 2;
  const auto paper = reconstruct(map, scanner, {.model = ReconstructionModel::chen2008, .edge_margin_px = 0}).cloud;
  const auto ideal = reconstruct(map, scanner, {.model = ReconstructionModel::ideal, .edge_margin_px = 0}).cloud;
  ASSERT_EQ(paper.points.size(), 320u * 240u);
  for (const auto& p : paper.points) {
    // S = 20 b / 980, so Z = L S / (2 b + S) = 1000 / 99.
    ASSERT_NEAR(p.position_mm.z(), 1000.0 / 99.0, kFloatPhaseMm);
  }
  for (const auto& p : ideal.points) ASSERT_NEAR(p.position_mm.z(), 20.0, kFloatPhaseMm);
}

TEST(Reconstruct, RefusesACaptureOfAnotherInstrument) {
  const auto scanner = sample_scanner();
  const auto map = exact_map(scanner, test::plane({0, 0, 0}, Eigen::Vector3d::UnitZ()));
  auto smaller = scanner;
  smaller.camera.width_px = 319;
  EXPECT_THROW(reconstruct(map, smaller), InputError);
  auto other_code = map;
  other_code.code.period = 0.25;
  EXPECT_THROW(reconstruct(other_code, scanner), InputError);
  auto other_axis = map;
  other_axis.axis = CodeAxis::y;
  EXPECT_THROW(reconstruct(other_axis, scanner), InputError);
}

// The same from the phase itself: each point's u is read o higher and o lower and triangulated by the Scanner as it is.
TEST(PhaseOffset, MakesOfALengthWhatShiftedPhasesMakeOfIt) {
  model::Scanner s = test::sample_scanner();
  const PointGroups points = {{{-40, 5, -60}}, {{50, -10, 60}}};
  const auto length = [](const PointGroups& p) -> Result<std::vector<double>> {
    return std::vector<double>{(p[0].front() - p[1].front()).norm()};
  };
  const auto none = u_from_phase_offset(points, s, length);
  ASSERT_TRUE(none) << none.error().sentence;
  EXPECT_EQ(none->front(), 0.0) << "the Scanner states no offset";

  constexpr double kOffset = 2e-4;
  s.uncertainty.names = {"camera.fx_px", "projector.x.u0"};
  s.uncertainty.covariance = Eigen::Vector2d(1e-4, 1e-8).asDiagonal();
  s.priors.push_back({"capture.phase_offset", 0.0, kOffset, "estimated from the views"});
  const auto u = u_from_phase_offset(points, s, length);
  ASSERT_TRUE(u) << u.error().sentence;
  double lengths[2];
  for (const int side : {0, 1}) {
    std::vector<Eigen::Vector3d> moved;
    for (const auto& group : points) {
      const Eigen::Vector3d in_cam = s.world_from_cam().inverse() * group.front();
      const auto pixel = s.camera.project(in_cam);
      const auto read = s.projector.project(CodeAxis::x, s.proj_from_cam * in_cam);
      ASSERT_TRUE(pixel && read);
      const auto at = model::triangulate(s.camera, s.projector, s.proj_from_cam, CodeAxis::x, *pixel,
                                         *read + (side == 0 ? -kOffset : kOffset));
      ASSERT_TRUE(at);
      moved.push_back(s.world_from_cam() * *at);
    }
    lengths[side] = (moved[0] - moved[1]).norm();
  }
  // 0.2 um on the grating are 6 um across at 1000 mm; of the length some um. Rounding of the intersections: 1e-9 mm.
  EXPECT_GT(u->front(), 5e-4);
  EXPECT_NEAR(u->front(), 0.5 * std::abs(lengths[1] - lengths[0]), 1e-8);
}

TEST(PointCloudFile, ReadsBackWhatWasWritten) {
  const auto scanner = sample_scanner();
  const auto cloud = reconstruct(exact_map(scanner, test::sphere({0, 0, 0}, 50)), scanner).cloud;
  const test::ScratchFolder scratch;
  write_ply(scratch / "cloud.ply", cloud);
  const auto back = read_ply(scratch / "cloud.ply");
  ASSERT_EQ(back.points.size(), cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const auto &a = cloud.points[i], &b = back.points[i];
    ASSERT_EQ(a.position_mm, b.position_mm);
    ASSERT_LT((a.normal - b.normal).norm(), 1.1e-7);  // half the last place of a float below 1, three components
    ASSERT_FLOAT_EQ(static_cast<float>(a.u_along_ray_mm), static_cast<float>(b.u_along_ray_mm));
    ASSERT_EQ(a.modulation, b.modulation);
    ASSERT_EQ(a.pixel_x, b.pixel_x);
    ASSERT_EQ(a.pixel_y, b.pixel_y);
  }
}

TEST(PointCloudFile, RefusesATruncatedOrForeignFile) {
  const test::ScratchFolder scratch;
  write_ply(scratch / "cloud.ply", PointCloud{.points = std::vector<CloudPoint>(3)});
  std::filesystem::resize_file(scratch / "cloud.ply", std::filesystem::file_size(scratch / "cloud.ply") - 1);
  EXPECT_THROW(read_ply(scratch / "cloud.ply"), InputError);
  std::ofstream(scratch / "other.ply") << "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n";
  EXPECT_THROW(read_ply(scratch / "other.ply"), InputError);
  EXPECT_THROW(read_ply(scratch / "absent.ply"), InputError);
}

}  // namespace
}  // namespace fringecal::metrology

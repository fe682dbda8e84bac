// A cloud against a surface that is known: an ellipsoid, moved and with noise, and a dent in its front.
#include "metrology/deviation_map.h"

#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <random>

namespace fringecal::metrology {
namespace {

constexpr double kNoise = 0.03;  // mm
const Eigen::Vector3d kHalf(160, 125, 100);

double distance(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = p.cwiseQuotient(kHalf);
  return (q.norm() - 1) / q.cwiseQuotient(kHalf).norm() * q.norm();  // f / |grad f|
}

Eigen::Vector3d normal_of(const Eigen::Vector3d& p) { return p.cwiseQuotient(kHalf).cwiseQuotient(kHalf).normalized(); }

const Rigid3 kBodyFromPart{Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, -1).normalized())),
                           Eigen::Vector3d(12, -7, 30)};

PointCloud cloud_of(double dent_mm) {
  std::mt19937_64 generator(3);
  std::normal_distribution<double> normal;
  PointCloud out;
  for (int i = 0; i < 60'000; ++i) {
    const Eigen::Vector3d u = Eigen::Vector3d{normal(generator), normal(generator), normal(generator)}.normalized();
    const Eigen::Vector3d p = u.cwiseProduct(kHalf), n = normal_of(p);
    const double off = kNoise * normal(generator) - (p.z() > 0 && p.head<2>().norm() < 20 ? dent_mm : 0);
    CloudPoint point;
    point.position_mm = kBodyFromPart.inverse() * Eigen::Vector3d(p + off * n);
    point.normal = kBodyFromPart.rotation.inverse() * n;
    out.points.push_back(point);
  }
  return out;
}

Rigid3 rough() {
  return Rigid3{Eigen::Quaterniond(Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY())),
                Eigen::Vector3d(0.8, -0.6, 0.5)} *
         kBodyFromPart;
}

// 20 000 samples of 0.03 mm: the motion is known to 1 um even where the ellipsoid's own form holds it weakly (its axes differ by
// a quarter); 5 um is a multiple. The standard deviation of 60 000 points is known to 0.3 %: three of these.
TEST(DeviationMap, FindsTheMotionAndTheNoise) {
  const auto cloud = cloud_of(0);
  const auto map = deviation_map(cloud, distance, rough());
  ASSERT_TRUE(map) << map.error().sentence;
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(100, 0, 0), Eigen::Vector3d(0, 100, 0), Eigen::Vector3d(0, 0, 100)}) {
    EXPECT_LT((map->body_from_part * p - kBodyFromPart * p).norm(), 0.005);
  }
  EXPECT_EQ(map->n_points, cloud.points.size());
  EXPECT_NEAR(map->sd_mm, kNoise, 3 * 0.003 * kNoise);
  EXPECT_NEAR(map->width_95_mm, 2 * 1.96 * kNoise, 0.02 * kNoise * 4);  // a quantile of 60 000: 1 %
}

// The dent's cells lie at -0.2 mm, all others at zero; a cell of 5 mm has some 10 points and more: 0.03 / sqrt 10, five of these.
TEST(DeviationMap, ShowsADentOnTheSideWhereItIs) {
  const auto cloud = cloud_of(0.2);
  const auto map = deviation_map(cloud, distance, rough());
  ASSERT_TRUE(map) << map.error().sentence;
  const auto views = views_of(cloud, *map, 5.0);
  ASSERT_EQ(views.size(), 4u);
  const auto at = [](const DeviationView& view, double right, double up) {
    return view.mean_mm(static_cast<int>(std::lround((right - view.left_mm) / view.cell_mm)),
                        static_cast<int>(std::lround((view.top_mm - up) / view.cell_mm)));
  };
  EXPECT_NEAR(at(views[0], 0, 0), -0.2, 0.05);
  EXPECT_NEAR(at(views[0], 60, 30), 0, 0.05);
  EXPECT_NEAR(at(views[2], 0, 0), 0, 0.05);
  EXPECT_GT(views[0].sd_mm, 1.5 * views[2].sd_mm);
}

TEST(DeviationMap, RefusesACloudThatIsElsewhere) {
  const auto map = deviation_map(cloud_of(0), distance, Rigid3{Eigen::Quaterniond::Identity(), {900, 0, 0}});
  ASSERT_FALSE(map);
  EXPECT_NE(map.error().sentence.find("within 5 mm of the surface"), std::string::npos) << map.error().sentence;
}

TEST(PointCloudFile, KeepsThePointsBesideDeviations) {
  const test::TemporaryFolder folder;
  auto cloud = cloud_of(0);
  cloud.points.resize(100);
  const std::vector<float> deviation(100, 0.25f);
  const auto file = folder.write("a.ply", "");
  write_ply(file, cloud, deviation);
  const auto back = read_ply(file);
  ASSERT_EQ(back.points.size(), 100u);
  EXPECT_EQ(back.points[99].position_mm, cloud.points[99].position_mm);
}

}  // namespace
}  // namespace fringecal::metrology

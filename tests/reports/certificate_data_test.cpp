#include "reports/certificate_data.h"

#include "core/error.h"
#include "core/file.h"
#include "metrology/residual_cloud.h"
#include "reports/certificate_figures.h"
#include "tests/support/sample_verification.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <string>

namespace fringecal::reports {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

Certificate with_features() {
  const test::TemporaryFolder folder;
  Certificate c;
  c.number = "K-1";
  c.issued = "2026-11-22T09:00:00Z";
  Record record;
  record.verification = test::sample_verification();
  test::add_features(record.verification, folder.path());
  for (const auto& f : record.verification.features) record.clouds.push_back({f.cloud, read_bytes(folder / f.cloud)});
  record.document = to_json(metrology::to_value(record.verification));
  c.records.push_back(std::move(record));
  return c;
}

TEST(ZipArchive, HasTheSameBytesWhateverTheTimeZone) {
  const std::vector<ArchiveFile> files = {{"a.txt", "one"}, {"b/c.txt", std::string(100'000, 'x')}};
  ::setenv("TZ", "UTC", 1);
  const std::string here = zip_archive(files, "2026-11-22T09:00:00Z");
  ::setenv("TZ", "Asia/Tokyo", 1);
  EXPECT_EQ(zip_archive(files, "2026-11-22T09:00:00Z"), here);
  ::unsetenv("TZ");
  EXPECT_NE(zip_archive(files, "2026-11-22T10:00:00Z"), here);  // the date is in it
  EXPECT_LT(here.size(), 1000u);
  EXPECT_TRUE(zip_archive(files, "1970-01-01T00:00:00Z").starts_with("PK"));  // before ZIP's time
}

TEST(ResidualCloud, IsReadBackAsItWasWritten) {
  const std::vector<Eigen::Vector3d> points = {{1, 2, 3}, {-4.5, 1e-3, 500}};
  const auto cloud = metrology::residual_cloud(points, std::vector<double>{0.0125, -1e-4}, {false, true});
  const std::string ply = metrology::to_ply(cloud);
  const auto back = metrology::residual_cloud_from(ply, "a.ply");
  ASSERT_EQ(back.size(), 2u);
  EXPECT_EQ(back[1].position_mm, Eigen::Vector3f(-4.5f, 1e-3f, 500));
  EXPECT_EQ(back[0].deviation_mm, 0.0125f);
  EXPECT_TRUE(back[1].rejected && !back[0].rejected);
  for (const auto& wrong : {std::string(), std::string("ply\n"), ply.substr(0, ply.size() - 1), ply + "x"}) {
    EXPECT_THROW(metrology::residual_cloud_from(wrong, "a.ply"), InputError);
  }
}

TEST(ResidualCloud, IsThinnedEvenlyToItsLargestSize) {
  const std::size_t n = 2 * metrology::kLargestCloud + 1;  // every third then
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < n; ++i) points.emplace_back(static_cast<double>(i), 0, 0);
  const auto cloud = metrology::residual_cloud(points, std::vector<double>(n), std::vector<bool>(n));
  EXPECT_THAT(cloud, SizeIs((n + 2) / 3));
  EXPECT_EQ(cloud[1].position_mm.x(), 3);
}

TEST(MeasuredFeature, GoesThroughARecordUnchanged) {
  const Certificate c = with_features();
  const auto& v = c.records.front().verification;
  const auto back = metrology::verification_from(parse_json(c.records.front().document, "r"), "r");
  ASSERT_EQ(back.features.size(), v.features.size());
  EXPECT_EQ(back.features[1].place_mm, v.features[1].place_mm);
  EXPECT_EQ(back.features[1].cloud_sha256, v.features[1].cloud_sha256);
  EXPECT_EQ(back.features[1].low_mm, v.features[1].low_mm);
}

TEST(CertificateFigures, AreLeftOutWhereThereIsNothingToDraw) {
  Certificate c = with_features();
  c.records.front().verification.features.clear();
  EXPECT_THAT(certificate_figures(c, Catalogue::in("en")), IsEmpty());
}

TEST(CertificateFigures, ShowTheVolumeWithAMarkAtEveryPosition) {
  const Certificate c = with_features();
  const auto figures = volume_figures(c, Catalogue::in("de"));
  ASSERT_THAT(figures, SizeIs(1));
  const std::string svg = figures.front().picture.html();
  // Three spheres (discs), in two views, and one in the legend.
  std::size_t discs = 0;
  for (auto at = svg.find("<circle"); at != std::string::npos; at = svg.find("<circle", at + 1)) ++discs;
  EXPECT_EQ(discs, 2u * 3 + 1);
  EXPECT_THAT(svg, HasSubstr("ball bar 150"));
  EXPECT_THAT(figures.front().numbers, HasSubstr("mm"));
}

TEST(CertificateFigures, ShowTheCourseOfAQuantityWithItsLimits) {
  Certificate c = with_features();
  for (int k = 0; k < 3; ++k) {
    const std::string date = "2026-0" + std::to_string(3 + k) + "-01T08:00:00Z";
    c.past.push_back({k + 1, "verification", date, "SD", "sphere-spacing error", "bar", "1", "mm", 0.01 * k, 0.002,
                      metrology::Limits{-0.05, 0.05}});
    c.past.push_back({k + 1, "verification", date, "SD", "sphere-spacing error", "bar", "2", "mm", -0.03, 0.002,
                      metrology::Limits{-0.05, 0.05}});
  }
  c.past.push_back({4, "alignment", "2026-07-01T08:00:00Z", "theta", "", "", "as found", "mrad", 1.4, 0.01, {}});
  c.past.push_back({4, "alignment", "2026-07-01T09:00:00Z", "theta", "", "", "as left", "mrad", 0.006, 0.01, {}});
  const auto figures = history_figures(c, Catalogue::in("en"));
  ASSERT_THAT(figures, SizeIs(2));
  EXPECT_EQ(figures[0].name, "history");
  EXPECT_EQ(figures[1].name, "alignment");
  const std::string svg = figures[0].picture.html();
  EXPECT_THAT(svg, HasSubstr("stroke-dasharray"));  // the limits
  EXPECT_THAT(svg, HasSubstr("2026-03-01"));
  EXPECT_THAT(figures[0].numbers, HasSubstr("2026-05-01"));
  EXPECT_THAT(svg, HasSubstr("\u22120.05"));
}

}  // namespace
}  // namespace fringecal::reports

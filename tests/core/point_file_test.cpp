#include "core/point_file.h"

#include "core/error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <string>

namespace fringecal {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string written(const std::string& name, const std::string& bytes) {
  const std::string file = ::testing::TempDir() + "point_file_" + name;
  std::ofstream(file, std::ios::binary) << bytes;
  return file;
}

std::string complaint(const std::string& name, const std::string& bytes) {
  try {
    read_points_mm(written(name, bytes));
  } catch (const InputError& e) {
    return e.what();
  }
  return "(no complaint)";
}

template <class T>
void put(std::string& out, T value, bool swap) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (swap) std::reverse(raw, raw + sizeof(T));
  out.append(raw, sizeof(T));
}

TEST(PointFile, ReadsXyzWithSpacesTabsCommasAndWindowsLineEnds) {
  const auto points = read_points_mm(written("a.xyz",
                                             "\xEF\xBB\xBF"
                                             "1 2 3\r\n\r\n-1.5e-3\t+2,  3.25\n4, 5, 6"));
  ASSERT_EQ(points.size(), 3u);
  EXPECT_EQ(points[1], Eigen::Vector3d(-1.5e-3, 2, 3.25));
  EXPECT_EQ(points[2], Eigen::Vector3d(4, 5, 6));
}

TEST(PointFile, TurnsMetresIntoMillimetres) {
  EXPECT_EQ(read_points_mm(written("m.XYZ", "1 2 0.5\n"), LengthUnit::m).at(0), Eigen::Vector3d(1000, 2000, 500));
}

TEST(PointFile, ReadsNistDataSets) {
  EXPECT_EQ(read_points_mm(written("n.ds", "2\r\n1\t2\t3\t\r\n4\t5\t6\t\r\n")).at(1), Eigen::Vector3d(4, 5, 6));
}

TEST(PointFile, ReadsAsciiPlyWithOtherPropertiesAndElements) {
  const auto points = read_points_mm(written(
      "a.ply",
      "ply\nformat ascii 1.0\ncomment x\nelement camera 1\nproperty float f\nelement vertex 2\nproperty float y\n"
      "property uchar red\nproperty float x\nproperty double z\nelement face 1\nproperty list uchar int "
      "vertex_indices\n"
      "end_header\n9\n2 255 1 3\n5 nan 4 6\n3 0 1 1\n"));
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0], Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(points[1], Eigen::Vector3d(4, 5, 6));
}

TEST(PointFile, ReadsBinaryPlyOfBothByteOrders) {
  for (const bool big : {false, true}) {
    std::string bytes = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                        "_endian 1.0\nelement vertex 2\nproperty double x\nproperty float y\nproperty uchar q\n"
                        "property double z\nend_header\n";
    for (int i = 0; i < 2; ++i) {
      put(bytes, 0.1 + i, big);
      put(bytes, 0.5f, big);
      put(bytes, static_cast<unsigned char>(7), big);
      put(bytes, -3e5, big);
    }
    const auto points = read_points_mm(written("b.ply", bytes));
    ASSERT_EQ(points.size(), 2u);
    EXPECT_EQ(points[1], Eigen::Vector3d(1.1, 0.5, -3e5));
    bytes.pop_back();
    EXPECT_THAT(complaint("short.ply", bytes), AllOf(HasSubstr("short.ply"), HasSubstr("truncated")));
  }
}

TEST(PointFile, NamesTheLineThatIsNotAPoint) {
  EXPECT_THAT(complaint("w.xyz", "1 2 3\n4 5\n"),
              AllOf(HasSubstr("w.xyz:2"), HasSubstr("exactly 3 numbers"), HasSubstr("has 2")));
  EXPECT_THAT(complaint("w.xyz", "1 2 3\n4 5 6 7\n"), AllOf(HasSubstr("w.xyz:2"), HasSubstr("has 4")));
  EXPECT_THAT(complaint("w.xyz", "x y z\n1 2 3\n"), AllOf(HasSubstr("w.xyz:1"), HasSubstr("x y z")));
  EXPECT_THAT(complaint("w.xyz", "1 2 3abc\n"), HasSubstr("w.xyz:1"));
  EXPECT_THAT(complaint("w.xyz", "1 2 nan\n"), AllOf(HasSubstr("w.xyz:1"), HasSubstr("not a finite point")));
  EXPECT_THAT(complaint("w.xyz", "1 2 3\n\n1 -inf 2\n"), AllOf(HasSubstr("w.xyz:3"), HasSubstr("not a finite point")));
  EXPECT_THAT(complaint("w.xyz", "1 2 1e999\n"), AllOf(HasSubstr("w.xyz:1"), HasSubstr("too large")));
}

TEST(PointFile, RefusesFilesWithoutPointsAndUnknownEndings) {
  EXPECT_THAT(complaint("e.xyz", ""), AllOf(HasSubstr("e.xyz"), HasSubstr("no points")));
  EXPECT_THAT(complaint("e.ds", ""), HasSubstr("empty"));
  EXPECT_THAT(complaint("e.ds", "0\n"), HasSubstr("no points"));
  EXPECT_THAT(complaint("e.stl", "solid\n"), AllOf(HasSubstr(".stl"), HasSubstr(".xyz")));
  EXPECT_THROW(read_points_mm(::testing::TempDir() + "not_there.xyz"), InputError);
}

TEST(PointFile, RefusesACountThatDoesNotMatch) {
  EXPECT_THAT(complaint("c.ds", "3\n1 2 3\n4 5 6\n"), AllOf(HasSubstr("announces 3"), HasSubstr("2 follow")));
  EXPECT_THAT(complaint("c.ds", "1 2 3\n4 5 6\n"), AllOf(HasSubstr("c.ds:1"), HasSubstr("number of points")));
  EXPECT_THAT(
      complaint("c.ply",
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                "end_header\n1 2 3\n"),
      AllOf(HasSubstr("announces 3"), HasSubstr("after 1")));
}

TEST(PointFile, RefusesDamagedPlyHeaders) {
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  EXPECT_THAT(complaint("p.ply", "solid\n"), HasSubstr("not a PLY file"));
  EXPECT_THAT(complaint("p.ply", "ply\nformat ascii 1.0\nelement vertex 1\n" + xyz), HasSubstr("no end_header"));
  EXPECT_THAT(complaint("p.ply", "ply\nelement vertex 1\n" + xyz + "end_header\n"), HasSubstr("no format"));
  EXPECT_THAT(complaint("p.ply", "ply\nformat ascii 1.0\nelement face 1\nend_header\n"),
              HasSubstr("no element \"vertex\""));
  EXPECT_THAT(complaint("p.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"),
              HasSubstr("no property y"));
  EXPECT_THAT(complaint("p.ply", "ply\nformat ascii 1.0\nelement vertex -1\n" + xyz),
              AllOf(HasSubstr("p.ply:3"), HasSubstr("-1")));
  EXPECT_THAT(complaint("p.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n"), HasSubstr("p.ply:4"));
  EXPECT_THAT(complaint("p.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 999999999999999999\n" + xyz +
                                     "end_header\n"),
              HasSubstr("truncated"));
}

TEST(PointFile, NamesTheVertexThatIsNotFinite) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n";
  for (int i = 0; i < 6; ++i) put(bytes, i == 4 ? std::numeric_limits<float>::quiet_NaN() : 1.0f, false);
  EXPECT_THAT(complaint("v.ply", bytes), HasSubstr("vertex 2"));
}

}  // namespace
}  // namespace fringecal

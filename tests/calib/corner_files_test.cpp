// Corners of other programs: their files, and the solve from them.
#include "calib/corner_files.h"

#include "core/error.h"
#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::calib {
namespace {

using ::testing::HasSubstr;

model::Board small_board() {
  model::Board b;
  b.columns = 3;
  b.rows = 2;
  b.pitch_x_mm = b.pitch_y_mm = 10;
  return b;
}

std::vector<NamedView> read(const std::filesystem::path& file) {
  return read_corners(std::vector{file}, places_of(small_board()));
}

TEST(CornerFiles, ReadMrcalsVnl) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "corners.vnl";
  write_atomically(file,
                   "## made by mrgingham\n# filename x y level\n"
                   "a.png 1.5 2.5 0\na.png 2 3 0\na.png - - -\na.png 4 5 1\na.png 5 6 -\na.png 6.25 7 0\n"
                   "empty.png - - -\n");
  const auto views = read(file);
  ASSERT_EQ(views.size(), 1u);
  EXPECT_EQ(views[0].name, "a.png");
  ASSERT_EQ(views[0].view.pixels.size(), 5u);  // one is not seen
  EXPECT_EQ(views[0].view.pixels[0], Eigen::Vector2d(1.5, 2.5));
  EXPECT_EQ(views[0].view.board_mm[2], Eigen::Vector2d(0, 10));  // the fourth: row 1, column 0
  EXPECT_EQ(views[0].view.pixels[4], Eigen::Vector2d(6.25, 7));
}

TEST(CornerFiles, RefuseWithFileAndLine) {
  const test::TemporaryFolder folder;
  const auto refused = [&](const char* name, const char* bytes) {
    write_atomically(folder.path() / name, bytes);
    try {
      (void)read(folder.path() / name);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("read");
  };
  EXPECT_THAT(refused("a.vnl", "a.png 1 2 0\n"), HasSubstr("line 1: a legend"));
  EXPECT_THAT(refused("b.vnl", "# filename x y level\na.png 1 two 0\n"), HasSubstr("line 2: '1 two'"));
  EXPECT_THAT(refused("c.vnl", "# filename x y level\na.png 1 2 0\na.png 1 2 0\n"), HasSubstr("the board has 6"));
  EXPECT_THAT(refused("d.txt", "1 2 3\n"), HasSubstr("3 numbers"));
  EXPECT_THAT(refused("e.txt", "1 2\n3 nan\n"), HasSubstr("line 2: 'nan'"));
}

TEST(CornerFiles, ZhangsFilesGiveHisPublishedSolution) {
  const auto folder = std::filesystem::path(FRINGECAL_SHARED_DATA) / "zhang-1998";
  if (!std::filesystem::exists(folder / "Model.txt")) GTEST_SKIP() << "shared data not present: " << folder;
  std::vector<std::filesystem::path> files;
  for (int i = 1; i <= 5; ++i) files.push_back(folder / ("data" + std::to_string(i) + ".txt"));
  const auto named = read_corners(files, read_places(folder / "Model.txt", 25.4));
  std::vector<PlanarView> views;
  for (const auto& n : named) views.push_back(n.view);
  const auto found = solve_camera(views, 640, 480, {.skew = Skew::free});
  ASSERT_TRUE(found) << found.error().sentence;
  // His printed digits (camera_solve_test.cpp).
  EXPECT_NEAR(found->camera.fx_px, 832.4998, 2e-3);
  EXPECT_NEAR(found->camera.cy_px, 206.5852, 2e-3);
  EXPECT_NEAR(found->skew_px, 0.2045, 2e-3);
}

}  // namespace
}  // namespace fringecal::calib

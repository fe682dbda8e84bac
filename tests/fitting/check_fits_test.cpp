// The self-certification passes, within what rounding of coordinates and the shapes' conditions allow.
#include "fitting/check_fits.h"

#include <gtest/gtest.h>

namespace fringecal::fitting {
namespace {

// At a scale of 25 mm the coordinates are rounded to 5e-15 mm, at 1e6 mm from the origin to 1e-10 mm. A cap or sector of
// height h turns that into r / h of it: 1000 for the cap of 5 degrees, 260 for the sector of 10 degrees and the cap of 10.
double limit_mm(const CheckedClass& checked) {
  if (checked.condition == "1e6 mm from the origin") return 1e-8;
  if (checked.condition.find("of 5 degrees") != std::string::npos ||
      checked.condition.find("of 10 degrees") != std::string::npos)
    return 1e-10;
  return 1e-11;
}

TEST(CheckFits, EveryConditionIsAnsweredAndExact) {
  const auto all = check_fits({.cases_per_class = 20});
  ASSERT_GT(all.size(), 20u);
  for (const CheckedClass& checked : all) {
    SCOPED_TRACE(checked.shape + ", " + checked.condition);
    std::printf("%-9s %-28s position %.1e mm, direction %.1e rad, size %.1e mm\n", checked.shape.c_str(),
                checked.condition.c_str(), checked.position_mm, checked.direction_rad, checked.size_mm);
    EXPECT_EQ(checked.refused, 0);
    EXPECT_LE(checked.position_mm, limit_mm(checked));
    EXPECT_LE(checked.size_mm, limit_mm(checked));
    EXPECT_LE(checked.direction_rad, limit_mm(checked));
  }
}

TEST(CheckFits, SeesAWrongReference) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 8; ++i) points.emplace_back(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1);
  const double diameter = 2.0 * std::sqrt(3.0);
  EXPECT_LT(check_pair("right", points, {0, 0, 0, diameter}).size_mm, 1e-14);
  EXPECT_NEAR(check_pair("wrong", points, {0, 0, 0, diameter + 1e-6}).size_mm, 1e-6, 1e-12);
  EXPECT_NEAR(check_pair("wrong", points, {1e-6, 0, 0, diameter}).position_mm, 1e-6, 1e-12);
  EXPECT_FALSE(check_pair("none", points, {1, 2}).failure.empty());
}

}  // namespace
}  // namespace fringecal::fitting

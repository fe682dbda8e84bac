// The scatter from pose to pose against its limit (calib/bundle_system.h, eqs. 4 and 5): poses that agree are seldom
// called contradictory, however few they are, and poses that contradict one scanner are.
#include "calib/calibrate.h"
#include "tests/calib/synthetic_board_views.h"

#include <gtest/gtest.h>

#include <random>

namespace fringecal {
namespace {

bool called_contradictory(const std::vector<model::BoardObservation>& views) {
  const auto found = calib::calibrate(views, test::known_board(), 1392, 1040, test::known_plan(),
                                      {.camera_terms = calib::DistortionTerms::radial, .u_bow_relative = 0});
  EXPECT_TRUE(found) << found.error().sentence;
  if (!found) return false;
  EXPECT_NE(found->method.find("scatter from pose to pose"), std::string::npos) << found->method;
  return found->method.find("widened") != std::string::npos;
}

// One in a thousand is expected: of 20 that two or more are called so has a probability of 0.0002.
TEST(PoseScatter, OfPosesThatAgreeSeldomPassesItsLimit) {
  for (const int poses : {5, 6, 12}) {
    int contradictory = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      contradictory +=
          called_contradictory(test::views(test::known_scanner(), test::known_board(), poses, {.seed = seed}));
    }
    EXPECT_LE(contradictory, 1) << poses << " poses";
  }
}

// A lens that is refocused between captures, by 1e-3 of its focal length: at the board's edge 0.5 px, 17 times the noise of
// a corner, and no unknown of a single capture stands for it.
TEST(PoseScatter, OfALensThatIsRefocusedPassesItsLimit) {
  const Eigen::Vector3d middle = 0.5 * test::known_board().corner_mm(8, 6);
  std::mt19937_64 random(11);
  std::normal_distribution<double> breath(0, 1e-3);
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    std::vector<model::BoardObservation> views;
    for (const Rigid3& place : test::view_places(8)) {
      model::Scanner refocused = test::known_scanner();
      const double factor = 1 + breath(random);
      refocused.camera.fx_px *= factor;
      refocused.camera.fy_px *= factor;
      views.push_back(test::view_at(refocused, test::known_board(),
                                    {place.rotation, place.translation_mm - place.rotation * middle},
                                    {.seed = 100 * seed + views.size()}));
    }
    EXPECT_TRUE(called_contradictory(views)) << "seed " << seed;
  }
}

}  // namespace
}  // namespace fringecal

#include "calib/bundle_cost.h"

#include <ceres/ceres.h>
#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

namespace fringecal::calib::bundle {
namespace {

const Eigen::Matrix3d kPose = rotation_from_vector({0.3, -0.4, 0.1}).toRotationMatrix();
const Eigen::Matrix3d kProjector = rotation_from_vector({0.01, -0.38, 0.02}).toRotationMatrix();
const BoardPlace kPlace{{120, 60}, {0.4, -0.7}};

/// Numeric derivatives with Ridders' method are good to about 1e-9 of the derivative for functions this smooth; 1e-6 is
/// asked.
void expect_gradient(const ceres::CostFunction& cost, const std::vector<std::vector<double>>& parameters) {
  ceres::NumericDiffOptions options;
  const ceres::GradientChecker checker(&cost, static_cast<const std::vector<const ceres::Manifold*>*>(nullptr),
                                       options);
  std::vector<const double*> pointers;
  for (const auto& p : parameters) pointers.push_back(p.data());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(pointers.data(), 1e-6, &results)) << results.error_log;
}

class BundleGradient : public ::testing::TestWithParam<double> {
 protected:
  // The rotation parameters: zero, where the first-order branch is taken, and not.
  std::vector<double> w_ = {0.7 * GetParam(), -0.5 * GetParam(), 0.3 * GetParam()};
};

TEST_P(BundleGradient, OfTheCameraIsTheNumericOne) {
  ceres::AutoDiffCostFunction<CameraResidual, 2, 4, 5, 3, 3, 1, 2, 2> cost(
      new CameraResidual{kPlace, &kPose, {700, 500}, 0.05});
  expect_gradient(cost, {{3721, 3719, 708, 512},
                         {-0.1, 0.06, 2e-4, -1.5e-4, 0.3},
                         w_,
                         {-100, -60, 1050},
                         {1e-4},
                         {0.1, -0.05},
                         {0.01, -0.02}});
}

TEST_P(BundleGradient, OfTheProjectorIsTheNumericOne) {
  for (const int component : {0, 1}) {
    ceres::AutoDiffCostFunction<ProjectorResidual, 1, 2, 5, 3, 3, 3, 3, 1, 2, 2> cost(
        new ProjectorResidual{kPlace, &kPose, &kProjector, component, 7.9, 0.001});
    expect_gradient(cost, {{32, 7.8},
                           {-0.08, 0.03, 1e-4, 2e-4, 0.1},
                           w_,
                           {400, 3, 1},
                           w_,
                           {-100, -60, 1050},
                           {1e-4},
                           {0.1, -0.05},
                           {0.01, -0.02}});
  }
}

INSTANTIATE_TEST_SUITE_P(AtZeroAndAway, BundleGradient, ::testing::Values(0.0, 0.4));

TEST(BundleCost, GivesUpOnAPointBehindTheLens) {
  const double camera[] = {3721, 3719, 708, 512}, k[5] = {}, w[3] = {}, t[] = {0, 0, -500}, s[1] = {}, bow[2] = {},
               e[2] = {};
  double residual[2];
  EXPECT_FALSE((CameraResidual{kPlace, &kPose, {700, 500}, 0.05}(camera, k, w, t, s, bow, e, residual)));
}

}  // namespace
}  // namespace fringecal::calib::bundle

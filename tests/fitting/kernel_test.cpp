// The sums over points: the same bytes on every width of vectors, and what masks and weights mean.
#include "fitting/kernels.h"

#include "tests/fitting/synthetic.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstring>

namespace fringecal::fitting {
namespace {

KernelTask task_of(KernelKind kind, const Cloud& cloud) {
  KernelTask task{kind, cloud};
  task.origin_mm = {1, 2, 3};
  task.inverse_scale = 1.0 / 25.0;
  task.anchor = {0.1, -0.2, 0.9};
  task.axes = Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 0.5).normalized())).toRotationMatrix();
  task.k = 0.8;
  return task;
}
const Cloud& cloud() {
  static const Cloud points = [] {
    Cloud out;
    Random random(3);
    for (int i = 0; i < 70003; ++i) out.emplace_back(50 * uniform(random), 50 * uniform(random), 50 * uniform(random));
    return out;
  }();
  return points;
}

TEST(Kernels, GiveTheSameBytesOnEveryWidthOfVectors) {
  std::vector<std::uint8_t> used((cloud().size() + 7) / 8);
  Random random(4);
  for (auto& byte : used) byte = static_cast<std::uint8_t>(random.next());
  for (const KernelKind kind : {KernelKind::moments, KernelKind::plane, KernelKind::sphere, KernelKind::cylinder}) {
    for (const bool masked : {false, true}) {
      std::vector<double> first(cloud().size()), other(cloud().size());
      KernelTask task = task_of(kind, cloud());
      if (masked) task.weights.used = used.data();
      task.distances = first.data();
      const KernelSums best = run_kernel(task);
      task.distances = other.data();
      int targets = 0;
      for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        hwy::GetChosenTarget().Update(hwy::SupportedTargets());
        const KernelSums here = run_kernel(task);
        EXPECT_EQ(std::memcmp(&here, &best, sizeof here), 0) << hwy::TargetName(target);
        EXPECT_EQ(std::memcmp(first.data(), other.data(), first.size() * sizeof(double)), 0) << hwy::TargetName(target);
        ++targets;
      }
      hwy::SetSupportedTargetsForTest(0);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      EXPECT_GE(targets, 1);
    }
  }
}

TEST(Kernels, LeaveOutWhatIsNotUsedAndWeighWhatIs) {
  for (const KernelKind kind : {KernelKind::moments, KernelKind::plane, KernelKind::sphere, KernelKind::cylinder}) {
    const Cloud all(cloud().begin(), cloud().begin() + 2003);
    std::vector<std::uint8_t> used((all.size() + 7) / 8, 0);
    std::vector<double> weights(all.size(), 0.0);
    Cloud twice;  // a weight of two is a point given twice
    for (std::size_t i = 0; i < all.size(); i += 3) {
      used[i / 8] = static_cast<std::uint8_t>(used[i / 8] | (1u << (i % 8)));
      weights[i] = 2.0;
      twice.insert(twice.end(), 2, all[i]);
    }
    weights[1] = 5.0;  // of a point that is not used
    KernelTask task = task_of(kind, all);
    task.weights = {used.data(), weights.data()};
    const KernelSums a = run_kernel(task), b = run_kernel(task_of(kind, twice));
    // Two orders of 1300 terms: below 1300 eps, 3e-13, of the largest sum; 1e-12 leaves a factor of three.
    double largest = 0.0;
    for (const double s : b.sums) largest = std::max(largest, std::abs(s));
    for (int s = 0; s < KernelSums::kMost; ++s) EXPECT_NEAR(a.sums[s], b.sums[s], 1e-12 * largest);
    EXPECT_EQ(a.largest, b.largest);
    EXPECT_EQ(a.smallest, b.smallest);
  }
}

}  // namespace
}  // namespace fringecal::fitting

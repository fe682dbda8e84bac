// The sums over points: the same bytes on every width of vectors, and what masks and weights mean.
#include "fitting/kernels.h"
#include "fitting/selection.h"

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
  task.radius_mm = 20.0;
  return task;
}
constexpr KernelKind kKinds[] = {KernelKind::moments,      KernelKind::moments_mm, KernelKind::plane,
                                 KernelKind::sphere,       KernelKind::cylinder,   KernelKind::sphere_centre,
                                 KernelKind::cylinder_axis};
const Cloud& cloud() {
  static const Cloud points = [] {
    Cloud out;
    Random random(3);
    for (int i = 0; i < 70003; ++i) out.push_back({50 * uniform(random), 50 * uniform(random), 50 * uniform(random)});
    return out;
  }();
  return points;
}

TEST(Kernels, GiveTheSameBytesOnEveryWidthOfVectors) {
  std::vector<std::uint8_t> used((cloud().size() + 7) / 8);
  Random random(4);
  for (auto& byte : used) byte = static_cast<std::uint8_t>(random.next());
  for (const KernelKind kind : kKinds) {
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
  for (const KernelKind kind : kKinds) {
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

// What is left out is left out, the rest keeps its bytes.
TEST(Kernels, GiveTheOtherSumsAlikeWithoutTheMatrix) {
  for (const KernelKind kind : {KernelKind::plane, KernelKind::sphere_centre, KernelKind::cylinder_axis}) {
    KernelTask task = task_of(kind, cloud());
    const KernelSums all = run_kernel(task);
    task.wanted = KernelSumsWanted::all_but_matrix;
    const KernelSums part = run_kernel(task);
    const int rows = kind == KernelKind::plane ? 3 : kind == KernelKind::sphere_centre ? 4 : 5;
    for (int s = 0; s < KernelSums::kMost; ++s) {
      EXPECT_EQ(part.sums[s], s < rows * (rows + 1) / 2 ? 0.0 : all.sums[s]) << s;
    }
    EXPECT_EQ(part.largest, all.largest);
    EXPECT_EQ(part.smallest, all.smallest);
  }
}

TEST(Selection, MarksAndCollectsOnEveryWidthOfVectorsWhatOneByOneComparisonsDo) {
  Random random(6);
  std::vector<double> distances(10007);
  for (double& d : distances) d = normal(random);
  distances[5] = std::numeric_limits<double>::quiet_NaN();
  std::vector<std::uint8_t> used((distances.size() + 7) / 8), within(used.size(), 0);
  for (auto& byte : used) byte = static_cast<std::uint8_t>(random.next());
  std::vector<double> sizes;
  std::size_t below = 0;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const double size = std::abs(distances[i]);
    if (size <= 0.7) within[i / 8] = static_cast<std::uint8_t>(within[i / 8] | 1u << (i % 8));
    if (!(used[i / 8] >> (i % 8) & 1)) continue;
    if (size < 0.5) ++below;
    if (size >= 0.5 && size <= 0.7) sizes.push_back(size);
  }
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    EXPECT_EQ(marked_within(distances, 0.7), within) << hwy::TargetName(target);
    const SizesBetween found = sizes_between(distances, used, 0.5, 0.7);
    EXPECT_EQ(found.below, below) << hwy::TargetName(target);
    EXPECT_EQ(found.sizes, sizes) << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace
}  // namespace fringecal::fitting

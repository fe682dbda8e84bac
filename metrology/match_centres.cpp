#include "metrology/match_centres.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace fringecal::metrology {
namespace {

class Search {
 public:
  Search(std::span<const Eigen::Vector3d> measured, std::span<const Eigen::Vector3d> certified, double match_mm)
      : measured_(measured), certified_(certified), match_mm_(match_mm) {}

  std::vector<std::size_t> best() {
    extend(0);
    return best_;
  }

 private:
  void extend(double sum) {
    const std::size_t i = order_.size();
    if (i == certified_.size()) {
      if (sum < best_sum_) {
        best_sum_ = sum;
        best_ = order_;
      }
      return;
    }
    for (std::size_t k = 0; k < measured_.size(); ++k) {
      if (std::find(order_.begin(), order_.end(), k) != order_.end()) continue;
      double more = 0;
      bool fits = true;
      for (std::size_t j = 0; j < i && fits; ++j) {
        const double d = (measured_[k] - measured_[order_[j]]).norm() - (certified_[i] - certified_[j]).norm();
        fits = std::abs(d) <= match_mm_;
        more += d * d;
      }
      if (!fits || sum + more >= best_sum_) continue;
      order_.push_back(k);
      extend(sum + more);
      order_.pop_back();
    }
  }

  std::span<const Eigen::Vector3d> measured_, certified_;
  double match_mm_;
  std::vector<std::size_t> order_, best_;
  double best_sum_ = std::numeric_limits<double>::infinity();
};

}  // namespace

Result<std::vector<std::size_t>> match_centres(std::span<const Eigen::Vector3d> measured_mm,
                                               std::span<const Eigen::Vector3d> certified_mm, double match_mm) {
  auto out = Search(measured_mm, certified_mm, match_mm).best();
  if (out.empty()) {
    return unanswerable(
        fmt::format("no {} of its {} spheres stand as the certificate has them: distances differ by more than {} mm",
                    certified_mm.size(), measured_mm.size(), match_mm));
  }
  return out;
}

}  // namespace fringecal::metrology

// The camera's point spread: a Gaussian of blur_px rms over the square of a pixel, along columns and rows alike.
//
// Its distribution along one axis, with F(t) = t Phi(t / s) + s phi(t / s):  C(x) = F(x + 1/2) - F(x - 1/2) (1) Samples
// are Hammersley's points put through the inverse of C: each of their n columns and rows, of equal light, holds one, so
// an edge along either axis is found to 1/n of its light. Their spread is scaled to blur^2 + 1/12 exactly.
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

namespace fringecal::virt {

class PointSpread {
 public:
  explicit PointSpread(double blur_px);

  static constexpr int kFine = 128, kCoarse = 64;
  /// count: kFine or kCoarse. Offsets from the pixel's middle, px; all of equal weight.
  std::span<const Eigen::Vector2d> samples(int count) const { return count == kFine ? fine_ : coarse_; }
  /// No sample is further away along an axis.
  double reach_px() const { return reach_px_; }

 private:
  std::vector<Eigen::Vector2d> fine_, coarse_;
  double reach_px_ = 0;
};

}  // namespace fringecal::virt

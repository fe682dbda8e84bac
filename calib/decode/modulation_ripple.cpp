#include "calib/decode/modulation_ripple.h"

#include "calib/decode/phase.h"
#include "calib/decode/ripple.h"
#include "core/parallel.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace fringecal::decode {
namespace {

constexpr int kMaxRounds = 6;
constexpr double kSettled = 1e-3;  // a change this small is the last: what it leaves is 8 H = 0.1 of it
constexpr double kClip = 4.0;      // robust standard deviations
using Vector6 = Eigen::Matrix<double, kRippleTerms, 1>;
using Matrix6 = Eigen::Matrix<double, kRippleTerms, kRippleTerms>;

struct Sums {
  Matrix6 normal = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  double squares = 0;
  std::size_t n = 0;
  std::vector<float> sizes;  // a sample of |y_hp|, for the robust scale

  void add(const RippleTerms& terms, double y) {
    const Eigen::Map<const Vector6> f(terms.data());
    normal.selfadjointView<Eigen::Lower>().rankUpdate(f);
    right += y * f;
    squares += y * y;
    ++n;
  }
};

struct Fit {
  Vector6 amplitude;
  Vector6 u;
  std::size_t n = 0;
};

double median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// A line with what is known of the ellipse taken off.
RippleLine line_of(const ModulationMap& map, int number, const model::StepEllipse& ellipse) {
  const int length = map.axis == CodeAxis::x ? map.usable.width() : map.usable.height();
  RippleLine out{std::vector<double>(length), std::vector<double>(length), std::vector<char>(length)};
  for (int i = 0; i < length; ++i) {
    const int x = map.axis == CodeAxis::x ? i : number, y = map.axis == CodeAxis::x ? number : i;
    if (!map.usable(x, y)) continue;
    const double wrapped = map.wrapped_rad(x, y);
    const auto w = ellipse.undone(std::polar(1.0, wrapped));
    out.usable[i] = 1;
    out.phase_rad[i] = map.phase_rad(x, y) + wrapped_angle(std::arg(w) - wrapped);
    out.y[i] = map.log_ratio(x, y) + 0.5 * std::log(std::norm(w));
  }
  return out;
}

/// Eq. 3 by least squares over every stride-th line; pixels beyond `clip` are left out.
Sums sums_over(const ModulationMap& map, const model::StepEllipse& ellipse, int stride, double clip) {
  constexpr int kBand = 4;
  const int lines = (map.lines() + stride - 1) / stride, bands = (lines + kBand - 1) / kBand;
  std::vector<Sums> parts(static_cast<std::size_t>(bands));
  parallel_for(bands, [&](int band) {
    Sums& sums = parts[static_cast<std::size_t>(band)];
    for (int i = band * kBand; i < std::min(lines, (band + 1) * kBand); ++i) {
      for_each_high_passed(line_of(map, i * stride, ellipse), map.phase_steps,
                           [&](int x, double y, const RippleTerms& terms) {
                             if ((x + i) % 7 == 0) sums.sizes.push_back(static_cast<float>(std::abs(y)));
                             if (std::abs(y) <= clip) sums.add(terms, y);
                           });
    }
  });
  Sums total;
  for (const Sums& part : parts) {
    total.normal += part.normal;
    total.right += part.right;
    total.squares += part.squares;
    total.n += part.n;
    total.sizes.insert(total.sizes.end(), part.sizes.begin(), part.sizes.end());
  }
  return total;
}

Fit fit_of(const Sums& sums) {
  const Matrix6 normal = sums.normal.selfadjointView<Eigen::Lower>();
  const Matrix6 inverse = normal.inverse();
  Fit fit{.amplitude = inverse * sums.right, .u = {}, .n = sums.n};
  const double rest = std::max(0.0, sums.squares - fit.amplitude.dot(sums.right));
  fit.u = (inverse.diagonal() * (rest / static_cast<double>(sums.n))).cwiseSqrt();
  return fit;
}

}  // namespace

Result<StackErrors> fit_modulation_ripple(const ModulationMap& map) {
  StackErrors out;
  const auto usable = static_cast<std::size_t>(
      std::count_if(map.usable.values().begin(), map.usable.values().end(), [](std::uint8_t u) { return u != 0; }));
  const int stride = line_stride(usable);
  double clip = 1e9;
  for (int round = 0; round < kMaxRounds; ++round) {
    Sums sums = sums_over(map, out.ellipse, stride, clip);
    if (static_cast<int>(sums.sizes.size()) * 7 < kMinPixels) {
      return unanswerable(
          fmt::format("only about {} pixels have a whole period of clean fringes around them ({} are "
                      "needed): the stack's own step and lamp errors cannot be told",
                      sums.sizes.size() * 7, kMinPixels));
    }
    clip = kClip * 1.4826 * median(sums.sizes);
    if (round == 0) sums = sums_over(map, out.ellipse, stride, clip);
    if (static_cast<int>(sums.n) < kMinPixels) return unanswerable("the modulation scatters too much for a ripple");
    const Fit fit = fit_of(sums);
    const std::complex one(fit.amplitude[0], fit.amplitude[1]), two(fit.amplitude[2], fit.amplitude[3]);
    out.ellipse.offset += one;     // (3)
    out.ellipse.conjugate += two;  // (3)
    if (map.phase_steps == 4) out.ellipse.third = fit.amplitude[4];
    out.ellipse.u_offset = std::max(fit.u[0], fit.u[1]);
    out.ellipse.u_conjugate = std::max(fit.u[2], fit.u[3]);
    out.n_pixels = fit.n;
    if (!(std::norm(out.ellipse.offset) < 0.25 && std::norm(out.ellipse.conjugate) < 0.25)) {
      return unanswerable(
          fmt::format("the phase steps are off by more than can be corrected (offset {:.2f}, conjugate "
                      "{:.2f} of the modulation): align the grating first",
                      std::abs(out.ellipse.offset), std::abs(out.ellipse.conjugate)));
    }
    if (round > 0 && std::max(std::abs(one), std::abs(two)) < kSettled) break;
  }
  return out;
}

}  // namespace fringecal::decode

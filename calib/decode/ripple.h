// How a quantity ripples with the period of the fringes: amplitudes of cos h phi, sin h phi along the lines of a map.
//
// Along a line (a row for axis x, a column for axis y) every quantity f is first freed of what does not ripple,
//   f_hp(x) = f(x) - mean of f over [x - r, x + r],  2 r + 1 one local period of phi               (1)
// which removes offset and slope exactly and leaves a constant of curvature, uncorrelated with the ripple. The measured
// y and the regressors cos h phi, sin h phi pass through the same filter, so
//   y_hp = sum_h a_h cos_hp(h phi) + b_h sin_hp(h phi)                                             (2)
// is unbiased whatever the window's length is. Only pixels whose whole window is usable take part; phi and y come from
// one run of the line without gap or jump.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <vector>

namespace fringecal::decode {

/// h of eq. 2: one and two cycles from the frames of one stack, N cycles from the harmonics (N: the phase steps).
inline constexpr std::size_t kRippleTerms = 6;  // cos, sin of 1, 2 and N cycles
using RippleTerms = std::array<double, kRippleTerms>;

inline RippleTerms ripple_terms(double phase_rad, int phase_steps) {
  const double c = std::cos(phase_rad), s = std::sin(phase_rad), c2 = c * c - s * s, s2 = 2 * s * c;
  if (phase_steps == 4) return {c, s, c2, s2, c2 * c2 - s2 * s2, 2 * s2 * c2};
  return {c, s, c2, s2, std::cos(phase_steps * phase_rad), std::sin(phase_steps * phase_rad)};
}

/// One line; all of one length.
struct RippleLine {
  std::vector<double> phase_rad;  // absolute: continuous along the fringes' run
  std::vector<double> y;
  std::vector<char> usable;
};

/// Eqs. 1 for each pixel whose window is complete: visit(x, y_hp, terms_hp). Serial, in the order of x.
template <class Visit>
void for_each_high_passed(const RippleLine& line, int phase_steps, const Visit& visit) {
  constexpr double kPi = std::numbers::pi;
  const auto length = static_cast<int>(line.phase_rad.size());
  std::vector<RippleTerms> terms(line.phase_rad.size()), sum(line.phase_rad.size() + 1);
  std::vector<double> sum_y(line.phase_rad.size() + 1);
  for (int begin = 0; begin < length;) {
    if (!line.usable[begin]) {
      ++begin;
      continue;
    }
    int end = begin + 1;
    while (end < length && line.usable[end] && std::abs(line.phase_rad[end] - line.phase_rad[end - 1]) < kPi / 2) ++end;
    sum[begin] = {};
    sum_y[begin] = 0;
    for (int x = begin; x < end; ++x) {
      terms[x] = ripple_terms(line.phase_rad[x], phase_steps);
      for (std::size_t k = 0; k < kRippleTerms; ++k) sum[x + 1][k] = sum[x][k] + terms[x][k];
      sum_y[x + 1] = sum_y[x] + (line.y[x] - line.y[begin]);
    }
    int left = begin, right = begin;
    for (int x = begin; x < end; ++x) {
      const double here = line.phase_rad[x];
      while (left < x && std::abs(here - line.phase_rad[left]) > kPi) ++left;
      right = right < x ? x : right;
      while (right + 1 < end && std::abs(line.phase_rad[right + 1] - here) <= kPi) ++right;
      if (left == begin || right == end - 1) continue;  // the run may end before the period does
      const int half = (right - left + 1) / 2;
      if (x - half < begin || x + half >= end) continue;
      const double share = 1.0 / (2 * half + 1);
      RippleTerms passed;
      for (std::size_t k = 0; k < kRippleTerms; ++k) {
        passed[k] = terms[x][k] - share * (sum[x + half + 1][k] - sum[x - half][k]);  // (1)
      }
      visit(x, line.y[x] - line.y[begin] - share * (sum_y[x + half + 1] - sum_y[x - half]), passed);
    }
    begin = end;
  }
}

}  // namespace fringecal::decode

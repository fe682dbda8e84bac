#include "calib/align_jumps.h"
#include "core/statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>

namespace fringecal::calib {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;

struct BoundaryCounts {
  std::vector<double> jumps, periods;
};

/// One unbroken run of valid pixels along a line: wrapped and absolute phase.
void count_run(const std::vector<double>& wrapped, const std::vector<double>& absolute, int boundaries, int n_bits,
               std::vector<BoundaryCounts>& by_bit) {
  if (wrapped.size() < 8) return;
  std::vector<double> smooth(wrapped.size());
  std::vector<double> offsets;
  smooth[0] = wrapped[0];
  for (std::size_t i = 0; i < wrapped.size(); ++i) {
    if (i > 0) smooth[i] = smooth[i - 1] + std::remainder(wrapped[i] - wrapped[i - 1], kTwoPi);
    offsets.push_back(std::round((absolute[i] - smooth[i]) / kTwoPi));
  }
  const double offset = median(offsets);
  // Boundary m lies where the continuous phase passes 2 pi m - pi, that is u = m p.
  std::map<int, std::pair<int, int>> pixels_of;  // boundary -> signed wrong pixels; period m -> pixels
  for (std::size_t i = 0; i < smooth.size(); ++i) {
    const double phase = smooth[i] + kTwoPi * offset;
    const int m = static_cast<int>(std::floor((phase + std::numbers::pi) / kTwoPi));
    const double error = offsets[i] - offset;
    ++pixels_of[m].second;
    if (error < 0) ++pixels_of[m].first;  // the code is late: the Gray edge lies at larger u
    if (error > 0) --pixels_of[m + 1].first;
  }
  for (const auto& [m, counts] : pixels_of) {
    // The first and last period of a run are cut: only boundaries between two whole periods count.
    if (m <= 0 || m >= boundaries || !pixels_of.contains(m - 2) || !pixels_of.contains(m + 2)) continue;
    const int bit = n_bits - 1 - std::countr_zero(static_cast<unsigned>(m));
    by_bit[bit].jumps.push_back(counts.first);
    by_bit[bit].periods.push_back(counts.second);
  }
}

}  // namespace

Result<std::vector<JumpCount>> count_jumps(const decode::PhaseMap& map) {
  if (map.edges != decode::EdgeRule::plain) {
    return unanswerable(
        "this phase map was decoded with the redundancy of the code, which removes the very jumps that show the "
        "misalignment; decode the capture with the plain rule");
  }
  if (map.code.phase_steps == 0 || map.code.gray_bits < 2) {
    return unanswerable("a jump needs a Gray code of at least 2 bits and phase patterns");
  }
  // Bits that toggle on period boundaries: all, or with two stripes per period all but the finest.
  const int n_bits = map.code.gray_bits - (map.code.stripes_per_period == 2 ? 1 : 0);
  const bool rows = map.axis == CodeAxis::x;
  const int lines = rows ? map.height() : map.width(), length = rows ? map.width() : map.height();
  std::vector<BoundaryCounts> by_bit(static_cast<std::size_t>(n_bits));
  for (int line = 0; line < lines; ++line) {
    std::vector<double> wrapped, absolute;
    for (int i = 0; i <= length; ++i) {
      const int x = rows ? i : line, y = rows ? line : i;
      if (i < length && map.valid(x, y)) {
        wrapped.push_back(map.wrapped_rad(x, y));
        absolute.push_back(map.phase_rad(x, y));
        continue;
      }
      count_run(wrapped, absolute, 1 << n_bits, n_bits, by_bit);
      wrapped.clear();
      absolute.clear();
    }
  }
  std::vector<JumpCount> out;
  for (int b = 0; b < n_bits; ++b) {
    auto& counts = by_bit[b];
    if (counts.jumps.empty()) continue;
    out.push_back({b, median(counts.jumps), median(counts.periods), static_cast<int>(counts.jumps.size())});
  }
  return out;
}

}  // namespace fringecal::calib

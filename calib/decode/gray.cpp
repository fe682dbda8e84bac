#include "calib/decode/gray.h"

#include "core/error.h"

#include <fmt/format.h>

namespace fringecal::decode {

AxisFrames frames_of(const Capture& capture, CodeAxis axis) {
  const PatternPlan& plan = capture.info.plan;
  if (!plan.code(axis)) {
    const char* asked = axis == CodeAxis::x ? "x" : "y";
    const char* other = axis == CodeAxis::x ? "y" : "x";
    throw InputError(fmt::format("{}: this capture has no code along {}; it codes {}, use --axis {}",
                                 capture.folder.empty() ? "the capture" : capture.folder.string(), asked, other,
                                 other));
  }
  AxisFrames out{
      .code = *plan.code(axis), .axis = axis, .phase = {}, .gray = {}, .inverse = {}, .white = {}, .black = {}};
  for (int k = 0; k < out.code.phase_steps; ++k) out.phase.push_back(plan.find({PatternKind::phase, axis, k}).value());
  for (int b = 0; b < out.code.gray_bits; ++b) {
    out.gray.push_back(plan.find({PatternKind::gray, axis, b}).value());
    out.inverse.push_back(plan.find({PatternKind::gray, axis, b, true}));
  }
  out.white = plan.find({.kind = PatternKind::white});
  out.black = plan.find({.kind = PatternKind::black});
  return out;
}

FringeNumber fringe_of_whole_stripe(const BitRow& row, std::size_t x, int bits, const WrappedPhase& phase) {
  constexpr float kPi = std::numbers::pi_v<float>;
  const std::int32_t s = row.stripe[x];
  float strongest = 0, sum = 0;
  for (int b = 0; b < bits; ++b) {
    const float size = std::abs(row.t[static_cast<std::size_t>(b) * row.width + x]);
    strongest = std::max(strongest, size);
    sum += size;
  }
  // At an end of the pattern no bit toggles: as far from its threshold as can be.
  const auto distance = [&](std::int32_t upper) {
    const int bit = toggling_bit(upper, bits);
    return bit < 0 ? strongest : std::abs(row.t[static_cast<std::size_t>(bit) * row.width + x]);
  };
  const float below = distance(s), above = distance(s + 1), size = std::abs(phase.phi);
  if (size <= kPi / 2) return {.m = s, .consistent = std::min(below, above) >= kSurelyAtThreshold * strongest};  // (6)
  if (size <= 3 * kPi / 4) return {.m = s, .consistent = true};
  const bool upper_half = phase.phi > 0;
  const float own = upper_half ? above : below, neighbour = upper_half ? below : above;
  const float full = bits > 2 ? (sum - below - above) / static_cast<float>(bits - 2) : strongest;
  const float variance = 1.25f * phase.sigma * phase.sigma + kLevelSpread * kLevelSpread * full * full;
  const float evidence = (own - neighbour) * (2 * full - own - neighbour);  // 2 s_t^2 L
  const float z = (kPi - size) / phase.u_phi;
  const bool take_neighbour = neighbour < own && evidence > variance * std::min(2 * kUnlikely, z * (z + 2));  // (5)
  return {.m = take_neighbour ? (upper_half ? s - 1 : s + 1) : s, .consistent = true};
}

bool undecided_far_from_edges(const BitRow& row, std::size_t x, int bits, float sigma) {
  const float* t = row.t.data() + x;
  for (int b = 0; b < bits; ++b, t += row.width) {
    if (!(std::abs(*t) <= sigma)) continue;
    const std::int32_t s = row.stripe[x];
    bool toggles = false;
    for (std::int32_t edge = s - 1; edge <= s + 2; ++edge) toggles = toggles || toggling_bit(edge, bits) == b;
    if (!toggles) return true;
  }
  return false;
}

}  // namespace fringecal::decode

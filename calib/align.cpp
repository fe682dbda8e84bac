#include "calib/align.h"

#include "calib/align_edges.h"
#include "calib/align_jumps.h"
#include "calib/align_steps.h"
#include "core/statistics.h"

#include <fmt/format.h>
#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace fringecal::calib {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr int kMinEdges = 20;
constexpr int kBlocks = 16;
constexpr double kPathPeakToPeak2 = 3.8;  // (peak to peak)^2 over variance of a path of eq. 4

/// Where along the slide, in pitches, each Gray bit and the wrap of the phase (eq. 3) belong.
struct Slots {
  std::vector<double> gray, phase_steps, weights;
  double phase = 0;
};

Slots slots_of(const FringeCode& code, const GratingLayout& layout) {
  Slots slots;
  for (int b = 0; b < code.gray_bits; ++b) slots.gray.push_back(layout.gray_slots.empty() ? b : layout.gray_slots[b]);
  for (int k = 0; k < code.phase_steps; ++k) {
    const double sine = std::sin(kTwoPi * k / code.phase_steps);
    slots.weights.push_back(2.0 / code.phase_steps * sine * sine);  // eq. 3
    slots.phase_steps.push_back(layout.phase_slots.empty() ? code.gray_bits + k : layout.phase_slots[k]);
    slots.phase += slots.weights.back() * slots.phase_steps.back();
  }
  return slots;
}

const FringeCode& checked_code(const Capture& capture, const GratingLayout& layout, CodeAxis axis) {
  const auto& code = capture.info.plan.code(axis);
  const char* name = axis == CodeAxis::x ? "x" : "y";
  const std::string where = capture.folder.empty() ? "the capture" : capture.folder.string();
  if (!code) throw InputError(fmt::format("{}: no code along {}; choose the other axis", where, name));
  if (code->phase_steps < 3 || code->gray_bits < 2) {
    throw InputError(
        fmt::format("{}: {} Gray bits and {} phase steps along {}; the alignment compares Gray edges with phase "
                    "wraps and needs at least 2 and 3",
                    where, code->gray_bits, code->phase_steps, name));
  }
  if (code->unit != "mm") {
    throw InputError(
        fmt::format("{}: the code's unit is '{}'; only a grating on a slide (unit mm) can be misaligned in this "
                    "way",
                    where, code->unit));
  }
  if (!(layout.pattern_pitch_mm > 0)) {
    throw InputError(fmt::format("the pitch of the patterns along the slide is {} mm; it must be positive",
                                 layout.pattern_pitch_mm));
  }
  if ((!layout.gray_slots.empty() && static_cast<int>(layout.gray_slots.size()) != code->gray_bits) ||
      (!layout.phase_slots.empty() && static_cast<int>(layout.phase_slots.size()) != code->phase_steps)) {
    throw InputError(fmt::format("the layout names {} Gray slots and {} phase slots; the code has {} and {}",
                                 layout.gray_slots.size(), layout.phase_slots.size(), code->gray_bits,
                                 code->phase_steps));
  }
  return *code;
}

/// delta_F-1 - delta_F in periods, from the edges of the two finest bits alone: edges of F stand at odd, those of F-1
/// at even numbers of periods, so their difference is known modulo two periods.
std::optional<double> difference_of_finest(const EdgeMap& map, int finest) {
  std::vector<double> differences;
  for (const auto& segment : map.segments) {
    double reference[2] = {};
    std::vector<double> places[2];
    for (const GrayEdge& e : segment.edges) {
      const int which = e.bit == finest ? 0 : 1;
      if (e.bit != finest && e.bit != finest - 1) continue;
      if (places[which].empty()) reference[which] = e.q_periods;
      places[which].push_back(std::remainder(e.q_periods - reference[which], 2.0));
    }
    if (places[0].empty() || places[1].empty()) continue;
    differences.push_back(
        std::remainder(reference[1] + median(places[1]) - reference[0] - median(places[0]) - 1.0, 2.0));
  }
  if (differences.size() < 5) return std::nullopt;
  return median(differences);
}

struct LineDelta {
  int line;
  double delta_periods;
};

/// Standard uncertainty of the median over all lines, from the scatter of blocks of lines.
double u_of_median(const std::vector<LineDelta>& deltas, int lines) {
  std::vector<std::vector<double>> blocks(kBlocks);
  for (const auto& d : deltas)
    blocks[static_cast<std::size_t>(static_cast<long>(d.line) * kBlocks / lines)].push_back(d.delta_periods);
  std::vector<double> medians;
  for (const auto& block : blocks) {
    if (!block.empty()) medians.push_back(median(block));
  }
  const double n = static_cast<double>(medians.size());
  if (n < 4) return std::abs(medians.back() - medians.front()) + 1e-3;  // too few to say: at least 0.001 periods
  const double mean = std::accumulate(medians.begin(), medians.end(), 0.0) / n;
  double sum = 0;
  for (const double m : medians) sum += (m - mean) * (m - mean);
  return std::sqrt(sum / (n - 1) / n);
}

/// Eq. 5 by least squares through the medians of blocks of lines, each kind of edge about its own median; takes the tilt
/// off the deltas.
Uncertain take_off_tilt(std::vector<LineDelta> (&kinds)[2], int lines) {
  struct Block {
    double t, delta;
  };
  std::vector<Block> points;
  for (const auto& kind : kinds) {
    if (static_cast<int>(kind.size()) < kMinEdges / 2) continue;
    std::vector<std::vector<double>> blocks(kBlocks);
    std::vector<double> all;
    for (const auto& d : kind) {
      blocks[static_cast<std::size_t>(static_cast<long>(d.line) * kBlocks / lines)].push_back(d.delta_periods);
      all.push_back(d.delta_periods);
    }
    const double middle = median(all);
    for (int b = 0; b < kBlocks; ++b) {
      if (!blocks[b].empty()) points.push_back({(b + 0.5) / kBlocks - 0.5, median(blocks[b]) - middle});
    }
  }
  const double n = static_cast<double>(points.size());
  double t = 0, d = 0, tt = 0, td = 0, rest = 0;
  for (const auto& p : points) {
    t += p.t / n;
    d += p.delta / n;
  }
  for (const auto& p : points) {
    tt += (p.t - t) * (p.t - t);
    td += (p.t - t) * (p.delta - d);
  }
  if (n < 6 || !(tt > 0.1)) return {0.0, 0.0};  // too short a stretch of lines to tell a slope
  const double slope = td / tt;
  for (const auto& p : points) rest += std::pow(p.delta - d - slope * (p.t - t), 2);
  for (auto& kind : kinds) {
    for (auto& e : kind) e.delta_periods -= slope * ((e.line + 0.5) / lines - 0.5);
  }
  return {slope, std::sqrt(rest / (n - 2) / tt)};
}

struct Measured {
  BitMisalignment bit;
  bool both_kinds = false;
  double farthest = 0;  // distance of the median from the prediction, periods
};

Measured measure_bit(const EdgeMap& map, int bit, double predicted_periods, double period_mm) {
  std::vector<LineDelta> kinds[2];
  for (const auto& segment : map.segments) {
    for (const GrayEdge& e : segment.edges) {
      if (e.bit != bit) continue;
      const double rest = e.q_periods - predicted_periods;
      kinds[e.rising ? 1 : 0].push_back({segment.line, predicted_periods + rest - std::round(rest)});
    }
  }
  Measured out;
  const Uncertain tilt = take_off_tilt(kinds, map.lines);
  out.bit.tilt_mm = {tilt.value * period_mm, tilt.u * period_mm};
  out.bit.bit = bit;
  out.bit.n_edges = static_cast<int>(kinds[0].size() + kinds[1].size());
  out.both_kinds = kinds[0].size() >= kMinEdges / 2 && kinds[1].size() >= kMinEdges / 2;
  double value[2] = {}, u[2] = {};
  for (int k = 0; k < 2; ++k) {
    if (kinds[k].empty()) continue;
    std::vector<double> deltas;
    for (const auto& d : kinds[k]) deltas.push_back(d.delta_periods);
    value[k] = median(deltas);
    u[k] = u_of_median(kinds[k], map.lines);
  }
  double delta = 0, u_noise = 0;
  if (out.both_kinds) {
    delta = 0.5 * (value[0] + value[1]);
    u_noise = 0.5 * std::hypot(u[0], u[1]);
  } else {
    const int k = kinds[1].size() > kinds[0].size() ? 1 : 0;
    delta = value[k];
    value[1 - k] = delta;
    u_noise = u[k];
  }
  out.farthest = delta - predicted_periods;
  out.bit.delta_mm.value = delta * period_mm;
  out.bit.fraction_of_period = delta;
  out.bit.falling_mm = value[0] * period_mm;
  out.bit.rising_mm = value[1] * period_mm;
  out.bit.u_noise_mm = u_noise * period_mm;
  return out;
}

struct AngleFit {
  Uncertain theta;
  double chi2_per_dof = 0;
  int dof = 0;
  Eigen::VectorXd weights;  // sin(theta) = weights . delta
  double u_noise = 0;       // of theta.u, without the patterns' places
};

/// cov(e) of eq. 4, mm^2, for the places of the bits used and then of the phase steps; delta = L sin(theta) + T e.
struct Places {
  Eigen::MatrixXd covariance, T;
  double slide2 = 0;  // the part of the diagonal that is new in every stack
  Eigen::MatrixXd of_deltas() const { return T * covariance * T.transpose(); }
};

Places places_of(const std::vector<BitMisalignment>& bits, const Slots& slots, const GratingLayout& layout,
                 int stacks) {
  std::vector<double> place_mm;  // along the slide: the bits used, then the phase steps
  place_mm.reserve(bits.size() + slots.phase_steps.size());
  for (const auto& b : bits) place_mm.push_back(slots.gray[b.bit] * layout.pattern_pitch_mm);
  for (const double slot : slots.phase_steps) place_mm.push_back(slot * layout.pattern_pitch_mm);
  const auto [first, last] = std::minmax_element(place_mm.begin(), place_mm.end());
  const double smooth_mm = std::max((*last - *first) / std::numbers::pi, layout.pattern_pitch_mm);
  const auto n = static_cast<Eigen::Index>(place_mm.size()), n_bits = static_cast<Eigen::Index>(bits.size());
  const double slide2 = layout.u_slide_mm * layout.u_slide_mm / stacks;
  Eigen::MatrixXd e(n, n), T = Eigen::MatrixXd::Zero(n_bits, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const double t = (place_mm[i] - place_mm[j]) / smooth_mm;
      e(i, j) = layout.straightness_mm * layout.straightness_mm / kPathPeakToPeak2 * std::exp(-0.5 * t * t);
    }
    e(i, i) += layout.u_lithography_mm * layout.u_lithography_mm + slide2;
  }
  T.leftCols(n_bits).setIdentity();
  for (std::size_t k = 0; k < slots.weights.size(); ++k) {
    T.col(n_bits + static_cast<Eigen::Index>(k)).setConstant(-slots.weights[k]);
  }
  return {e, T, slide2};
}

/// Eq. 4 by generalised least squares.
AngleFit fit_angle(const std::vector<BitMisalignment>& bits, const Places& places) {
  Eigen::MatrixXd covariance = places.of_deltas();
  const auto n = static_cast<Eigen::Index>(bits.size());
  Eigen::VectorXd L(n), delta(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BitMisalignment& bit = bits[static_cast<std::size_t>(i)];
    L[i] = bit.lever_mm;
    delta[i] = bit.delta_mm.value;
    covariance(i, i) += bit.u_noise_mm * bit.u_noise_mm;
  }
  const Eigen::LLT<Eigen::MatrixXd> V(covariance);
  const Eigen::VectorXd weights = V.solve(L);
  const double information = L.dot(weights), sine = weights.dot(delta) / information;
  AngleFit fit{.theta = {std::asin(sine), 1.0 / std::sqrt(information)}, .weights = weights / information};
  for (Eigen::Index i = 0; i < n; ++i) {
    fit.u_noise = std::hypot(fit.u_noise, fit.weights[i] * bits[static_cast<std::size_t>(i)].u_noise_mm);
  }
  const Eigen::VectorXd residual = delta - L * sine;
  fit.dof = static_cast<int>(n) - 1;
  fit.chi2_per_dof = fit.dof > 0 ? residual.dot(V.solve(residual)) / fit.dof : 0.0;
  return fit;
}

/// The chi2/dof that chance exceeds once in a thousand times (Wilson and Hilferty's cube).
double chi2_limit(int dof) {
  const double t = 2.0 / (9.0 * dof);
  return std::pow(1.0 - t + 3.09 * std::sqrt(t), 3.0);
}

void add_jump_figures(const decode::PhaseMap& plain, Misalignment& result) {
  const auto jumps = count_jumps(plain);
  if (!jumps) {
    result.remarks.push_back("no whole-pixel figure: " + jumps.error().sentence);
    return;
  }
  for (const JumpCount& jump : *jumps) {
    for (auto& bit : result.bits) {
      if (bit.bit != jump.bit) continue;
      bit.jump_px = jump.jump_px;
      bit.period_px = jump.period_px;
    }
  }
}

/// Whether the witness (its angle and noise already in `result`) agrees.
void judge_steps(const Slots& slots, const GratingLayout& layout, const AngleFit& fit, const Places& places,
                 Misalignment& result) {
  if (!result.theta_from_steps_rad) return;
  const std::vector<double> v = step_weights(layout.pattern_pitch_mm, slots.phase_steps);
  Eigen::VectorXd of_steps = Eigen::VectorXd::Zero(places.covariance.rows());
  const auto n_steps = static_cast<Eigen::Index>(v.size());
  for (Eigen::Index k = 0; k < n_steps; ++k) {
    of_steps[of_steps.size() - n_steps + k] = v[static_cast<std::size_t>(k)];
  }
  const Eigen::VectorXd between = of_steps - places.T.transpose() * fit.weights;
  const auto u_with = [&](const Eigen::VectorXd& weights, double u) {
    return std::sqrt(weights.dot(places.covariance * weights) + u * u);
  };
  Uncertain& steps = *result.theta_from_steps_rad;
  steps.u = u_with(of_steps, result.u_steps_noise_rad);
  result.u_difference_rad = u_with(between, std::hypot(result.u_steps_noise_rad, fit.u_noise));
  const double difference = steps.value - result.theta_rad.value;
  if (std::abs(difference) > 3 * result.u_difference_rad) {
    result.remarks.push_back(fmt::format(
        "the phase steps' own ripple tells another angle, {:+.3f} mrad, than the Gray edges, {:+.3f} mrad: they differ "
        "by {:.1f} standard uncertainties; check the layout of the patterns, and that nothing moved during the capture",
        1e3 * steps.value, 1e3 * result.theta_rad.value, std::abs(difference) / result.u_difference_rad));
  }
}

/// What the bits determine and what they leave open.
std::string scope_of(const Misalignment& result, const GratingLayout& layout) {
  const auto [shortest, longest] =
      std::minmax_element(result.bits.begin(), result.bits.end(),
                          [](const auto& a, const auto& b) { return std::abs(a.lever_mm) < std::abs(b.lever_mm); });
  return fmt::format(
      "{} bits, {:.0f} to {:.0f} mm from the phase patterns, determine the angle to {:.4f} mrad; {:.4f} mrad "
      "of it come from the frames and the slide and get less with more captures, the rest is where the patterns stand "
      "on the glass and on the slide's path ({:.2f} and {:.2f} um, from the layout): of these places the captures tell "
      "only "
      "the scatter about one angle",
      result.bits.size(), std::abs(shortest->lever_mm), std::abs(longest->lever_mm), 1e3 * result.theta_rad.u,
      1e3 * result.u_noise_rad, 1e3 * layout.u_lithography_mm, 1e3 * layout.straightness_mm);
}

/// Eq. 4 for the deltas in `result`: theta, its parts, the witness, what is open.
void solve(Misalignment& result, const Slots& slots, const GratingLayout& layout, double period_mm) {
  auto& bits = result.bits;
  const Places places = places_of(bits, slots, layout, result.stacks);
  const Eigen::MatrixXd covariance = places.of_deltas();
  AngleFit fit = fit_angle(bits, places);
  if (bits.size() == 1) {
    result.remarks.push_back(
        "one bit only: what the patterns' placement errors do and what the angle does cannot be told apart");
  } else if (fit.chi2_per_dof > chi2_limit(fit.dof)) {
    const double widening = std::sqrt(fit.chi2_per_dof);
    fit.theta.u *= widening;
    result.remarks.push_back(
        fmt::format("the bits contradict one angle beyond chance (chi2/dof {:.1f}): the uncertainty is "
                    "widened {:.1f} times; check the layout of the patterns and their placement",
                    fit.chi2_per_dof, widening));
  }
  result.theta_rad = fit.theta;
  result.chi2_per_dof = fit.chi2_per_dof;
  result.u_noise_rad = std::hypot(fit.u_noise, std::sqrt(places.slide2) * (places.T.transpose() * fit.weights).norm());
  for (std::size_t i = 0; i < bits.size(); ++i) {
    const auto diagonal = static_cast<Eigen::Index>(i);
    bits[i].delta_mm.u = std::sqrt(bits[i].u_noise_mm * bits[i].u_noise_mm + covariance(diagonal, diagonal));
  }
  std::sort(bits.begin(), bits.end(), [](const auto& a, const auto& b) { return a.bit > b.bit; });
  const double lever = bits.front().lever_mm;
  result.delta_mm = {lever * std::sin(fit.theta.value), std::abs(lever) * fit.theta.u};
  result.fraction_of_period = result.delta_mm.value / period_mm;
  result.remarks.push_back(scope_of(result, layout));
  for (const auto& bit : bits) {
    // Beyond chance, and no less than the places of single patterns scatter.
    if (std::abs(bit.tilt_mm.value) <= 4 * bit.tilt_mm.u || std::abs(bit.tilt_mm.value) < layout.u_slide_mm) continue;
    result.remarks.push_back(
        fmt::format("delta of bit {} grows by {:+.2f} um along the fringes: that pattern lies askew on the grating, or "
                    "the slide yaws",
                    bit.bit, 1e3 * bit.tilt_mm.value));
  }
  judge_steps(slots, layout, fit, places, result);
}

}  // namespace

Result<Misalignment> measure_misalignment(const Capture& capture, const GratingLayout& layout, CodeAxis axis) {
  const FringeCode& code = checked_code(capture, layout, axis);
  const Slots slots = slots_of(code, layout);
  const EdgeMap map = find_edges(capture, axis);
  if (const auto defect = defect_of(map, capture)) return unanswerable(*defect);

  Misalignment result;
  const int finest = code.gray_bits - (code.stripes_per_period == 2 ? 2 : 1);
  const auto lever_mm = [&](int bit) { return (slots.phase - slots.gray[bit]) * layout.pattern_pitch_mm; };
  if (code.stripes_per_period == 2) {
    result.remarks.push_back(fmt::format("bit {} toggles in the middle of a period and makes no jump", finest + 1));
  }

  // A start for the angle: whichever figure has the shorter lever is the less ambiguous.
  double theta = 0;
  const double step_mm = finest >= 1 ? lever_mm(finest - 1) - lever_mm(finest) : 0;
  if (step_mm != 0 && std::abs(step_mm) < std::abs(lever_mm(finest))) {
    if (const auto difference = difference_of_finest(map, finest)) theta = *difference * code.period / step_mm;
  }
  std::vector<int> order(static_cast<std::size_t>(finest) + 1);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return std::abs(lever_mm(a)) < std::abs(lever_mm(b)); });
  std::vector<Measured> bits;
  for (const int b : order) {
    Measured measured = measure_bit(map, b, theta * lever_mm(b) / code.period, code.period);
    measured.bit.lever_mm = lever_mm(b);
    if (measured.bit.n_edges < kMinEdges) {
      result.remarks.push_back(fmt::format("bit {} is left out: {} edges in the picture, {} are needed", b,
                                           measured.bit.n_edges, kMinEdges));
      continue;
    }
    if (std::abs(measured.farthest) > 0.35) {
      return unanswerable(
          fmt::format("the edges of bit {} lie {:.2f} periods from where the finer bits put them, so the wrap "
                      "they belong to is not certain: check the plan's stripes_per_period ({}) and the order "
                      "of the patterns on the slide",
                      b, measured.farthest, code.stripes_per_period));
    }
    bits.push_back(measured);
    double top = 0, bottom = 0;
    for (const auto& m : bits) {
      top += m.bit.lever_mm * m.bit.delta_mm.value;
      bottom += m.bit.lever_mm * m.bit.lever_mm;
    }
    if (bottom > 0) theta = top / bottom;
  }
  if (bits.empty()) {
    return unanswerable(fmt::format(
        "no Gray bit has {} edges in the picture: a larger part of the board must be in the field", kMinEdges));
  }

  // A bit that shows one kind of edge only keeps what shifts its threshold; the others tell how much that is.
  double sum = 0;
  int n_both = 0;
  for (const auto& m : bits) {
    if (!m.both_kinds) continue;
    sum += std::pow(0.5 * (m.bit.rising_mm - m.bit.falling_mm), 2);
    ++n_both;
  }
  const double u_threshold_mm = n_both > 0 ? std::sqrt(sum / n_both) : 0.001 * code.period;
  for (auto& m : bits) {
    if (!m.both_kinds) m.bit.u_noise_mm = std::hypot(m.bit.u_noise_mm, u_threshold_mm);
  }

  for (const auto& m : bits) result.bits.push_back(m.bit);
  const auto plain = decode::decode_phase(capture, axis, {.edges = decode::EdgeRule::plain});
  add_jump_figures(plain, result);
  const auto steps = angle_from_steps(plain, layout.pattern_pitch_mm, slots.phase_steps);
  if (steps) {
    result.theta_from_steps_rad = steps->theta_rad;
    result.u_steps_noise_rad = steps->theta_rad.u;
  } else {
    result.remarks.push_back("no second angle from the phase steps: " + steps.error().sentence);
  }
  solve(result, slots, layout, code.period);
  return result;
}

Misalignment average_of(std::span<const Misalignment> stacks, const GratingLayout& layout, const FringeCode& code) {
  require(!stacks.empty(), "an average is over at least one stack");
  Misalignment out = stacks.front();
  out.stacks = static_cast<int>(stacks.size());
  const double n = static_cast<double>(stacks.size());
  std::erase_if(out.bits, [&](const BitMisalignment& bit) {
    return std::any_of(stacks.begin(), stacks.end(), [&](const Misalignment& m) {
      return std::none_of(m.bits.begin(), m.bits.end(), [&](const auto& other) { return other.bit == bit.bit; });
    });
  });
  require(!out.bits.empty(), "the stacks to average have a bit in common");
  for (BitMisalignment& bit : out.bits) {
    BitMisalignment sum{.bit = bit.bit, .lever_mm = bit.lever_mm, .jump_px = bit.jump_px, .period_px = bit.period_px};
    for (const Misalignment& m : stacks) {
      const auto one = std::find_if(m.bits.begin(), m.bits.end(), [&](const auto& b) { return b.bit == bit.bit; });
      sum.delta_mm.value += one->delta_mm.value / n;
      sum.fraction_of_period += one->fraction_of_period / n;
      sum.rising_mm += one->rising_mm / n;
      sum.falling_mm += one->falling_mm / n;
      sum.u_noise_mm = std::hypot(sum.u_noise_mm, one->u_noise_mm / n);
      sum.tilt_mm = {sum.tilt_mm.value + one->tilt_mm.value / n, std::hypot(sum.tilt_mm.u, one->tilt_mm.u / n)};
      sum.n_edges += one->n_edges;
    }
    bit = sum;
  }
  out.remarks = {fmt::format("mean of {} captures", stacks.size())};
  out.theta_from_steps_rad = Uncertain{};
  out.u_steps_noise_rad = 0;
  for (const Misalignment& m : stacks) {
    if (!m.theta_from_steps_rad) {
      out.theta_from_steps_rad.reset();
      break;
    }
    out.theta_from_steps_rad->value += m.theta_from_steps_rad->value / n;
    out.u_steps_noise_rad = std::hypot(out.u_steps_noise_rad, m.u_steps_noise_rad / n);
  }
  solve(out, slots_of(code, layout), layout, code.period);
  return out;
}

AlignmentProfile alignment_profile(const Capture& capture, CodeAxis axis, int row) {
  const auto& code = capture.info.plan.code(axis);
  decode::DecodeOptions plain;
  plain.edges = decode::EdgeRule::plain;
  const auto map = decode::decode_phase(capture, axis, plain);
  const bool rows = axis == CodeAxis::x;
  if (!(row >= 0 && row < (rows ? map.height() : map.width()))) {
    throw InputError(fmt::format("row {} is outside of the picture ({} rows along the code)", row,
                                 rows ? map.height() : map.width()));
  }
  AlignmentProfile profile{.row = row, .column = {}, .gray_number = {}, .phase_rad = {}, .wrapped_rad = {}};
  for (int i = 0; i < (rows ? map.width() : map.height()); ++i) {
    const int x = rows ? i : row, y = rows ? row : i;
    if (!map.valid(x, y)) continue;
    int number = 0, bit = 0;  // binary reflected: each binary digit is the sum of the Gray bits so far
    for (int b = 0; b < code->gray_bits; ++b) {
      const auto& frame = capture.frames[*capture.info.plan.find({PatternKind::gray, axis, b})];
      const double level = std::visit([&](const auto& image) { return static_cast<double>(image(x, y)); }, frame);
      bit ^= level > map.mean(x, y) ? 1 : 0;
      number = 2 * number + bit;
    }
    profile.column.push_back(i);
    profile.gray_number.push_back(number);
    profile.phase_rad.push_back(map.phase_rad(x, y));
    profile.wrapped_rad.push_back(map.wrapped_rad(x, y));
  }
  return profile;
}

}  // namespace fringecal::calib

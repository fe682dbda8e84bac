#include "calib/decode/four_step.h"

#include "calib/decode/decode.h"
#include "calib/decode/gray.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "calib/decode/four_step.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fringecal::decode {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using F = hn::ScalableTag<float>;
using I = hn::RebindToSigned<F>;
using VF = hn::Vec<F>;
using VI = hn::Vec<I>;

/// Integers of one step: 16 bits hold 4 t_b of 8-bit frames, 32 bits that of 16-bit frames. kParts vectors of floats
/// belong to one of integers. Without vectors there is nothing to split.
#if HWY_TARGET == HWY_SCALAR
template <class Pixel>
using Wide = I;
template <class Pixel>
constexpr int kParts = 1;
#else
template <class Pixel>
using Wide = std::conditional_t<sizeof(Pixel) == 1, hn::Repartition<std::int16_t, F>, I>;
template <class Pixel>
constexpr int kParts = sizeof(Pixel) == 1 ? 2 : 1;
#endif

template <class Pixel>
HWY_INLINE hn::Vec<Wide<Pixel>> load(const void* frame, std::size_t at) {
  const Wide<Pixel> d;
  const hn::Rebind<Pixel, Wide<Pixel>> narrow;
  return hn::PromoteTo(d, hn::LoadU(narrow, static_cast<const Pixel*>(frame) + at));
}

/// Part kPart of a vector of integers in 32 bits, and back.
template <int kPart>
HWY_INLINE VI widened(VI v) {
  return v;
}
HWY_INLINE VI narrowed(const VI (&parts)[1]) { return parts[0]; }
#if HWY_TARGET != HWY_SCALAR
template <int kPart>
HWY_INLINE VI widened(hn::Vec<hn::Repartition<std::int16_t, F>> v) {
  const hn::Half<hn::Repartition<std::int16_t, F>> half;
  if constexpr (kPart == 0) {
    return hn::PromoteTo(I(), hn::LowerHalf(half, v));
  } else {
    return hn::PromoteTo(I(), hn::UpperHalf(half, v));
  }
}
HWY_INLINE hn::Vec<hn::Repartition<std::int16_t, F>> narrowed(const VI (&parts)[2]) {
  const hn::Repartition<std::int16_t, F> d;
  const hn::Half<decltype(d)> half;
  return hn::Combine(d, hn::DemoteTo(half, parts[1]), hn::DemoteTo(half, parts[0]));
}
#endif
template <int kPart, class V>
HWY_INLINE VF as_float(V v) {
  return hn::ConvertTo(F(), widened<kPart>(v));
}

/// Eq. 2, in (-pi, pi]; 0 for (0, 0).
HWY_INLINE VF arc_tangent(VF s, VF c) {
  const F d;
  const VF y = hn::Abs(s), x = hn::Abs(c);
  const VF low = hn::Min(x, y), high = hn::Max(hn::Max(x, y), hn::Set(d, 1.0f));  // integers: 1 replaces only 0
  const auto reduce = hn::Gt(low, hn::Mul(hn::Set(d, 0.41421356f), high));
  const VF a =
      hn::Div(hn::IfThenElse(reduce, hn::Sub(low, high), low), hn::IfThenElse(reduce, hn::Add(low, high), high));
  const VF z = hn::Mul(a, a);
  VF p = hn::Sub(hn::Mul(hn::Set(d, 8.05374449538e-2f), z), hn::Set(d, 1.38776856032e-1f));
  p = hn::Add(hn::Mul(p, z), hn::Set(d, 1.99777106478e-1f));
  p = hn::Sub(hn::Mul(p, z), hn::Set(d, 3.33329491539e-1f));
  VF angle = hn::Add(hn::Mul(hn::Mul(p, z), a), a);
  constexpr float kPi = std::numbers::pi_v<float>;
  angle = hn::Add(angle, hn::IfThenElseZero(reduce, hn::Set(d, kPi / 4)));
  angle = hn::IfThenElse(hn::Gt(y, x), hn::Sub(hn::Set(d, kPi / 2), angle), angle);
  angle = hn::IfThenElse(hn::Lt(c, hn::Zero(d)), hn::Sub(hn::Set(d, kPi), angle), angle);
  return hn::CopySignToAbs(angle, s);
}

/// The task's constants.
struct Constants {
  VF read, gain, least_power, shadow_power;
  float periods;
};

/// |4 t| of the bits beside the pixel's stripe, for OrderRule::whole_stripe.
template <class V>
struct Beside {
  V strongest, sum, below, above;
};

/// The |4 t| of the bit that toggles at `upper`, `none` where no bit does (gray.h, toggling_bit).
template <class D, class V = hn::Vec<D>>
HWY_INLINE V toggling(D d, V upper, const V* sizes, int bits, V none) {
  using T = hn::TFromD<D>;
  V out = none;
  for (int b = 0; b < bits; ++b) {
    const T h = static_cast<T>(1 << (bits - 1 - b));
    const auto here = hn::Eq(hn::And(upper, hn::Set(d, static_cast<T>(2 * h - 1))), hn::Set(d, h));
    out = hn::IfThenElse(here, sizes[b], out);
  }
  return out;
}

struct Order {
  VF m;
  hn::Mask<F> consistent;
};

/// gray.h, eqs. 3 and 4.
HWY_INLINE Order order_of_half_stripe(VF stripe, VF wrapped, float periods) {
  const F d;
  const VF half = hn::Set(d, 0.5f);
  const VF q =
      hn::Sub(hn::Sub(hn::Mul(half, hn::Add(stripe, half)), half), hn::Mul(wrapped, hn::Set(d, kTurnsPerRadian)));
  const VF m = hn::Floor(hn::Add(q, half));
  return {m, hn::And(hn::Le(hn::Abs(hn::Sub(q, m)), hn::Set(d, 0.375f)),
                     hn::And(hn::Ge(m, hn::Zero(d)), hn::Lt(m, hn::Set(d, periods))))};
}

/// gray.h, eqs. 5 and 6, from |4 t|.
HWY_INLINE Order order_of_whole_stripe(VF stripe, VF wrapped, VF u_phi, VF variance, int bits, const Beside<VF>& four) {
  const F d;
  constexpr float kPi = std::numbers::pi_v<float>;
  const VF quarter = hn::Set(d, 0.25f);
  const VF strongest = hn::Mul(quarter, four.strongest), below = hn::Mul(quarter, four.below),
           above = hn::Mul(quarter, four.above), size = hn::Abs(wrapped);
  const auto inner = hn::Le(size, hn::Set(d, kPi / 2));
  const auto decided = hn::Ge(hn::Min(below, above), hn::Mul(hn::Set(d, kSurelyAtThreshold), strongest));  // (6)
  const auto upper_half = hn::Gt(wrapped, hn::Zero(d));
  const VF own = hn::IfThenElse(upper_half, above, below), neighbour = hn::IfThenElse(upper_half, below, above);
  const VF full = bits > 2 ? hn::Div(hn::Sub(hn::Sub(hn::Mul(quarter, four.sum), below), above),
                                     hn::Set(d, static_cast<float>(bits - 2)))
                           : strongest;
  const VF s_t_squared = hn::Add(hn::Mul(hn::Set(d, 1.25f), variance),
                                 hn::Mul(hn::Set(d, kLevelSpread * kLevelSpread), hn::Mul(full, full)));
  const VF evidence = hn::Mul(hn::Sub(own, neighbour), hn::Sub(hn::Add(full, full), hn::Add(own, neighbour)));
  const VF z = hn::Div(hn::Sub(hn::Set(d, kPi), size), u_phi);
  const VF limit = hn::Min(hn::Set(d, 2 * kUnlikely), hn::Mul(z, hn::Add(z, hn::Set(d, 2.0f))));
  const auto likely = hn::And(hn::Lt(neighbour, own), hn::Gt(evidence, hn::Mul(s_t_squared, limit)));
  const auto take = hn::And(hn::Gt(size, hn::Set(d, 3 * kPi / 4)), likely);  // (5)
  const VF step = hn::IfThenElse(upper_half, hn::Set(d, -1.0f), hn::Set(d, 1.0f));
  return {hn::Add(stripe, hn::IfThenElseZero(take, step)), hn::Or(hn::Not(inner), decided)};
}

/// Everything of one vector of integers from pixel `at`. kBits: of the code; 0: task.bits.
template <class Pixel, OrderRule kRule, int kBits>
HWY_INLINE void decode_step(const FourStepTask& task, const Constants& k, std::size_t at) {
  using D = Wide<Pixel>;
  using T = hn::TFromD<D>;
  using V = hn::Vec<D>;
  constexpr int kFloats = kParts<Pixel>;
  const D d;
  const F f;
  const int bits = kBits > 0 ? kBits : task.bits;

  const V i0 = load<Pixel>(task.phase[0], at), i1 = load<Pixel>(task.phase[1], at), i2 = load<Pixel>(task.phase[2], at),
          i3 = load<Pixel>(task.phase[3], at);
  const V s = hn::Sub(i1, i3), c = hn::Sub(i0, i2);
  const V four_mean = hn::Add(hn::Add(i0, i1), hn::Add(i2, i3));
  const auto saturated =
      hn::Gt(hn::Max(hn::Max(i0, i1), hn::Max(i2, i3)), hn::Set(d, static_cast<T>(task.saturation - 1)));

  V stripe = hn::Zero(d), bit = hn::Zero(d), sizes[kBits > 0 ? kBits : FourStepTask::kMostBits];
  sizes[0] = stripe;
#pragma GCC unroll 8
  for (int b = 0; b < bits; ++b) {
    const V minus = hn::Sub(four_mean, hn::ShiftLeft<2>(load<Pixel>(task.gray[b], at)));  // -4 t_b, eq. 1
    bit = hn::Xor(bit, hn::BroadcastSignBit(minus));                                      // all ones: binary bit 1
    stripe = hn::Sub(hn::Add(stripe, stripe), bit);
    if constexpr (kRule != OrderRule::plain) sizes[b] = hn::Abs(minus);
  }
  // The least |4 t| of the bits that do not toggle near the pixel.
  V least = hn::Set(d, hwy::HighestValue<T>());
  Beside<V> beside;
  if constexpr (kRule != OrderRule::plain) {
#pragma GCC unroll 8
    for (int b = 0; b + 2 < bits; ++b) {
      const T h = static_cast<T>(1 << (bits - 1 - b));
      const V from = hn::And(hn::Sub(hn::Set(d, static_cast<T>(h + 1)), stripe), hn::Set(d, static_cast<T>(2 * h - 1)));
      least = hn::IfThenElse(hn::Gt(from, hn::Set(d, T{3})), hn::Min(least, sizes[b]), least);  // (4)
    }
    if constexpr (kRule == OrderRule::whole_stripe) {
      beside.strongest = beside.sum = sizes[0];
      for (int b = 1; b < bits; ++b) {
        beside.strongest = hn::Max(beside.strongest, sizes[b]);
        beside.sum = hn::Add(beside.sum, sizes[b]);
      }
      beside.below = toggling(d, stripe, sizes, bits, beside.strongest);
      beside.above = toggling(d, hn::Add(stripe, hn::Set(d, T{1})), sizes, bits, beside.strongest);
    }
  }
  const V flags = hn::VecFromMask(d, saturated);

  VI codes[kFloats];
  const auto finish = [&](auto part) {
    constexpr int p = decltype(part)::value;
    const VF sine = as_float<p>(s), cosine = as_float<p>(c);
    const VF mean = hn::Mul(hn::Set(f, 0.25f), as_float<p>(four_mean));
    const VF power = hn::Add(hn::Mul(sine, sine), hn::Mul(cosine, cosine));  // 4 B^2
    const VF variance = hn::Max(hn::Set(f, 1.0f / 12.0f), hn::Add(k.read, hn::Mul(k.gain, mean)));
    const VF wrapped = arc_tangent(sine, cosine);
    const auto modulation_of = [&] { return hn::Mul(hn::Set(f, 0.5f), hn::Sqrt(power)); };
    const auto u_phi_of = [&] {  // decode.h, eq. 4
      return hn::Div(hn::Mul(hn::Set(f, std::numbers::sqrt2_v<float> / 2), hn::Sqrt(variance)), modulation_of());
    };
    VI code = hn::Zero(I());
    const auto say = [&](hn::Mask<F> where, Validity what) {
      code = hn::IfThenElse(hn::RebindMask(I(), where), hn::Set(I(), static_cast<std::int32_t>(what)), code);
    };
    VF m;
    // Of the reasons the last one said stands.
    if constexpr (kRule == OrderRule::plain) {
      m = as_float<p>(task.stripes_per_period == 2 ? hn::ShiftRight<1>(stripe) : stripe);
    } else {
      Order order;
      if constexpr (kRule == OrderRule::half_stripe) {
        order = order_of_half_stripe(as_float<p>(stripe), wrapped, k.periods);
      } else {
        order = order_of_whole_stripe(as_float<p>(stripe), wrapped, u_phi_of(), variance, bits,
                                      {as_float<p>(beside.strongest), as_float<p>(beside.sum),
                                       as_float<p>(beside.below), as_float<p>(beside.above)});
      }
      m = order.m;
      const VF smallest = as_float<p>(least);
      const auto decided = hn::Gt(hn::Mul(smallest, smallest), hn::Mul(hn::Set(f, 16.0f), variance));  // (3)
      say(hn::Not(hn::And(order.consistent, decided)), Validity::inconsistent_code);
    }
    say(hn::Lt(power, k.least_power), Validity::low_modulation);
    say(hn::Not(hn::Gt(power, hn::Mul(k.shadow_power, variance))), Validity::shadow);
    say(hn::RebindMask(f, hn::Lt(widened<p>(flags), hn::Zero(I()))), Validity::saturated);
    codes[p] = code;

    const auto valid = hn::RebindMask(f, hn::Eq(code, hn::Zero(I())));
    const VF nan = hn::Set(f, std::numeric_limits<float>::quiet_NaN());
    const VF phase = hn::Add(hn::Mul(hn::Set(f, 2 * std::numbers::pi_v<float>), m), wrapped);  // decode.h, eq. 3
    const std::size_t to = at + p * hn::Lanes(f);
    hn::StoreU(hn::IfThenElse(valid, phase, nan), f, task.phase_rad + to);
    if (task.wrapped_rad) hn::StoreU(wrapped, f, task.wrapped_rad + to);
    if (task.modulation) hn::StoreU(modulation_of(), f, task.modulation + to);
    if (task.mean) hn::StoreU(mean, f, task.mean + to);
    if (task.u_phase_rad) hn::StoreU(hn::IfThenElse(valid, u_phi_of(), nan), f, task.u_phase_rad + to);
  };
  finish(std::integral_constant<int, 0>());
  if constexpr (kFloats == 2) finish(std::integral_constant<int, 1>());
  const hn::Rebind<std::uint8_t, D> bytes;
  hn::StoreU(hn::DemoteTo(bytes, narrowed(codes)), bytes, task.validity + at);
}

template <class Pixel, OrderRule kRule>
void decode_whole(const FourStepTask& task, const Constants& k, std::size_t first, std::size_t count) {
  const std::size_t step = hn::Lanes(Wide<Pixel>());
  if constexpr (sizeof(Pixel) == 1) {
    if (task.bits == 7) {  // the paper's; unrolled, the bits stay in registers
      for (std::size_t at = first; at < first + count; at += step) decode_step<Pixel, kRule, 7>(task, k, at);
      return;
    }
  }
  for (std::size_t at = first; at < first + count; at += step) decode_step<Pixel, kRule, 0>(task, k, at);
}

template <class Pixel, OrderRule kRule>
void decode_range_of(const FourStepTask& task, std::size_t first, std::size_t count) {
  const F d;
  const float least = task.min_modulation, shadow = task.shadow_modulation_per_sigma;
  const int periods = (1 << task.bits) / task.stripes_per_period;
  const Constants k{.read = hn::Set(d, task.read_variance),
                    .gain = hn::Set(d, task.gain),
                    .least_power = hn::Set(d, 4 * least * least),
                    .shadow_power = hn::Set(d, 4 * shadow * shadow),
                    .periods = static_cast<float>(periods)};
  constexpr std::size_t kMostLanes = HWY_MAX_BYTES / 2;
  const std::size_t step = hn::Lanes(Wide<Pixel>()), whole = count / step * step, rest = count - whole;
  decode_whole<Pixel, kRule>(task, k, first, whole);
  if (rest == 0) return;
  // The last few pixels in frames of one vector.
  Pixel in[4 + FourStepTask::kMostBits][kMostLanes] = {};
  float out[5][kMostLanes];
  std::uint8_t validity[kMostLanes];
  FourStepTask last = task;
  const std::size_t from = first + whole;
  for (std::size_t i = 0; i < 4 + static_cast<std::size_t>(task.bits); ++i) {
    const void*& frame = i < 4 ? last.phase[i] : last.gray[i - 4];
    std::copy_n(static_cast<const Pixel*>(frame) + from, rest, in[i]);
    frame = in[i];
  }
  float** const wanted[] = {&last.phase_rad, &last.wrapped_rad, &last.modulation, &last.mean, &last.u_phase_rad};
  float* const to[] = {task.phase_rad, task.wrapped_rad, task.modulation, task.mean, task.u_phase_rad};
  for (int i = 0; i < 5; ++i) *wanted[i] = to[i] ? out[i] : nullptr;
  last.validity = validity;
  decode_whole<Pixel, kRule>(last, k, 0, step);
  for (int i = 0; i < 5; ++i) {
    if (to[i]) std::copy_n(out[i], rest, to[i] + from);
  }
  std::copy_n(validity, rest, task.validity + from);
}

template <class Pixel>
void decode_range_with(const FourStepTask& task, std::size_t first, std::size_t count) {
  switch (task.rule) {
    case OrderRule::plain:
      return decode_range_of<Pixel, OrderRule::plain>(task, first, count);
    case OrderRule::half_stripe:
      return decode_range_of<Pixel, OrderRule::half_stripe>(task, first, count);
    case OrderRule::whole_stripe:
      return decode_range_of<Pixel, OrderRule::whole_stripe>(task, first, count);
  }
}

void decode_range(const FourStepTask& task, std::size_t first, std::size_t count) {
  if (task.wide) {
    decode_range_with<std::uint16_t>(task, first, count);
  } else {
    decode_range_with<std::uint8_t>(task, first, count);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace fringecal::decode
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fringecal::decode {

HWY_EXPORT(decode_range);

void decode_four_step(const FourStepTask& task, std::size_t first, std::size_t count) {
  HWY_DYNAMIC_DISPATCH(decode_range)(task, first, count);
}

}  // namespace fringecal::decode
#endif

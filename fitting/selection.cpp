#include "fitting/selection.h"

#include <bit>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "fitting/selection.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fringecal::fitting {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
constexpr std::size_t kByte = 8;
using D = hn::CappedTag<double, kByte>;

template <class Mask>
HWY_INLINE unsigned bits_of(Mask mask) {
  std::uint8_t bits[8] = {};
  hn::StoreMaskBits(D(), mask, bits);
  return bits[0];
}

void mark(std::span<const double> distances, double limit, std::uint8_t* out) {
  const D t;
  const auto at_most = hn::Set(t, limit);
  const std::size_t width = hn::Lanes(t), whole = distances.size() / kByte * kByte;
  for (std::size_t i = 0; i < whole; i += kByte) {
    unsigned bits = 0;
    for (std::size_t part = 0; part < kByte; part += width) {
      bits |= bits_of(hn::Le(hn::Abs(hn::LoadU(t, distances.data() + i + part)), at_most)) << part;
    }
    out[i / kByte] = static_cast<std::uint8_t>(bits);
  }
  for (std::size_t i = whole; i < distances.size(); ++i) {
    if (std::abs(distances[i]) <= limit) out[i / kByte] = static_cast<std::uint8_t>(out[i / kByte] | 1u << (i % kByte));
  }
}

void collect(std::span<const double> distances, std::span<const std::uint8_t> used, double low, double high,
             SizesBetween& out) {
  const D t;
  const auto from = hn::Set(t, low), to = hn::Set(t, high);
  const std::size_t width = hn::Lanes(t), whole = distances.size() / kByte * kByte;
  for (std::size_t i = 0; i < whole; i += kByte) {
    unsigned below = 0, between = 0;
    for (std::size_t part = 0; part < kByte; part += width) {
      const auto size = hn::Abs(hn::LoadU(t, distances.data() + i + part));
      below |= bits_of(hn::Lt(size, from)) << part;
      between |= bits_of(hn::And(hn::Ge(size, from), hn::Le(size, to))) << part;
    }
    out.below += static_cast<std::size_t>(std::popcount(below & used[i / kByte]));
    for (unsigned left = between & used[i / kByte]; left != 0; left &= left - 1) {
      out.sizes.push_back(std::abs(distances[i + static_cast<std::size_t>(std::countr_zero(left))]));
    }
  }
  for (std::size_t i = whole; i < distances.size(); ++i) {
    const double size = std::abs(distances[i]);
    if (!(used[i / kByte] >> (i % kByte) & 1)) continue;
    if (size < low) ++out.below;
    if (size >= low && size <= high) out.sizes.push_back(size);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace fringecal::fitting
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fringecal::fitting {

HWY_EXPORT(mark);
HWY_EXPORT(collect);

std::vector<std::uint8_t> marked_within(std::span<const double> distances, double limit) {
  std::vector<std::uint8_t> out((distances.size() + 7) / 8, 0);
  HWY_DYNAMIC_DISPATCH(mark)(distances, limit, out.data());
  return out;
}

SizesBetween sizes_between(std::span<const double> distances, std::span<const std::uint8_t> used, double low,
                           double high) {
  SizesBetween out;
  out.sizes.reserve(distances.size() / 16);
  HWY_DYNAMIC_DISPATCH(collect)(distances, used, low, high, out);
  return out;
}

}  // namespace fringecal::fitting
#endif

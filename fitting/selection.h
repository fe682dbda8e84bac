// Distances within limits, vectorised (Highway, run-time dispatch): comparisons only, so the same bits on every machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fringecal::fitting {

/// Bit i % 8 of byte i / 8: |distances[i]| <= limit. A distance that is not a number is not within.
std::vector<std::uint8_t> marked_within(std::span<const double> distances, double limit);

/// Of the points used (bits as above): how many sizes |d| are below `low`, and those from `low` to `high`, in order.
struct SizesBetween {
  std::size_t below = 0;
  std::vector<double> sizes;
};
SizesBetween sizes_between(std::span<const double> distances, std::span<const std::uint8_t> used, double low,
                           double high);

}  // namespace fringecal::fitting

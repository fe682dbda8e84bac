// The frames of a capture as the decoder wants them: which frame shows which pattern of one axis, and rows as floats,
// so that nothing below knows whether the camera delivered 8 or 16 bit.
#pragma once

#include "core/capture.h"

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

namespace fringecal::decode {

/// What a Gray bit is compared with, best first.
enum class BitReference { inverse, phase_mean, white_and_black };

struct AxisFrames {
  FringeCode code;
  CodeAxis axis = CodeAxis::x;
  std::vector<std::size_t> phase;                   // frame of step k
  std::vector<std::size_t> gray;                    // frame of bit b
  std::vector<std::optional<std::size_t>> inverse;  // frame of the inverse of bit b
  std::optional<std::size_t> white, black;

  bool has_white_and_black() const { return white && black; }
  BitReference reference_of(std::size_t bit) const {
    if (inverse[bit]) return BitReference::inverse;
    return phase.empty() ? BitReference::white_and_black : BitReference::phase_mean;
  }
};

/// Throws InputError where the capture has no code along that axis.
AxisFrames frames_of(const Capture& capture, CodeAxis axis);

inline void load_row(const GrayImage& image, int y, std::span<float> out) {
  std::visit(
      [&](const auto& i) {
        const auto row = i.row(y);
        std::copy(row.begin(), row.end(), out.begin());
      },
      image);
}

}  // namespace fringecal::decode

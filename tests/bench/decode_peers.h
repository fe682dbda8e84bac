// Other ways to decode four phase steps and a Gray code of two stripes per period: 8-bit frames, the phase steps first,
// then the Gray bits from the coarsest. All write the absolute phase and a mask of the pixels with enough modulation.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace fringecal::bench {

struct DecodePeerTask {
  int width = 0, height = 0;
  std::vector<const std::uint8_t*> frames;  // 4 + bits
  float* phase_rad = nullptr;
  std::uint8_t* invalid = nullptr;
};

/// The bound: every frame read once, both outputs written.
void touch_everything(const DecodePeerTask& task, std::size_t first, std::size_t count);

/// The float loop that a compiler vectorises by itself, std::atan2 by libmvec; the same half-stripe rule as ours.
void decode_by_float_loop(const DecodePeerTask& task);

/// cv::subtract, cv::phase, cv::magnitude, cv::compare, ... on whole images; plain orders.
void decode_by_opencv(const DecodePeerTask& task);

/// cv::structured_light: its three-step phase map and its unwrapping; empty where the package is not installed.
std::function<void(const DecodePeerTask&)> structured_light_decoder();

}  // namespace fringecal::bench

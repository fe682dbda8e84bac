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

/// native: compiled for this machine only; v3: for x86-64-v3 (AVX2); portable: for any x86-64.
#define FRINGECAL_DECODE_LOOPS(name)                                                       \
  namespace name {                                                                         \
  /* The bound: every frame read once, both outputs written. */                            \
  void touch_everything(const DecodePeerTask& task, std::size_t first, std::size_t count); \
  /* A float loop with std::atan2 by libmvec; the same half-stripe rule as ours. */        \
  void decode_by_float_loop(const DecodePeerTask& task);                                   \
  }
FRINGECAL_DECODE_LOOPS(native)
FRINGECAL_DECODE_LOOPS(v3)
FRINGECAL_DECODE_LOOPS(portable)

/// cv::subtract, cv::phase, cv::magnitude, cv::compare, ... on whole images; plain orders.
void decode_by_opencv(const DecodePeerTask& task);

/// cv::structured_light: its three-step phase map and its unwrapping; empty where the package is not installed.
std::function<void(const DecodePeerTask&)> structured_light_decoder();

}  // namespace fringecal::bench

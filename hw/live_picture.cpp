#include "hw/live_picture.h"

#include "core/error.h"

#include <algorithm>
#include <cstdint>

namespace fringecal::hw {
namespace {

template <class Pixel>
Image8 picture(const Image<Pixel>& frame, std::uint32_t saturation, int most_px) {
  const int b = std::max(1, (std::max(frame.width(), frame.height()) + most_px - 1) / most_px);
  Image8 out(frame.width() / b, frame.height() / b);
  const std::uint32_t full = saturation * static_cast<std::uint32_t>(b * b);
  for (int y = 0; y < out.height(); ++y) {
    for (int x = 0; x < out.width(); ++x) {
      std::uint32_t sum = 0, top = 0;
      for (int v = 0; v < b; ++v) {
        const Pixel* row = frame.row(y * b + v).data() + static_cast<std::ptrdiff_t>(x) * b;
        for (int u = 0; u < b; ++u) {
          sum += row[u];
          top = std::max<std::uint32_t>(top, row[u]);
        }
      }
      const std::uint64_t mean = (std::uint64_t{254} * sum + full / 2) / full;  // eq. 1
      out(x, y) = static_cast<std::uint8_t>(top >= saturation ? 255 : std::min<std::uint64_t>(254, mean));
    }
  }
  return out;
}

}  // namespace

Image8 live_picture(const GrayImage& frame, int saturation_level, int most_px) {
  require(saturation_level > 0 && most_px > 0, "a picture has a saturation and a size");
  return std::visit([&](const auto& f) { return picture(f, static_cast<std::uint32_t>(saturation_level), most_px); },
                    frame);
}

}  // namespace fringecal::hw

#include "cli/live_line.h"

#include "hw/live_picture.h"

#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

std::string base64(const std::vector<std::uint8_t>& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    unsigned group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < n ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? kDigits[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

}  // namespace

Value to_value(const hw::LiveFigures& f) {
  Value line = Value::object()
                   .set("level", f.level)
                   .set("mean", f.mean)
                   .set("saturated", f.saturated)
                   .set("sharpness", f.sharpness)
                   .set("histogram", Value::numbers(f.histogram));
  if (f.modulation) line.set("modulation", *f.modulation);
  return line;
}

void add_picture(Value& line, const GrayImage& frame, int saturation_level, int most_px) {
  const Image8 picture = hw::live_picture(frame, saturation_level, most_px);
  line.set("width_px", picture.width()).set("height_px", picture.height());
  line.set("grey_base64", base64(picture.values()));
}

}  // namespace fringecal::cli

#include "cli/live_line.h"

#include "hw/live_picture.h"
#include "reports/html.h"

namespace fringecal::cli {

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
  const auto& grey = picture.values();
  line.set("grey_base64", reports::base64({reinterpret_cast<const char*>(grey.data()), grey.size()}));
}

}  // namespace fringecal::cli

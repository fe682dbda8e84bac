// One look at a frame as JSON: the figures of hw/live_figures.h and, where a size is given, a small picture
// (hw/live_picture.h) as `width_px`, `height_px` and `grey_base64` (RFC 4648, section 4).
#pragma once

#include "core/image.h"
#include "core/value.h"
#include "hw/live_figures.h"

#include <optional>

namespace fringecal::cli {

Value to_value(const hw::LiveFigures& figures);
/// Sets the picture's keys. most_px: its longer side.
void add_picture(Value& line, const GrayImage& frame, int saturation_level, int most_px);

}  // namespace fringecal::cli

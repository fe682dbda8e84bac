// A frame small enough to be sent ten times a second: blocks of b x b pixels as one, b the smallest that leaves no side
// longer than `most_px`.
//   grey  254 * mean of the block / saturation, rounded; 255 where a pixel of the block is saturated                 (1)
// For looking at; nothing is measured on it.
#pragma once

#include "core/image.h"

namespace fringecal::hw {

Image8 live_picture(const GrayImage& frame, int saturation_level, int most_px);

}  // namespace fringecal::hw

// Pictures of a phase map, for people.
#pragma once

#include "calib/decode/decode.h"
#include "core/image_file.h"

namespace fringecal::decode {

/// Absolute phase as colour, dark blue (least) to yellow (most) [viridis, CC0], one percent of the pixels beyond either
/// end. With phase patterns every second period (of a wrapped map: the upper half) is a shade darker, so that each
/// fringe can be followed. Pixels without phase are grey.
Image<Rgb> picture_of_phase(const PhaseMap& map);

/// Validity: white valid, blue-black shadow, red saturated, orange low modulation, magenta inconsistent code.
Image<Rgb> picture_of_validity(const PhaseMap& map);

}  // namespace fringecal::decode

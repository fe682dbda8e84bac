// Figures of one frame for focusing and setting the light by hand.
//
// With I the grey value as a share of saturation, over all pixels that have the neighbours asked for:
//   histogram  shares of the pixels in 32 equal classes of I                                                      (1)
//   level      the value that all but 1e-4 of the pixels stay at or below
//   sharpness  S = mean((I(x+1,y) - I(x-1,y))^2 + (I(x,y+1) - I(x,y-1))^2) / mean(I)^2     [Krotkov1988, Tenengrad] (2)
//   modulation median over blocks of 32 x 32 pixels of (I95 - I05) / (I95 + I05), I95 and I05 the block's 95 % and 5 %
//              values (beyond 12 bits in steps of 1/4096 of saturation); blocks whose I95 is below 0.03 do not count:
//              nothing is lit there                                                                               (3)
// Larger S is sharper for the same scene, pattern and exposure; S has no meaning across scenes. Noise adds to (2) and
// (3), so both are figures to turn a ring by, not results.
#pragma once

#include "core/image.h"

#include <array>
#include <optional>

namespace fringecal::hw {

struct LiveFigures {
  std::array<double, 32> histogram{};
  double mean = 0, level = 0, saturated = 0;  // shares of saturation; saturated: share of the pixels
  double sharpness = 0;
  std::optional<double> modulation;  // absent where no block is lit
};

LiveFigures live_figures(const GrayImage& frame, int saturation_level);

}  // namespace fringecal::hw

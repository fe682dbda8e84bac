// Colour maps whose steps look as large as they are: lightness is linear in OKLab, so equal differences of the value
// are equal differences of lightness, also in a grey print and for colour-blind readers.
//   sequential  L = 0.24 -> 0.93, hue 290 -> 105 degrees (violet, teal, yellow)                        (1)
//   diverging   L = 0.40 -> 0.965 in the middle -> 0.40, blue below zero, red above                     (2)
// Every entry lies inside sRGB, so nothing is clipped. [Ottosson2020]
#pragma once

#include "core/image_file.h"

namespace fringecal::reports {

enum class ColourMap { sequential, diverging };

/// The colour at t in [0, 1]; t outside is held at the ends.
Rgb colour_at(ColourMap map, double t);

/// OKLab to sRGB in [0, 1] before clipping; for the gamut check.
std::array<double, 3> srgb_from_oklab(double lightness, double a, double b);
/// The OKLab coordinates of a map's entry.
std::array<double, 3> oklab_at(ColourMap map, double t);

/// Where there is no value.
inline constexpr Rgb kNoValue = {214, 214, 214};

}  // namespace fringecal::reports

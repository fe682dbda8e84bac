#include "reports/colour.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::reports {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// IEC 61966-2-1.
double encode_srgb(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
}

double cube(double x) { return x * x * x; }

}  // namespace

std::array<double, 3> srgb_from_oklab(double lightness, double a, double b) {
  // Ottosson's published matrices.
  const double l = cube(lightness + 0.3963377774 * a + 0.2158037573 * b);
  const double m = cube(lightness - 0.1055613458 * a - 0.0638541728 * b);
  const double s = cube(lightness - 0.0894841775 * a - 1.2914855480 * b);
  return {encode_srgb(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
          encode_srgb(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
          encode_srgb(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s)};
}

std::array<double, 3> oklab_at(ColourMap map, double t) {
  t = std::clamp(t, 0.0, 1.0);
  double lightness = 0, chroma = 0, hue = 0;
  if (map == ColourMap::sequential) {  // eq. 1
    lightness = 0.24 + 0.69 * t;
    hue = (290.0 - 185.0 * t) * kDegree;
    // sRGB is narrowest at t = 0.35 (blue-green, at most 0.091); from there the chroma grows to both ends.
    const double away = t < 0.35 ? (0.35 - t) / 0.35 : (t - 0.35) / 0.65;
    chroma = 0.088 + (t < 0.35 ? 0.042 : 0.062) * away * away;
  } else {  // eq. 2
    const double distance = std::abs(2.0 * t - 1.0);
    lightness = 0.965 - 0.565 * distance;
    hue = (t < 0.5 ? 255.0 : 30.0) * kDegree;
    chroma = 0.125 * distance;
  }
  return {lightness, chroma * std::cos(hue), chroma * std::sin(hue)};
}

Rgb colour_at(ColourMap map, double t) {
  const auto [lightness, a, b] = oklab_at(map, t);
  const auto rgb = srgb_from_oklab(lightness, a, b);
  Rgb out{};
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(rgb[k], 0.0, 1.0)));
  }
  return out;
}

}  // namespace fringecal::reports

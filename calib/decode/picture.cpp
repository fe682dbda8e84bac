#include "calib/decode/picture.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fringecal::decode {
namespace {

/// Viridis at steps of one eighth.
constexpr std::array<Rgb, 9> kColours = {{{68, 1, 84},
                                          {71, 44, 122},
                                          {59, 81, 139},
                                          {44, 113, 142},
                                          {33, 144, 141},
                                          {39, 173, 129},
                                          {92, 200, 99},
                                          {170, 220, 50},
                                          {253, 231, 37}}};
constexpr Rgb kNoPhase = {128, 128, 128};

Rgb colour(double part, double brightness) {
  const double place = std::clamp(part, 0.0, 1.0) * (kColours.size() - 1);
  const auto i = std::min(kColours.size() - 2, static_cast<std::size_t>(place));
  const double rest = place - static_cast<double>(i);
  Rgb out{};
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] =
        static_cast<std::uint8_t>(std::lround(brightness * ((1 - rest) * kColours[i][k] + rest * kColours[i + 1][k])));
  }
  return out;
}

}  // namespace

Image<Rgb> picture_of_phase(const PhaseMap& map) {
  Image<Rgb> out(map.width(), map.height(), kNoPhase);
  std::vector<float> phases;
  for (std::size_t i = 0; i < map.validity.size(); ++i) {
    if (map.validity.values()[i] == 0) phases.push_back(map.phase_rad.values()[i]);
  }
  if (phases.empty()) return out;
  const auto quantile = [&](double part) {
    const auto at = phases.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(phases.size() - 1));
    std::nth_element(phases.begin(), at, phases.end());
    return static_cast<double>(*at);
  };
  const double low = quantile(0.01), high = std::max(quantile(0.99), low + 1e-6);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (map.validity.values()[i] != 0) continue;
    const double phase = map.phase_rad.values()[i];
    const double periods = phase / (2 * std::numbers::pi) + 0.5;
    const bool lighter = map.code.phase_steps == 0 ||
                         (map.code.gray_bits > 0 ? static_cast<long>(std::floor(periods)) % 2 == 0 : periods < 0.5);
    out.values()[i] = colour((phase - low) / (high - low), lighter ? 1.0 : 0.8);
  }
  return out;
}

Image<Rgb> picture_of_validity(const PhaseMap& map) {
  constexpr std::array<Rgb, 5> kReasons = {
      {{255, 255, 255}, {20, 30, 70}, {220, 30, 30}, {245, 150, 30}, {220, 40, 200}}};
  Image<Rgb> out(map.width(), map.height());
  for (std::size_t i = 0; i < out.size(); ++i) out.values()[i] = kReasons[map.validity.values()[i]];
  return out;
}

}  // namespace fringecal::decode

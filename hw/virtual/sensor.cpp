#include "hw/virtual/sensor.h"

#include "core/parallel.h"
#include "hw/virtual/random.h"

#include <algorithm>
#include <cmath>

namespace fringecal::virt {
namespace {

constexpr float kFullScale = 255.0F;  // grey levels in which light and noise are given, whatever the bits
constexpr int kBandRows = 52;

}  // namespace

Sensor::Sensor(const Preset& preset, std::uint64_t instrument_seed)
    : width_(preset.camera.width_px),
      height_(preset.camera.height_px),
      bits_(preset.camera.bits),
      noise_variance_(preset.camera.noise_rms * preset.camera.noise_rms),
      shot_fraction_(preset.camera.noise_shot_fraction),
      gain_(width_, height_, 1.0F) {
  const std::uint64_t key = key_of(instrument_seed, "fixed-pattern gain");
  const auto rms = static_cast<float>(preset.camera.fixed_pattern_gain);
  parallel_for(height_, [&](int y) {
    fill_normal(key, y, gain_.row(y));
    for (float& g : gain_.row(y)) g = 1.0F + rms * g;
  });
}

void Sensor::radiance_row(const LightField& field, const Grating& grating, const Exposure& e, int y,
                          std::span<float> out) const {
  grating.project(e.pattern, e.offset_mm, field.row(y), {e.ambient, e.light_factor, e.veil}, out);
  for (const auto& extra : field.extras[static_cast<std::size_t>(y)]) {
    float value = 0;
    const LightRow one{{&extra.u_mm, 1},           {&extra.cosine, 1},        {&extra.sine, 1},
                       {&extra.first_harmonic, 1}, {&extra.inverse_sigma, 1}, {&extra.light, 1}};
    grating.project(e.pattern, e.offset_mm, one, {0.0, e.light_factor, e.veil}, {&value, 1});
    out[static_cast<std::size_t>(extra.column)] += value;
  }
}

template <class Pixel>
void Sensor::take_band(const LightField& field, const Grating& grating, const Exposure& e, Band band,
                       Image<Pixel>& frame) const {
  const auto width = static_cast<std::size_t>(width_);
  std::vector<float> radiance(width + 2 * kRayMargin), noise(width);
  const auto read = static_cast<float>(noise_variance_ * (1.0 - shot_fraction_));
  const auto shot = static_cast<float>(noise_variance_ * shot_fraction_ / (0.5 * kFullScale));
  const auto top = static_cast<float>((1 << bits_) - 1);
  const float digits = top / kFullScale;
  for (int k = 0; k < band.rows; ++k) {
    const int y = band.first_row + k;
    radiance_row(field, grating, e, y + kRayMargin, radiance);
    fill_normal(e.noise_key, y, noise);
    const float *gain = gain_.row(y).data(), *n = noise.data(), *in = radiance.data() + kRayMargin;
    Pixel* out = frame.row(y).data();
    for (std::size_t x = 0; x < width; ++x) {
      const float s = gain[x] * in[x];                                                                  // eq. 1
      const float i = s + n[x] * std::sqrt(read + shot * s);                                            // eq. 2
      out[x] = static_cast<Pixel>(static_cast<int>(std::min(std::max(i * digits + 0.5F, 0.0F), top)));  // eq. 3
    }
  }
}

std::vector<GrayImage> Sensor::take(const LightField& field, const Grating& grating,
                                    const std::vector<Exposure>& exposures) const {
  std::vector<GrayImage> frames;
  for (std::size_t k = 0; k < exposures.size(); ++k) {
    if (bits_ > 8) {
      frames.emplace_back(Image16(width_, height_));
    } else {
      frames.emplace_back(Image8(width_, height_));
    }
  }
  const int bands = (height_ + kBandRows - 1) / kBandRows;
  parallel_for(bands * static_cast<int>(exposures.size()), [&](int task) {
    const auto k = static_cast<std::size_t>(task / bands);
    const int first = task % bands * kBandRows;
    const Band band{first, std::min(kBandRows, height_ - first)};
    std::visit([&](auto& frame) { take_band(field, grating, exposures[k], band, frame); }, frames[k]);
  });
  return frames;
}

}  // namespace fringecal::virt

// From light to grey levels: the sensor's gain, noise and digits (its blur: light_field.h).
//
// With R(x, y) the radiance in grey levels of 255, G the Gaussian of blur_px rms (sampled, normalised), g the pixel's
// own gain, n a unit normal number:
//   S = g (G * R)                                                                                              (1)
//   I = S + n sigma(S),   sigma^2 = noise_rms^2 ((1 - q) + q S / mid),  q the shot fraction, mid = 127.5        (2)
//   frame = round(I (2^bits - 1) / 255), held to [0, 2^bits - 1]                                               (3)
// The same scene saturates at the same light with 8 and with 12 bits. Shot noise is taken as normal: at the full well
// of such a sensor a grey level is some hundred electrons.
#pragma once

#include "core/image.h"
#include "hw/virtual/grating.h"
#include "hw/virtual/light_field.h"

#include <cstdint>

namespace fringecal::virt {

/// One frame to be: a pattern, where it stands, how bright the light is.
struct Exposure {
  Pattern pattern;
  double offset_mm = 0;     // displacement of the pattern on the grating
  double ambient = 0;       // grey levels
  double light_factor = 1;  // exposure times flicker
  double veil = 0;          // share of the light that arrives without the pattern
  std::uint64_t noise_key = 0;
};

class Sensor {
 public:
  Sensor(const Preset& preset, std::uint64_t instrument_seed);

  std::vector<GrayImage> take(const LightField& field, const Grating& grating,
                              const std::vector<Exposure>& exposures) const;

 private:
  struct Band {
    int first_row, rows;
  };
  void radiance_row(const LightField& field, const Grating& grating, const Exposure& e, int y,
                    std::span<float> out) const;
  template <class Pixel>
  void take_band(const LightField& field, const Grating& grating, const Exposure& e, Band band,
                 Image<Pixel>& frame) const;

  int width_, height_, bits_;
  double noise_variance_, shot_fraction_;
  Image<float> gain_;
};

}  // namespace fringecal::virt

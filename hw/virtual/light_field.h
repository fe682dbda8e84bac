// What each pixel sees, pattern apart: the place on the grating that lights it, and how brightly.
//
// Per pixel: ray of the camera's lens, first surface, and from there to the projector's pupil at distance D, under the
// angle i to the normal and psi to the projector's axis:
//   light = P albedo cos(i) cos(psi) (L / D)^2     0 in cast or attached shadow and outside the grating            (1)
// which on a board square to the axis is the cos^4 fall-off of a projection lens. P makes B the preset's modulation on
// the white board at the centre of R. The edge of the coded field is blurred as the patterns are (grating.h).
//
// The camera's point spread (Gaussian blur over the pixel's square, variance v = blur^2 + 1/12 px^2 along each axis) is
// applied here, before the pixels sample: a blur of finished pixels would let the edges alias by 0.03 px. With <> the
// mean over the point spread, weighted with the light, a pixel sees a pattern T by
//   <T(u)> = T at <u>, blurred by the variance of u            (to second order in the spread)                   (2)
// so the patterns need no further blur: the variance adds to that of the projector's lens. Away from edges
//   <1> = s + v lap(s) / 2,   <u> = u + v (grad(u) . grad(s) / s + lap(u) / 2),   var(u) = v |grad(u)|^2         (3)
// from neighbouring pixels; where the spread reaches an edge of print, a silhouette or a shadow's edge, from 128
// (print, on the board's tangent plane) or 64 (traced) samples of the spread, each surface with its own light and
// place.
#pragma once

#include "calib/model/scanner.h"
#include "core/image.h"
#include "hw/virtual/grating.h"
#include "hw/virtual/shapes.h"

#include <vector>

namespace fringecal::virt {

/// Of the size of the RayField, margin included.
struct LightField {
  Image<float> u_mm, cosine, sine, first_harmonic, inverse_sigma, light;
  /// Second and further surfaces within one pixel, row by row.
  struct Extra {
    int column;
    float u_mm, cosine, sine, first_harmonic, inverse_sigma, light;
  };
  std::vector<std::vector<Extra>> extras;

  LightField(int width, int height);
  LightRow row(int y) const;
};

/// The rays of all pixels and of kRayMargin pixels around the sensor, as (x, y, 1) in cam.
constexpr int kRayMargin = 4;
struct RayField {
  Image<double> x, y;

  explicit RayField(const model::Camera& camera);
};

/// The geometry of one stack. scanner: the true one; preset_from_cam: its camera in the frame `world` of the preset.
struct Viewpoint {
  const model::Scanner& scanner;
  Rigid3 preset_from_cam;
};

LightField light_field(const std::vector<Solid>& solids, const RayField& rays, const Viewpoint& view,
                       const Preset& preset);

}  // namespace fringecal::virt

// What each pixel sees, pattern apart: the place on the grating that lights it, and how brightly.
//
// Per pixel: ray of the camera's lens, first surface, and from there to the projector's pupil at distance D, under the
// angle i to the normal and psi to the projector's axis:
//   light = P albedo cos(i) cos(psi) (L / D)^2     0 in cast or attached shadow and outside the grating            (1)
// which on a board square to the axis is the cos^4 fall-off of a projection lens. P makes B the preset's modulation on
// the white board at the centre of R. The edge of the coded field is blurred as the patterns are (grating.h).
// Pixels that an edge of print crosses get the mean light over their square and the place of that light's centre;
// those at silhouettes and shadow edges are sampled 64-fold, each surface with its own light and place.
// The field has a margin around the sensor, so that the camera's blur has real neighbours everywhere.
#pragma once

#include "calib/model/scanner.h"
#include "core/image.h"
#include "hw/virtual/grating.h"
#include "hw/virtual/shapes.h"

#include <vector>

namespace fringecal::virt {

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

/// The rays of all pixels and of `margin` pixels around the sensor, as (x, y, 1) in cam.
struct RayField {
  int margin;
  Image<double> x, y;

  RayField(const model::Camera& camera, int margin_px);
};

/// The geometry of one stack. scanner: the true one; preset_from_cam: its camera in the frame `world` of the preset.
struct Viewpoint {
  const model::Scanner& scanner;
  Rigid3 preset_from_cam;
};

LightField light_field(const std::vector<Solid>& solids, const RayField& rays, const Viewpoint& view,
                       const Preset& preset);

}  // namespace fringecal::virt

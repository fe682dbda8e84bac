// Pictures of a report, as markup with the pixels inside (PNG in a data URI).
//
// Large images are averaged over square blocks of k x k pixels; a block with fewer than half its pixels valid is shown
// as "no value". A heat map's range is robust: without a given range it spans the 0.5 % to 99.5 % quantiles
// (sequential), or is symmetric about zero at the 99 % quantile of the absolute value (diverging); values beyond it
// take the end colour.
#pragma once

#include "core/image.h"
#include "reports/colour.h"
#include "reports/html.h"

#include <optional>
#include <string>

namespace fringecal::reports {

/// The number at the middle of pixel k of an axis: first + k step.
struct AxisScale {
  double first = 0, step = 1;
};

struct HeatMapOptions {
  ColourMap map = ColourMap::diverging;
  std::string label;   // of the colour bar, with the unit of the printed numbers: "deviation, µm"
  double scale = 1.0;  // printed number = value * scale
  int width_px = 480;  // of the drawing on the page, colour bar included
  int max_height_px = 420;
  AxisScale x = {}, y = {};   // by default pixels
  bool zoom_to_valid = true;  // cut off the margins without values
};

/// A picture with pixel coordinates on its sides and a colour bar. A map without any finite value is an empty frame
/// with the words "no values".
Markup heat_map(const Image<float>& values, const HeatMapOptions& options);

/// A grey picture of at most this width; saturation_level is shown white.
Markup thumbnail(const GrayImage& image, int saturation_level, int max_width_px);

/// The printed range of a heat map, before scaling.
struct Range {
  double low = 0, high = 0;
};
std::optional<Range> robust_range(const Image<float>& values, ColourMap map);

/// Mean over k x k blocks, NaN-aware as above; k = 1 copies.
Image<float> block_mean(const Image<float>& values, int k);

}  // namespace fringecal::reports

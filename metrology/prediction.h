// What a plan will know, before any capture: the same evaluation (acceptance.h), on clouds that the Scanner's own model
// makes of ideal artefacts at the plan's places.
//
// For each pixel whose ray meets an artefact at p, normal n, in front of the camera and inside of the coded field:
//   u(l) = |du/dl|^-1 (p_code / 2 pi) u_phi / cos(i)                                                              (1)
// i the incidence of the light, as the modulation of a matt surface falls with its cosine and u(phi) is inverse to it
// [reconstruct.h, eq. 1]; u_phi is that of a white board square to the light. The point is displaced along its ray by
// one draw of u(l). Left out: shadows that artefacts throw on each other, the fall-off of the light over the field, periodic
// phase errors: away from the middle of the field the noise is more than predicted.
// The values of the predicted quantities mean nothing but one draw of the noise; their budgets, U and
// u_of_later_measurements are the prediction.
// Frame `world`, mm. A plan whose series have no places: no result.
#pragma once

#include "metrology/acceptance.h"

#include <string>
#include <vector>

namespace fringecal::metrology {

struct PredictOptions {
  double u_phase_rad = 0.009;  // [eq. 1] 80 grey levels of modulation at 1 level of noise
  Environment environment = {};
};

struct PredictedSeries {
  std::string scene;
  std::vector<Quantity> quantities;
  std::vector<std::string>
      problems;  // captures that cannot be evaluated, and why: an artefact outside of the field, ...
};

/// Of the artefacts of `series` at its `capture`'s place.
Result<PointCloud> predicted_cloud(const Series& series, int capture, const std::vector<Gauge>& gauges,
                                   const model::Scanner& scanner, const PredictOptions& options);

/// The views of a series that has them (with the carrier's reference spheres, turned), else the one cloud.
Result<std::vector<PointCloud>> predicted_views(const Series& series, int capture, const std::vector<Gauge>& gauges,
                                                const model::Scanner& scanner, const PredictOptions& options);

/// The artefacts of a capture as lines to be drawn: spheres as circles that face the projector, the centres of a
/// bar or a plate joined, a cylinder, a flat and a step's planes as rectangles. With the first
/// capture of a series with views also its reference spheres. Empty without places.
std::vector<std::vector<Eigen::Vector3d>> outlines_of(const Series& series, int capture,
                                                      const std::vector<Gauge>& gauges);

/// What the camera sees and where the code reaches, at the lowest, middle and highest place of the plan.
struct Fields3d {
  std::vector<std::vector<Eigen::Vector3d>> camera, code;  // corners of each height's outline
};
Fields3d fields_of(const Plan& plan, const model::Scanner& scanner);

Result<std::vector<PredictedSeries>> predict(const Plan& plan, const std::vector<Gauge>& gauges,
                                             const model::Scanner& scanner, const PredictOptions& options = {});

}  // namespace fringecal::metrology

// A capture of several views: spheres on a carrier, turned for each view, brought into one frame by reference spheres and
// evaluated as if one view had seen them from all sides.
//   1. In each view the reference spheres and those of the artefact are found by their sizes, which differ by more than 10 %, and
//      cleaned (artefact.h, rules 1 to 5).
//   2. The motions of the views follow from the references alone (registration.h, eq. 1), never from the artefact: its spheres
//      would hide the error that they are there to show.
//   3. Artefact spheres that lie within 2 mm of each other in the frame `part` of the first view are one and the same; their
//      points are united and fitted once (acceptance.h, eqs. 1 to 3, with the plan's rejection).
// So PF holds the scanner's form error *and* what the views disagree by, PS and SD what the registration bends.
// What the calibration's uncertainty makes of a quantity (calibration_uncertainty.h): all views move with the same change of
// the parameters, are joined anew by their changed references, and united anew. Of the mean phase errors of its captures (eq. 2
// there): each view is a capture and moves by itself, the others stay; its references move with it and carry it back in part.
// A step, a flat or a cylinder, a sphere that fewer than two views see, too few references: no result, with the view.
#pragma once

#include "metrology/acceptance.h"

#include <span>

namespace fringecal::metrology {

/// clouds: one per view of the series, in its order.
Result<CaptureResult> evaluate_views(const Plan& plan, const Series& series, int capture,
                                     const std::vector<Gauge>& gauges, std::span<const PointCloud> clouds,
                                     const model::Scanner& scanner);

}  // namespace fringecal::metrology

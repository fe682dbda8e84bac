// A plausible CommissioningReport out of formulas and a fixed random sequence: no measurement, for the page's tests
// only.
#pragma once

#include "reports/commissioning_report.h"

namespace fringecal::reports {

struct SyntheticOptions {
  int width_px = 348, height_px = 260;  // the default instrument's 1392 x 1040, a quarter of each side
  int poses = 6;                        // board poses of 7 x 10 corners
};

CommissioningReport synthetic_report(const SyntheticOptions& options = {});

}  // namespace fringecal::reports

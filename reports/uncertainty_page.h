// The page of `fringecal calibrate --report` and `fringecal uncertainty`: what a calibration is uncertain by in the working
// volume, as sections and a table, and what it leaves open.
#pragma once

#include "metrology/compare_scanners.h"
#include "metrology/residual_whiteness.h"
#include "metrology/uncertainty_map.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

struct UncertaintyPage {
  std::string name;
  metrology::UncertaintyMap map;
  std::vector<metrology::Whiteness> whiteness;         // empty: not judged
  std::optional<metrology::ScannerComparison> halves;  // absent: not solved
  std::vector<model::Prior> priors;
  std::string without_halves = {};  // why the halves could not be solved
};

std::string uncertainty_page(const UncertaintyPage& page);

}  // namespace fringecal::reports

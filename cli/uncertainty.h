// `fringecal uncertainty`, and the same page for `calibrate --report`.
#pragma once

#include "calib/model/scanner.h"

#include <string>

namespace fringecal::cli {

/// Halves of the poses included where there are six of them.
void write_uncertainty_page(const model::Scanner& scanner, const std::string& page);

}  // namespace fringecal::cli

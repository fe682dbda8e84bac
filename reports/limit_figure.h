// The figure of a certificate: each value with its expanded uncertainty against its limits, a row per line of the table.
// Vector graphics that say everything by position and form, not by colour: dot the value, whisker +-U, grey beyond the
// limits; a value off the scale is an arrowhead at the edge.
//
// Scale: y / limit in percent; the upper limit for values above zero, the lower one for values below (with one limit only,
// that one). Lines without limits are left out; a limit of zero has no scale and is left out too.
#pragma once

#include "reports/certificate.h"
#include "reports/html.h"

#include <vector>

namespace fringecal::reports {

/// At most `rows_per_figure` rows each (40 fill three quarters of A4); empty where no line has limits.
std::vector<Markup> limit_figures(const std::vector<ResultLine>& lines, std::size_t rows_per_figure = 40);

}  // namespace fringecal::reports

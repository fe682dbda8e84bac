// Reports on the instrument itself, short of a certificate and in its look: what a calibration found, and how an alignment
// went. HTML for the screen and for the PDF (reports/archival_pdf.h); nothing is loaded from outside.
// Numbers are rounded as on a certificate: u with two significant digits, a value to the same place [GUM, 7.2.6].
#pragma once

#include "calib/model/scanner.h"
#include "core/value.h"

#include <string>

namespace fringecal::reports {

struct InstrumentReport {
  std::string title, html;
  std::size_t results = 0;  // parameters, or iterations
};

/// Of scanner.json: parameters with u, residuals, board, priors, origin. sha256: of the file.
InstrumentReport calibration_report(const model::Scanner& scanner, const std::string& sha256,
                                    const std::string& language);

/// Of an alignment record ("fringecal.alignment_record"): theta and delta of each iteration, as a table and over the
/// iterations. name: of the file, for messages. Throws InputError.
InstrumentReport alignment_report(const Value& record, const std::string& name, const std::string& sha256,
                                  const std::string& language);

}  // namespace fringecal::reports

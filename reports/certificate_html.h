// The certificate for people: one HTML page, for the screen and for the PDF (reports/certificate_pdf.h).
//
// Nothing is loaded from outside: pictures and the style sheet are inside. Every number that stands here stands with the
// same unit in the XML (reports/certificate_dcc.h); reports/certificate_check.h compares them.
#pragma once

#include "reports/certificate.h"
#include "reports/html.h"

#include <string>

namespace fringecal::reports {

std::string certificate_html(const Certificate& certificate);

// Sections, shared between the files that write them.
Markup certificate_results(const Certificate& certificate, const Catalogue& words);
Markup certificate_annex(const Certificate& certificate, const Catalogue& words);
extern const char* const kCertificateStyle;

/// "-0.012" -> "−0.012": a number of a ResultLine for print, and with its unit ("mm" -> no-break space, mm).
std::string shown(const std::string& number);
std::string shown(const std::string& number, const std::string& unit);
/// The overall statement's key in the catalogue: "conformity.overall_pass", "conformity.none".
std::string overall_key(const Certificate& certificate);
/// "temperature": "(20.12 ± 0.30) °C (k = 2)".
std::string temperature_text(const metrology::Environment& environment, const Catalogue& words);

}  // namespace fringecal::reports

// The certificate for machines: a Digital Calibration Certificate (PTB), schema 3.3.0, quantities and units after D-SI
// 2.2.1, names after PTB's good practice (refType "basic_..."); what these have no name for is "fringecal_...", defined in
// the certificate's refTypeDefinitions:
//   fringecal_result                   one line of the table of results
//   fringecal_toleranceLimitLower/Upper  the limit that conformity was judged against, before any guard band
//   fringecal_guardBand                the decision rule's guard band
//   fringecal_conformanceProbability   metrology/decision.h, eq. 5
//   fringecal_budget                   contributions to the standard uncertainty of a result
//   fringecal_record                   the verification record itself, as JSON: results can be recomputed from it
//   fringecal_data                     SHA-256 of data.zip (reports/certificate_data.h)
//   fringecal_history                  the entry of the laboratory's history that the record is
// Texts are in one language, that of the certificate. Numbers are the texts of reports/certificate.h, as in the PDF.
// Errors: a unit without a D-SI name: InputError.
#pragma once

#include "reports/certificate.h"

#include <string>

namespace fringecal::reports {

/// Not signed yet.
std::string certificate_dcc(const Certificate& certificate);

/// "mm" -> "\milli\metre". Throws InputError.
std::string dsi_unit(const std::string& unit);
/// "\milli\metre" -> "mm"; itself where we have no shorter name.
std::string unit_of_dsi(const std::string& dsi);

}  // namespace fringecal::reports

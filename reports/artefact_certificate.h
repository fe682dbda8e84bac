// An artefact's own DCC, read for artefacts.toml ("fringecal.artefacts", version 1): certified lengths in mm, their
// uncertainty and coverage factor, who certified them and when.
//
// A certified length is any si:real or entry of an si:realListXMLList below dcc:results whose unit is metre with a decimal
// prefix; in an si:hybrid the first such. Prefixes shift the decimal point of the text, so no digit is lost. An uncertainty
// is taken in every form of D-SI 1 and 2: expanded (with its k), standard or of a coverage interval (k = 1).
// Which length is the diameter, the distance or the form is told by refTypes, its own and those of the result and lists
// around it ("..._diameter", "..._sphericity"; namespaces differ); only where these do not tell, by its name, in one of
// fourteen languages. Set points, errors and limits of a good-practice table (basic_nominalValue, ...) are none of them.
// What is not told is a comment in the result, for the user to place.
// Errors: InputError with the file: no length certified, or none that the kind of artefact needs.
#pragma once

#include "reports/xml_document.h"

#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

struct CertifiedLength {
  std::string name, ref_type;  // name in all languages of the document, joined
  std::string value_mm;        // decimal texts
  std::optional<std::string> U_mm, k;
};

struct ArtefactCertificate {
  std::string item, serial_number, certificate, laboratory, date, recalibration_date;
  std::vector<CertifiedLength> lengths;
};

ArtefactCertificate artefact_certificate(const XmlDocument& document, const std::string& file);

struct ArtefactEntry {
  std::string name;         // empty: the item's
  std::string kind;         // sphere | ball_bar | flat | cylinder
  std::string valid_until;  // empty: the certificate's agreed date of recalibration
  double expansion_per_K = 0, u_expansion_per_K = 0;
};

/// One [[artefact]] as TOML text.
std::string artefact_toml(const ArtefactCertificate& certificate, const ArtefactEntry& entry, const std::string& file);

/// The decimal point moved: shifted("0.0300043", 3) -> "30.0043".
std::string shifted(const std::string& decimal, int places);

}  // namespace fringecal::reports

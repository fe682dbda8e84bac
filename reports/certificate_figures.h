// The figures of a certificate beside that of the limits (reports/limit_figure.h): everything by position and form, so
// that a print in black and white says the same.
//   volume      where the features stood, seen along Z and along Y, to one scale; rectangle: the box of their points
//   maps        deviations of one feature of each artefact from its fit over X and Y, the one with the largest range;
//               mean over squares; light is above, dark is below (a map cannot be vector graphics: an embedded PNG)
//   history     results of the item over time with U and limits; of several positions the one of largest magnitude
//   alignment   theta and delta of each alignment in the history, as found (ring) and as left (dot)
// A figure is left out where the records or the history have nothing for it.
#pragma once

#include "reports/certificate.h"
#include "reports/html.h"

#include <string>
#include <vector>

namespace fringecal::reports {

struct CertificateFigure {
  std::string name;     // "volume", "maps", "history", "alignment": letters only
  Markup picture;       // SVG
  std::string caption;  // what it shows and how it is read
  std::string numbers;  // every number that it shows, for the machine-readable twin
};

/// In the order above.
std::vector<CertificateFigure> certificate_figures(const Certificate& certificate, const Catalogue& words);

/// Each figure by itself; nothing where there is nothing to draw.
std::vector<CertificateFigure> volume_figures(const Certificate& certificate, const Catalogue& words);
std::vector<CertificateFigure> map_figures(const Certificate& certificate, const Catalogue& words);
std::vector<CertificateFigure> history_figures(const Certificate& certificate, const Catalogue& words);

}  // namespace fringecal::reports

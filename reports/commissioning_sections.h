// The parts of the commissioning page, one function each. Each returns empty markup where its input is absent.
#pragma once

#include "reports/commissioning_report.h"
#include "reports/html.h"

namespace fringecal::reports {

Markup summary(const CommissioningReport& report);
Markup comparison_table(const std::vector<ArtefactSection>& artefacts);
Markup alignment_section(const CommissioningReport& report);
Markup fringe_section(const CommissioningReport& report);
Markup phase_correction_section(const CommissioningReport& report);
Markup phase_section(const CommissioningReport& report);
Markup calibration_section(const CommissioningReport& report);
Markup artefact_section(const CommissioningReport& report);
Markup ablation_section(const CommissioningReport& report);
Markup provenance_section(const CommissioningReport& report);

/// A sign whose shape tells the verdict without colour, and its word beside it.
Markup mark(Verdict verdict);
Markup mark_sign(Verdict verdict);
/// The class of a verdict in the style sheet.
std::string class_for(Verdict verdict);

}  // namespace fringecal::reports

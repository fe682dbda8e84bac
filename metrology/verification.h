// Verification: the result of one plan on one scanner on one day, as a file ("fringecal.verification", version 1). The
// reports, the certificate and the history read nothing else.
//
// A Quantity is one line of a table of results. Its uncertainty is that of the *test value*: how well this test knew the
// scanner's error that it showed [ISO14253-5]. What a user of the scanner must expect of a later measurement is another
// figure, `u_of_later_measurements`, and is never mixed with it.
// Lengths in mm, temperatures in degC, dates RFC 3339.
#pragma once

#include "core/fields.h"
#include "core/provenance.h"
#include "core/value.h"
#include "metrology/budget.h"
#include "metrology/decision.h"
#include "metrology/diagnosis.h"
#include "metrology/monte_carlo.h"
#include "metrology/residual_cloud.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

struct Quantity {
  std::string symbol;    // as the plan's source has it: "PF", "PS", "SD", "F", "D"
  std::string name;      // "probing error, form"
  std::string artefact;  // name in artefacts.toml
  std::string position;  // "3"; "worst of 7", "mean of 10" for a summary
  std::string unit = "mm";
  double value = 0;
  std::vector<Contribution> budget;
  Combined uncertainty;
  std::optional<Validation> validation;  // of the uncertainty, by Monte Carlo
  std::optional<Limits> limits;
  std::optional<Judgement> judgement;  // absent without limits
  std::optional<double> u_of_later_measurements;
  int n_points = 0, n_rejected = 0;  // of the clouds behind it, together
};

/// What of an artefact's certificate the results rest on.
struct ArtefactUsed {
  std::string name, kind;
  std::string certificate, laboratory, date, valid_until;
  bool expired_accepted = false;  // the operator overrode the refusal
  struct Certified {
    std::string name;  // "diameter", "distance", "flatness"
    double value_mm = 0, U_mm = 0, k = 2;
  };
  std::vector<Certified> values;
};

/// A gauge-type summary of one quantity over a series.
///   repeatability    s of the repeats at one place, pooled over the places; without repeats the root mean square of the
///                    captures' own noise                                                                           (1)
///   reproducibility  sqrt(max(0, s^2 - repeatability^2 / m)), s over the places, each the mean of m captures            (2)
/// The artefact's certificate is common to all and in neither.
struct GaugeSummary {
  std::string symbol, artefact;
  int captures = 0;
  bool repeats = false;  // at one place: no reproducibility
  double mean_mm = 0, repeatability_mm = 0, reproducibility_mm = 0;
};

struct Environment {
  double temperature_degC = 20, u_temperature_degC = 0;
  std::optional<double> humidity_percent;
};

struct Verification {
  std::string plan;                         // "paper"
  std::string plan_source;                  // what it follows
  std::vector<std::string> plan_unchecked;  // what of it could not be checked against the standard's text
  std::string scanner;                      // identification of the scanner
  std::string scanner_file_sha256;
  std::string begun, ended;
  Environment environment;
  DecisionRule decision_rule = DecisionRule::iso_14253_1;
  std::vector<ArtefactUsed> artefacts;
  std::vector<Quantity> quantities;
  std::vector<GaugeSummary> summaries;
  std::vector<std::string> deviations;    // from the method, in words
  std::vector<MeasuredFeature> features;  // where they stood; empty in records that do not hold it
  std::optional<Diagnosis> diagnosis;     // of a plan that asks for one
  Provenance provenance;
};

/// The worst judgement of all; absent where nothing has a limit.
std::optional<Verdict> verdict_of(const Verification& verification);

Value to_value(const Verification& verification);
Verification read_verification(const std::filesystem::path& file);
Verification verification_from(const Value& value, const std::string& name_in_messages);

}  // namespace fringecal::metrology

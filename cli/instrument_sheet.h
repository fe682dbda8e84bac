// What a laboratory knows of a scanner on paper before it commissions it: data sheets of camera and grating, the board,
// the artefacts and their certificates, what it asks of the instrument. instrument.toml, beside scanner.toml, which says
// how the scanner is wired. Strict: an unknown key is an error.
//
//   name = "scanner 3, hall 2"          # as reports and history call it
//   pixel_mm = 0.00645                  # side of a pixel, the sensor's data sheet
//   working_distance_mm = 1000.0        # nominal, camera to the middle of the volume
//   pattern_pitch_mm = 12.0             # neighbouring patterns along the slide, the grating's data sheet
//   mrad_per_division = 0.5             # of the adjuster's scale; optional: then turns are told in divisions too
//   flatness_mm = 0.005                 # of the flat board over the field, its certificate; optional: then it calibrates too
//   board = "board.toml"                # as calibrate --board; this and the next beside the sheet, or absolute
//   artefacts = "artefacts.toml"        # their certificates (metrology/artefact_file.h)
//   error_limit_mm = 0.05               # acceptance: |mean diameter - certificate| ...
//   form_limit_mm = 0.05                # ... and standard deviation of the form, of every repeat
//   [[scene]]                           # what is measured together, in this order
//   name = "spheres"
//   artefacts = ["sphere 50", "sphere 38"]   # names of artefacts.toml: spheres, cylinders, flats
#pragma once

#include "calib/model/board.h"
#include "cli/commission_session.h"
#include "core/pattern_plan.h"
#include "core/uncertain.h"
#include "hw/virtual/virtual_scanner.h"
#include "metrology/artefact.h"
#include "metrology/verification.h"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {

/// What is measured in one place, as often as the commissioning repeats.
struct VerificationScene {
  std::string name;  // "spheres"; of the virtual scanner: of its standard scene
  std::vector<metrology::NominalArtefact> artefacts;
};

struct InstrumentSheet {
  std::string name;            // in the Scanner file and the report
  std::string identification;  // in the history
  std::string note;            // what it is, a sentence of the report; may be empty
  double pixel_mm = 0, working_distance_mm = 0, pattern_pitch_mm = 0;
  std::optional<double> mrad_per_division;
  std::optional<double> flatness_mm;  // of the flat board; absent: not known, and no witness in the calibration
  PatternPlan plan;
  model::Board board;
  std::vector<VerificationScene> scenes;
  std::map<std::string, Uncertain> diameter_mm;  // certified, by the artefact's name, at the artefacts' temperature
  double error_limit_mm = 0, form_limit_mm = 0;
  std::vector<std::string> expired;  // artefacts whose certificate has run out
};

/// Of the virtual scanner: what its makers say of it, and the paper's section 4.
InstrumentSheet sheet_of(const virt::VirtualScanner& instrument, const CommissionChoices& choices);
/// Throws InputError: file, key, and what to write.
InstrumentSheet read_sheet(const std::filesystem::path& file, const PatternPlan& plan,
                           const metrology::Environment& environment);
/// One hash of the sheet and of the files it names: a commissioning is continued with the same ones only.
std::string fingerprint_of_sheet(const std::filesystem::path& file);

}  // namespace fringecal::cli

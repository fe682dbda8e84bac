// artefacts.toml: the calibrated artefacts that verifications rest on ("fringecal.artefacts", version 1).
//
//   [[artefact]]
//   name = "ball bar 150"
//   kind = "ball_bar"                        # sphere | ball_bar | sphere_plate | flat | cylinder | step
//   diameter_mm = [30.0012, 30.0007]         # sphere, cylinder: one; ball bar: of both spheres; plate: of each
//   U_diameter_mm = 0.0006                   # expanded, with the certificate's k
//   distance_mm = 150.013                    # ball bar: of the centres
//   U_distance_mm = 0.0012                   # ball bar; plate: of the distance of any two centres
//   centres_mm = [[0, 0, 0], [100.002, 0, 0.01], ...]  # plate: of its spheres, 3 to 12, in the certificate's frame
//   height_mm = 20.0013                      # step: of the upper plane above the lower, parallel one
//   U_height_mm = 0.0008
//   form_mm = 0.0004                         # certified form error (sphericity, flatness); 0 where the certificate has none
//   U_form_mm = 0.0002
//   fixture_mm = 0.0003                      # standard uncertainty of its lengths from how it is held (a bar sags); optional
//   k = 2
//   expansion_per_K = 11.5e-6                # linear coefficient ...
//   u_expansion_per_K = 1.0e-6               # ... and its standard uncertainty
//   reference_temperature_degC = 20
//   certificate = "K-2026-0815"
//   laboratory = "D-K-00000"
//   date = "2026-03-01"
//   valid_until = "2028-03-01"               # as agreed with the laboratory or by the owner's rules
//
// A certified length at temperature t:  l(t) = l (1 + alpha (t - t_ref))                                          (1)
//   u^2(l(t)) = (U / k)^2 + (l (t - t_ref) u(alpha))^2 + (l alpha u(t))^2 + (l u(alpha) u(t))^2 + u_fixture^2        (2)
// The last is of second order and the only part of u(alpha) left at the reference temperature. [GUM, 5.1.2 note; H.1.7]
#pragma once

#include "core/value.h"
#include "metrology/budget.h"
#include "metrology/verification.h"

#include <Eigen/Core>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

enum class GaugeKind { sphere, ball_bar, sphere_plate, flat, cylinder, step };
const char* name_of(GaugeKind kind);

struct Gauge {
  std::string name;
  GaugeKind kind = GaugeKind::sphere;
  std::vector<double> diameter_mm;  // sphere, cylinder: one; ball bar: two; plate: one per centre; flat, step: none
  double U_diameter_mm = 0;
  std::optional<double> distance_mm;        // ball bar: of the centres; step: its height
  double U_distance_mm = 0;                 // of the same; of a plate, of any two centres
  std::vector<Eigen::Vector3d> centres_mm;  // sphere plate
  double form_mm = 0, U_form_mm = 0;
  double fixture_mm = 0;  // standard uncertainty that its holding adds to its lengths
  double k = 2;
  double expansion_per_K = 0, u_expansion_per_K = 0, reference_temperature_degC = 20;
  std::string certificate, laboratory, date, valid_until;  // dates: YYYY-MM-DD
};

/// Throws InputError: file, artefact, key and what is wrong.
std::vector<Gauge> read_gauges(const std::filesystem::path& file);
Value to_value(const std::vector<Gauge>& gauges);
/// The same as TOML text, to start a file of one's own from.
std::string to_toml(const std::vector<Gauge>& gauges);

/// A certified length between two parts of an artefact: a ball bar's distance, a step's height, each distance of a plate.
struct CertifiedDistance {
  int from = 0, to = 1;
  double value_mm = 0;
  std::string name;  // "distance", "height", "distance 1-3"
};
std::vector<CertifiedDistance> distances_of(const Gauge& gauge);
/// "A" and "B" of a bar, "1", "2", ... of a plate, "lower" and "upper" of a step; empty where there is one part.
std::string part_name(const Gauge& gauge, int part);

/// The gauge of that name. Throws InputError with the names that there are.
const Gauge& gauge_named(const std::vector<Gauge>& gauges, const std::string& name);

/// Whether the certificate has run out on that day (dates compare as text).
bool is_expired(const Gauge& gauge, const std::string& day);

/// Eq. 1, and eq. 2 as the contributions of a budget with the sensitivity -1 (an error is measured minus certified).
double length_at(const Gauge& gauge, double length_mm, const Environment& environment);
std::vector<Contribution> contributions_of(const Gauge& gauge, double length_mm, double U_mm,
                                           const Environment& environment);

/// What a verification keeps of it.
ArtefactUsed used(const Gauge& gauge, bool expired_accepted);

}  // namespace fringecal::metrology

// What is wrong with a scanner: the likeliest cause behind the pattern of one capture's deviations.
//
// From one capture of artefacts of known size come the symptoms r: what was observed minus what a healthy scanner shows
// (symptoms.h), with the covariance C that a healthy scanner scatters with. Each hypothesis H_j is a fault with
// amplitudes a (millimetres of base line, radians of the camera, kelvin, ...) whose effect on the symptoms to first
// order, from the derivatives of the scanner's own model, is
//   r = D_j a + e,   e ~ N(0, C),   a ~ N(0, S_j)                                                                 (1)
// so that, with the amplitudes marginalised,
//   p(r | H_j) = N(r; 0, M_j),   M_j = C + D_j S_j D_j^T + E_j                                                    (2)
//   P(H_j | r) = p(r | H_j) P(H_j) / sum_k p(r | H_k) P(H_k)                                                      (3)
//   a_j = S_j D_j^T M_j^{-1} r,   cov(a_j) = S_j - S_j D_j^T M_j^{-1} D_j S_j                                     (4)
// E_j = diag((kNonlinear D_j a_j)^2), from (4) without it: what the first order leaves of a large fault, 2 %, an
// allowance for its curvature. A fault of more amplitudes is not preferred for its freedom: det M_j in (2) pays for
// each (Occam factor). [MacKay2003, ch. 28]
//
// A cause is named when it has kNamed of the probability that is not with "healthy"; otherwise all that together hold
// kNamed are given and said to be not separable. Where the best hypothesis itself is improbable,
//   r^T M_j^{-1} r > chi2_{n, 1 - 1e-4}                                                                           (5)
// none of the known causes explains the pattern, and that is said.
#pragma once

#include "core/fields.h"
#include "core/value.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace fringecal::metrology {

struct Amplitude {
  std::string name, unit;  // "base line", "mm"
  double prior_sd = 0;     // sqrt of its element of S
};

struct Hypothesis {
  std::string name;  // "base line changed"; the healthy one is "healthy"
  double prior = 0;  // P(H_j); they need not sum to one
  std::vector<Amplitude> amplitudes;
  Eigen::MatrixXd effect;  // D_j: symptoms x amplitudes, per unit of amplitude
};

struct Symptoms {
  std::vector<std::string> names;      // of the elements of r, with their unit: "bar150, distance / mm"
  Eigen::VectorXd residual;            // r
  Eigen::MatrixXd covariance;          // C
  std::vector<Hypothesis> hypotheses;  // "healthy" among them
  double trueness_percent = 0;         // largest error of a length, relative to it
  std::string worst_length;            // its name
  std::vector<std::string> remarks;    // what was not there to be looked at
};

struct FittedAmplitude {
  std::string name, unit;
  double value = 0, u = 0;  // eq. 4
};

struct Cause {
  std::string name;
  double probability = 0;  // eq. 3
  double chi2 = 0;         // r^T M_j^{-1} r
  std::vector<FittedAmplitude> amplitudes;
};

enum class Health { ok, degraded, fail };
const char* name_of(Health health);

struct Diagnosis {
  Health health = Health::ok;
  double probability_healthy = 0;
  std::vector<Cause> causes;       // all but "healthy", by falling probability
  std::vector<std::string> named;  // one: the cause; several: not separable; none: healthy, or unexplained
  bool explained = true;           // eq. 5 for the best
  int n_symptoms = 0;
  double trueness_percent = 0;
  std::string worst_length;
  std::string sentence;  // for the operator
  std::vector<std::string> remarks;
};

/// Below this probability of being healthy a scanner is at best degraded.
inline constexpr double kHealthy = 0.5;
inline constexpr double kNamed = 0.9;
inline constexpr double kNonlinear = 0.02;

/// Eqs. 1 to 5. Health: ok or degraded; a limit that is violated is the plan's to judge (with_limits()). No "healthy",
/// sizes that do not fit or a covariance that is not positive: std::logic_error.
Diagnosis diagnose(const Symptoms& symptoms);

/// limits_violated: some quantity is outside its limits. Then the health is fail, whatever the pattern.
Diagnosis with_limits(Diagnosis diagnosis, bool limits_violated);

Value to_value(const Diagnosis& diagnosis);
Diagnosis diagnosis_from(Fields fields);

}  // namespace fringecal::metrology

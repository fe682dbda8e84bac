// The uncertainty budget of one quantity, by the law of propagation of uncertainty.
//   u_i(y) = |c_i| u(x_i),  c_i = df/dx_i                                                       (1) [GUM, 5.1.3]
//   u_c^2(y) = sum_i u_i^2(y), the inputs being independent                                     (2) [GUM, eq. 10]
//   nu_eff = u_c^4 / sum_i (u_i^4 / nu_i), cut to the next lower integer                        (3) [GUM, eq. G.2b, G.4.2]
//   U = k u_c,  k = t_p(nu_eff): the two-sided quantile of Student's t                          (4) [GUM, G.3.2]
// p = 0.9545 by default (erf(sqrt 2), to all digits), so that k is 2 where nu_eff is infinite. An effect that several readings share (a certificate, the
// calibration) is *one* contribution, entered once with its own sensitivity; that keeps (2) true without a correlation.
//
// A contribution also says of what form its distribution is; (1) to (4) need only u, but the Monte Carlo
// (metrology/monte_carlo.h) that validates them draws from it.
#pragma once

#include "core/fields.h"
#include "core/value.h"

#include <limits>
#include <string>
#include <vector>

namespace fringecal::metrology {

/// GUM 4.2 and 4.3: from repeated readings, or from anything else.
enum class Evaluation { type_a, type_b };

/// student_t: with nu degrees of freedom, scaled so that u is the scale (GUM), as an average of few readings has it.
enum class Form { normal, student_t, rectangular, triangular, arcsine };

const char* name_of(Evaluation evaluation);
const char* name_of(Form form);
/// The form of that name. Throws InputError.
Form form_from(const std::string& name);

inline constexpr double kInfiniteNu = std::numeric_limits<double>::infinity();
inline constexpr double kCoverage =
    0.954499736103641586;  // erf(sqrt(2)): two standard deviations of a normal distribution

struct Contribution {
  std::string name;  // "certificate of the artefact", "repeatability of the mean"
  Evaluation evaluation = Evaluation::type_b;
  Form form = Form::normal;
  double u = 0;  // standard uncertainty of the input, in `unit`
  std::string unit = "mm";
  double sensitivity = 1;  // unit of the quantity per `unit`
  double nu = kInfiniteNu;

  double u_of_quantity() const { return (sensitivity < 0 ? -sensitivity : sensitivity) * u; }  // eq. 1
};

struct Combined {
  double u = 0;             // eq. 2
  double nu = kInfiniteNu;  // eq. 3
  double k = 2, U = 0;      // eq. 4
  double coverage = kCoverage;
};

/// Eqs. 1 to 4. A negative u, a nu below 1, a coverage outside (0, 1): std::logic_error.
Combined combine(const std::vector<Contribution>& budget, double coverage = kCoverage);

/// t_p(nu), two-sided; nu may be infinite.
double student_factor(double nu, double coverage);

/// nu is absent where it is infinite (JSON has no infinity).
Value to_value(const Contribution& contribution);
Contribution read_contribution(Fields fields);
Value to_value(const Combined& combined);
Combined read_combined(Fields fields);

}  // namespace fringecal::metrology

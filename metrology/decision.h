// Statement of conformity: a measured value y with U = k u against limits T_L, T_U.
//
// simple        accepted when T_L <= y <= T_U, rejected otherwise: the risk is shared           (1) [ILAC-G8, 4.2.1]
// iso_14253_1   default. Conformity is proved when y lies inside the limits by more than the guard band,
//               non-conformity when it lies outside by more; between, neither is proved.
//                 g = k_g u, k_g = 1.645: at most 5 % probability of a wrong statement at the limit            (2) [ISO14253-1:2017, 5]
// guarded       accepted when inside by w = U, rejected otherwise                                              (3) [ILAC-G8, 4.2.2]
// four_outcomes pass (inside by w = U), conditional pass (inside), conditional fail (outside by less than U), fail  (4) [ILAC-G8, 4.2.3]
//
// With the value's distribution normal about y (Student's t where nu is finite) the conformance probability is
//   p_c = F((T_U - y) / u) - F((T_L - y) / u)                                                        (5) [JCGM106, 7.4]
// For an accepted result 1 - p_c is the probability that the statement is wrong (specific false acceptance), for a
// rejected one p_c (specific false rejection).
// A quantity that cannot be negative (a form error) has only T_U.
#pragma once

#include "core/fields.h"
#include "core/value.h"
#include "metrology/budget.h"

#include <optional>
#include <string>

namespace fringecal::metrology {

struct Limits {
  std::optional<double> lower, upper;  // in the unit of the quantity; at least one
};

enum class DecisionRule { iso_14253_1, simple, guarded, four_outcomes };
enum class Verdict { pass, conditional_pass, not_proved, conditional_fail, fail };

const char* name_of(DecisionRule rule);
const char* name_of(Verdict verdict);
/// The rule of that name. Throws InputError.
DecisionRule decision_rule_from(const std::string& name);
/// One sentence for the report: rule, guard band, source.
std::string sentence_of(DecisionRule rule);

struct Judgement {
  DecisionRule rule = DecisionRule::iso_14253_1;
  Verdict verdict = Verdict::not_proved;
  double guard_band = 0;               // eqs. 2 to 4, unit of the quantity
  double conformance_probability = 0;  // eq. 5
  /// The risk of the statement made: of false acceptance where it is a pass, of false rejection where it is a fail.
  std::optional<double> risk;
};

/// y with its combined uncertainty. No limit at all, or a lower above the upper one: std::logic_error.
Judgement judge(double y, const Combined& uncertainty, const Limits& limits, DecisionRule rule);

/// The worst verdict of many: fail, conditional fail, not proved, conditional pass, pass.
Verdict worst(Verdict a, Verdict b);

Value to_value(const Judgement& judgement);
Judgement read_judgement(Fields fields);

}  // namespace fringecal::metrology

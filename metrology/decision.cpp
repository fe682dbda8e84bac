#include "metrology/decision.h"

#include "core/error.h"

#include <fmt/format.h>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace fringecal::metrology {
namespace {

constexpr std::array kRules = {std::pair(DecisionRule::iso_14253_1, "iso_14253_1"),
                               std::pair(DecisionRule::simple, "simple"), std::pair(DecisionRule::guarded, "guarded"),
                               std::pair(DecisionRule::four_outcomes, "four_outcomes")};
constexpr std::array kVerdicts = {
    std::pair(Verdict::pass, "pass"), std::pair(Verdict::conditional_pass, "conditional pass"),
    std::pair(Verdict::not_proved, "not proved"), std::pair(Verdict::conditional_fail, "conditional fail"),
    std::pair(Verdict::fail, "fail")};
constexpr double kGuardFactor = 1.645;  // one-sided 95 % of the normal distribution, eq. 2

double cumulative(double x, double nu) {
  if (!std::isfinite(nu)) return boost::math::cdf(boost::math::normal(), x);
  return boost::math::cdf(boost::math::students_t(nu), x);
}

double conformance_probability(double y, const Combined& uncertainty, const Limits& limits) {
  if (!(uncertainty.u > 0)) {
    const bool inside = (!limits.upper || y <= *limits.upper) && (!limits.lower || y >= *limits.lower);
    return inside ? 1 : 0;
  }
  const auto below = [&](double limit) { return cumulative((limit - y) / uncertainty.u, uncertainty.nu); };
  return (limits.upper ? below(*limits.upper) : 1) - (limits.lower ? below(*limits.lower) : 0);  // eq. 5
}

}  // namespace

const char* name_of(DecisionRule rule) {
  for (const auto& [known, name] : kRules) {
    if (known == rule) return name;
  }
  throw std::logic_error("a decision rule without a name");
}

const char* name_of(Verdict verdict) {
  for (const auto& [known, name] : kVerdicts) {
    if (known == verdict) return name;
  }
  throw std::logic_error("a verdict without a name");
}

DecisionRule decision_rule_from(const std::string& name) {
  for (const auto& [rule, known] : kRules) {
    if (name == known) return rule;
  }
  throw InputError(fmt::format("\"{}\" is no decision rule; known: iso_14253_1, simple, guarded, four_outcomes", name));
}

std::string sentence_of(DecisionRule rule) {
  switch (rule) {
    case DecisionRule::iso_14253_1:
      return "ISO 14253-1:2017: conformity is stated when the value lies inside the limits by more than 1.645 u, "
             "non-conformity when it lies outside by more than 1.645 u (at most 5 % probability of a wrong statement); "
             "between, neither is proved.";
    case DecisionRule::simple:
      return "Simple acceptance (ILAC-G8:09/2019, 4.2.1): conformity is stated when the value lies inside the limits; "
             "near a limit up to 50 % of such statements can be wrong.";
    case DecisionRule::guarded:
      return "Guarded acceptance (ILAC-G8:09/2019, 4.2.2): conformity is stated when the value lies inside the limits "
             "by at least U.";
    case DecisionRule::four_outcomes:
      return "Non-binary statement (ILAC-G8:09/2019, 4.2.3): pass inside the limits by at least U, conditional pass "
             "inside by less, conditional fail outside by less than U, fail beyond.";
  }
  throw std::logic_error("a decision rule without a sentence");
}

Judgement judge(double y, const Combined& uncertainty, const Limits& limits, DecisionRule rule) {
  require(limits.lower || limits.upper, "a judgement needs a limit");
  require(!limits.lower || !limits.upper || *limits.lower <= *limits.upper, "the lower limit is below the upper one");
  double inside = kInfiniteNu;  // by how much y lies inside the nearer limit; negative: outside
  if (limits.upper) inside = std::min(inside, *limits.upper - y);
  if (limits.lower) inside = std::min(inside, y - *limits.lower);
  Judgement out{.rule = rule, .conformance_probability = conformance_probability(y, uncertainty, limits)};
  switch (rule) {
    case DecisionRule::simple:
      out.verdict = inside >= 0 ? Verdict::pass : Verdict::fail;
      break;
    case DecisionRule::iso_14253_1:
      out.guard_band = kGuardFactor * uncertainty.u;
      out.verdict = inside >= out.guard_band    ? Verdict::pass
                    : inside <= -out.guard_band ? Verdict::fail
                                                : Verdict::not_proved;
      // Without uncertainty a value on the limit conforms.
      break;
    case DecisionRule::guarded:
      out.guard_band = uncertainty.U;
      out.verdict = inside >= out.guard_band ? Verdict::pass : Verdict::fail;
      break;
    case DecisionRule::four_outcomes:
      out.guard_band = uncertainty.U;
      out.verdict = inside >= out.guard_band   ? Verdict::pass
                    : inside >= 0              ? Verdict::conditional_pass
                    : inside > -out.guard_band ? Verdict::conditional_fail
                                               : Verdict::fail;
      break;
  }
  const bool accepts = out.verdict == Verdict::pass || out.verdict == Verdict::conditional_pass;
  const bool rejects = out.verdict == Verdict::fail || out.verdict == Verdict::conditional_fail;
  if (accepts) out.risk = 1 - out.conformance_probability;
  if (rejects) out.risk = out.conformance_probability;
  return out;
}

Verdict worst(Verdict a, Verdict b) { return std::max(a, b); }

Value to_value(const Judgement& j) {
  Value out = Value::object()
                  .set("rule", name_of(j.rule))
                  .set("verdict", name_of(j.verdict))
                  .set("guard_band", j.guard_band)
                  .set("conformance_probability", j.conformance_probability);
  if (j.risk) out.set("risk", *j.risk);
  return out;
}

Judgement read_judgement(Fields fields) {
  Judgement out;
  out.rule = decision_rule_from(fields.text("rule"));
  const std::string verdict = fields.text("verdict");
  const auto* known =
      std::find_if(kVerdicts.begin(), kVerdicts.end(), [&](const auto& v) { return verdict == v.second; });
  if (known == kVerdicts.end()) fields.complain(fmt::format("\"{}\" is no verdict", verdict));
  out.verdict = known->first;
  out.guard_band = fields.number("guard_band");
  out.conformance_probability = fields.number("conformance_probability");
  out.risk = fields.optional_number("risk");
  fields.finish();
  return out;
}

}  // namespace fringecal::metrology

#include "core/pattern_plan.h"

#include <fmt/format.h>

#include <algorithm>

namespace fringecal {
namespace {

constexpr const char* name(CodeAxis axis) { return axis == CodeAxis::x ? "x" : "y"; }

}  // namespace

std::string describe(const Pattern& p) {
  const std::string prefix = p.axis == CodeAxis::y ? "y " : "";
  switch (p.kind) {
    case PatternKind::gray:
      return fmt::format("{}gray {}{}", prefix, p.index, p.inverted ? " inverted" : "");
    case PatternKind::phase:
      return fmt::format("{}phase {}", prefix, p.index);
    case PatternKind::white:
      return "white";
    case PatternKind::black:
      return "black";
  }
  return "";
}

std::optional<std::size_t> PatternPlan::find(const Pattern& pattern) const {
  const auto it = std::find(patterns.begin(), patterns.end(), pattern);
  if (it == patterns.end()) return std::nullopt;
  return static_cast<std::size_t>(it - patterns.begin());
}

std::string defect_of(const PatternPlan& plan) {
  if (!plan.x && !plan.y) return "the plan names no code; add codes.x or codes.y";
  for (std::size_t i = 0; i < plan.patterns.size(); ++i) {
    const Pattern& p = plan.patterns[i];
    for (std::size_t j = 0; j < i; ++j) {
      if (plan.patterns[j] == p) {
        return fmt::format("frames {} and {} are both '{}'; each pattern may stand once", j, i, describe(p));
      }
    }
    if (p.kind != PatternKind::gray && p.kind != PatternKind::phase) continue;
    const auto& code = plan.code(p.axis);
    if (!code) return fmt::format("frame {} is '{}' but the plan has no code along {}", i, describe(p), name(p.axis));
    const int count = p.kind == PatternKind::gray ? code->gray_bits : code->phase_steps;
    if (p.index < 0 || p.index >= count) {
      return fmt::format("frame {} is '{}' but the code along {} has only {} of these", i, describe(p), name(p.axis),
                         count);
    }
  }
  const bool white_and_black = plan.find({.kind = PatternKind::white}) && plan.find({.kind = PatternKind::black});
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    const auto& code = plan.code(axis);
    if (!code) continue;
    if (code->gray_bits < 0 || code->gray_bits > 20)
      return fmt::format("gray_bits is {}; 0 to 20 make sense", code->gray_bits);
    if (code->gray_bits == 0 && code->phase_steps == 0)
      return fmt::format("the code along {} has neither Gray bits nor phase steps", name(axis));
    if (code->phase_steps != 0 && code->phase_steps < 3)
      return fmt::format("phase_steps is {}; at least 3 are needed, or 0 for none", code->phase_steps);
    if (code->stripes_per_period != 1 && code->stripes_per_period != 2)
      return fmt::format("stripes_per_period is {}; it is 1 or 2", code->stripes_per_period);
    if (!(code->period > 0)) return fmt::format("the period is {} {}; it must be positive", code->period, code->unit);
    if (code->unit != "mm" && code->unit != "px")
      return fmt::format("the unit is '{}'; it is \"mm\" or \"px\"", code->unit);
    for (int k = 0; k < code->phase_steps; ++k) {
      const Pattern p{.kind = PatternKind::phase, .axis = axis, .index = k};
      if (!plan.find(p)) return fmt::format("'{}' of {} phase steps is missing", describe(p), code->phase_steps);
    }
    for (int k = 0; k < code->gray_bits; ++k) {
      const Pattern p{.kind = PatternKind::gray, .axis = axis, .index = k};
      if (!plan.find(p)) return fmt::format("'{}' of {} Gray bits is missing", describe(p), code->gray_bits);
      if (code->phase_steps == 0 && !white_and_black && !plan.find({PatternKind::gray, axis, k, true})) {
        return fmt::format(
            "'{}' has nothing to be compared with: neither its inverse, nor phase patterns, nor white and black",
            describe(p));
      }
    }
  }
  return "";
}

Value to_value(const FringeCode& code) {
  return Value::object()
      .set("gray_bits", code.gray_bits)
      .set("phase_steps", code.phase_steps)
      .set("stripes_per_period", code.stripes_per_period)
      .set("period", code.period)
      .set("unit", code.unit);
}

FringeCode fringe_code_from(Fields fields) {
  FringeCode code;
  code.gray_bits = fields.integer("gray_bits");
  code.phase_steps = fields.integer("phase_steps");
  code.stripes_per_period = fields.integer("stripes_per_period");
  code.period = fields.number("period");
  code.unit = fields.text("unit");
  fields.finish();
  return code;
}

Value to_value(const Pattern& pattern) {
  static constexpr const char* kNames[] = {"gray", "phase", "white", "black"};
  Value out = Value::object().set("kind", kNames[static_cast<int>(pattern.kind)]);
  if (pattern.kind == PatternKind::gray)
    out.set("axis", name(pattern.axis)).set("bit", pattern.index).set("inverted", pattern.inverted);
  if (pattern.kind == PatternKind::phase) out.set("axis", name(pattern.axis)).set("step", pattern.index);
  return out;
}

Pattern pattern_from(Fields fields) {
  Pattern p;
  const std::string kind = fields.text("kind");
  const auto axis = [&] {
    const std::string text = fields.optional_text("axis").value_or("x");
    if (text != "x" && text != "y") fields.complain(fmt::format("axis is '{}'; it is \"x\" or \"y\"", text));
    return text == "x" ? CodeAxis::x : CodeAxis::y;
  };
  if (kind == "gray") {
    p = {PatternKind::gray, axis(), fields.integer("bit"), fields.optional_boolean("inverted").value_or(false)};
  } else if (kind == "phase") {
    p = {PatternKind::phase, axis(), fields.integer("step"), false};
  } else if (kind == "white" || kind == "black") {
    p.kind = kind == "white" ? PatternKind::white : PatternKind::black;
  } else {
    fields.complain(fmt::format("kind is '{}'; it is \"gray\", \"phase\", \"white\" or \"black\"", kind));
  }
  fields.finish();
  return p;
}

}  // namespace fringecal

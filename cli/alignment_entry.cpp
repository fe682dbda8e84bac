#include "cli/alignment_entry.h"

#include "cli/records.h"
#include "core/fields.h"

#include <fmt/format.h>

namespace fringecal::cli {

metrology::InstrumentRecord record_of(const AlignmentEntry& entry, std::span<const Value> iterations,
                                      const std::string& file) {
  metrology::InstrumentRecord out{
      .event = "alignment", .scanner = entry.scanner, .ended = entry.ended, .provenance = provenance_now()};
  const auto decision_of = [&](const Value& iteration) {
    Fields fields(iteration, file);
    return fields.table("step").text("decision");
  };
  const std::string decision = decision_of(iterations.back());
  const bool ended = decision != "turn";
  out.outcome = fmt::format("{} after {} turns", ended ? decision : "to be turned", iterations.size() - 1);
  const auto add = [&](const Value& iteration, const char* position) {
    Fields fields(iteration, file);
    Fields measured = fields.table("measured"), step = fields.table("step");
    const double tolerance_um = step.number("tolerance_um");
    out.quantities.push_back({"theta", "angle of the fringes against the slide", position, "mrad",
                              measured.number("theta_mrad"), measured.number("u_theta_mrad")});
    out.quantities.push_back({"delta", fmt::format("jump of bit {} against the phase", step.integer("bit")), position,
                              "um", step.number("delta_um"), step.number("u_delta_um"),
                              metrology::Limits{-tolerance_um, tolerance_um}});
  };
  add(iterations.front(), "as found");
  if (iterations.size() > 1 || ended) add(iterations.back(), ended ? "as left" : "on the way");
  if (auto temperature = metrology::temperature_of(entry.captures)) out.quantities.push_back(*temperature);
  out.provenance.inputs = entry.inputs;
  return out;
}

std::string append_words(const std::string& file, const metrology::InstrumentRecord& record) {
  metrology::History history = history_to_append(file);
  const auto number = metrology::append_once(history, record);
  return fmt::format("history: {} is entry {} of {}, hash {}\n", record.event, number, file,
                     history.entry(number).hash);
}

}  // namespace fringecal::cli

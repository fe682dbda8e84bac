#include "calib/decode/corrections.h"

#include "calib/decode/phase.h"
#include "core/parallel.h"

#include <fmt/format.h>

#include <cmath>

namespace fringecal::decode {
namespace {

/// The wrapped phase becomes `to`, the absolute one moves by as much.
void move_phase(PhaseMap& map, std::size_t i, double to) {
  const double by = wrapped_angle(to - map.wrapped_rad.values()[i]);
  map.wrapped_rad.values()[i] = static_cast<float>(wrapped_angle(to));
  if (map.validity.values()[i] == 0) map.phase_rad.values()[i] = static_cast<float>(map.phase_rad.values()[i] + by);
}

void require_match(const Capture& capture, CodeAxis axis, const model::PhaseLinearisation& table) {
  const auto& code = capture.info.plan.code(axis);
  const std::string where = capture.folder.empty() ? "the capture" : capture.folder.string();
  if (table.axis != axis || !code || code->phase_steps != table.phase_steps || code->period != table.period) {
    throw InputError(
        fmt::format("{}: its phase patterns are not those of the Scanner's phase linearisation ({} steps, "
                    "period {}); measure without the linearisation or calibrate with this grating",
                    where, table.phase_steps, table.period));
  }
  if (capture.info.width_px != table.width_px || capture.info.height_px != table.height_px) {
    throw InputError(fmt::format("{}: images of {} x {} pixels, the Scanner's phase linearisation is for {} x {}",
                                 where, capture.info.width_px, capture.info.height_px, table.width_px,
                                 table.height_px));
  }
}

}  // namespace

void undo_ellipse(PhaseMap& map, const model::StepEllipse& ellipse) {
  parallel_for(map.height(), [&](int y) {
    for (int x = 0; x < map.width(); ++x) {
      const std::size_t i = map.validity.index(x, y);
      const auto w = ellipse.undone(std::polar(1.0, static_cast<double>(map.wrapped_rad.values()[i])));
      map.modulation.values()[i] = static_cast<float>(map.modulation.values()[i] * std::sqrt(std::norm(w)));
      move_phase(map, i, std::arg(w));
    }
  });
}

void linearise(PhaseMap& map, const model::PhaseLinearisation& table) {
  parallel_for(map.height(), [&](int y) {
    for (int x = 0; x < map.width(); ++x) {
      const std::size_t i = map.validity.index(x, y);
      move_phase(map, i, table.corrected(map.wrapped_rad.values()[i], table.ripple_at(x, y)));
    }
  });
}

MeasuringMap decode_for_measuring(const Capture& capture, CodeAxis axis, const model::PhaseLinearisation* table,
                                  const CorrectionOptions& options) {
  MeasuringMap out{.map = decode_phase(capture, axis), .stack = std::nullopt, .linearised = false, .remarks = {}};
  if (out.map.code.phase_steps == 0) return out;
  if (options.linearisation == Correct::no) table = nullptr;
  if (table) require_match(capture, axis, *table);
  if (options.stack == Correct::yes) {
    const auto errors = estimate_stack_errors(capture, out.map);
    if (errors) {
      out.stack = *errors;
    } else {
      out.remarks.push_back(errors.error().sentence);
    }
  }
  if (out.stack) {
    undo_ellipse(out.map, out.stack->ellipse);
  } else if (table) {
    undo_ellipse(out.map, table->fixed);
  }
  if (table) {
    linearise(out.map, *table);
    out.linearised = true;
  }
  return out;
}

std::string words_for(const MeasuringMap& map) {
  std::string out = "this stack's step and lamp errors: ";
  if (map.stack) {
    const auto& e = map.stack->ellipse;
    out +=
        fmt::format("corrected ({:.2f} mrad of one, {:.2f} mrad of two cycles per period, u = {:.2f} mrad)",
                    1e3 * std::abs(e.offset), 1e3 * std::abs(e.conjugate), 1e3 * std::max(e.u_offset, e.u_conjugate));
  } else {
    out += map.remarks.empty() ? "not corrected" : "not corrected: " + map.remarks.front();
  }
  return out + (map.linearised ? "; phase linearisation: on" : "; phase linearisation: off");
}

}  // namespace fringecal::decode

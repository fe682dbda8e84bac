// The phase-linearisation table of a Scanner, measured on flat-board captures of the aligned instrument.
//
// Each stack is decoded with the code's redundancy and freed of its own step and lamp errors (decode/stack_errors.h).
// What the phase then shows with N cycles per period, at a node n of a grid over the field,
//   phi_hp = sum_n hat_n(x, y) (a_n cos_hp(N phi) + b_n sin_hp(N phi)) + [1 and 2 cycles]                  (1)
// (ripple.h; hat_n the bilinear function of the node) is a fixed error of patterns and lens: on a flat board the phase
// has no periods of its own. Stacks are averaged; u(a_n) from the scatter of the pixels, or of the stacks where that is
// larger. The 1 and 2 cycles left in eq. 1 were to be zero: they check the modulation's ripple, which gave z0 and q,
// against the phase's. The mean of z0 and q over the stacks (placement errors, the last bit of angle) is kept for
// stacks that cannot tell their own. A board a little out of flat does no harm: only waves of 1/N period would.
// No result: no flat board, too small, too little modulation (as the alignment refuses), with the reason.
#pragma once

#include "calib/decode/corrections.h"
#include "core/result.h"

#include <memory>
#include <string>

namespace fringecal::calib {

struct LineariseOptions {
  int columns = 9, rows = 7;  // nodes: 174 px apart at the default camera; a parabola of 8 mrad loses 0.1 mrad between
};

/// Stacks are handed over one by one, so that only one has to be in memory.
class LinearisationFit {
 public:
  explicit LinearisationFit(CodeAxis axis, const LineariseOptions& options = {});
  ~LinearisationFit();
  LinearisationFit(LinearisationFit&&) noexcept;

  /// No result (and nothing added): the capture does not serve. Throws InputError where its plan has no phase patterns
  /// along the axis, or it does not belong to the stacks before.
  Result<void> add(const Capture& capture, const std::string& name, const std::string& hash);
  /// At least one stack was added (std::logic_error).
  model::PhaseLinearisation table() const;
  /// Largest of the 1- and 2-cycle amplitudes that eq. 1 still found, mean over the stacks, rad.
  double left_over_rad() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace fringecal::calib

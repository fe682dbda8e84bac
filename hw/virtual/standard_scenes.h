// The scenes of the standard commissioning, and the artefacts of this instance with their certificates.
//
// A certificate's value is the nominal one plus a making error; the true value is the certificate's plus a draw from
// its own uncertainty. Both are fixed by the instrument's seed. A board's true pitch is the certified one times (1 +
// draw).
#pragma once

#include "core/uncertain.h"
#include "hw/virtual/preset.h"
#include "hw/virtual/scene.h"

#include <cstdint>
#include <optional>
#include <string>

namespace fringecal::virt {

/// Throws std::logic_error for an artefact that the preset does not know.
Uncertain certificate_mm(const Preset& preset, std::uint64_t instrument_seed, const std::string& artefact);
/// At that temperature of the room; certificates are for 20 degC.
double true_size_mm(const Preset& preset, std::uint64_t instrument_seed, const std::string& artefact,
                    double room_degC = 20.0);

/// kind: "chessboard" or "circles". The board as its certificate has it, and as it is.
model::Board certified_board(const Preset& preset, const std::string& kind);
PatternBoard true_board(const Preset& preset, std::uint64_t instrument_seed, const std::string& kind);

/// See VirtualScanner::standard_scene; empty for another name. how_many_th: time that a hand puts the things there.
std::optional<Scene> standard_scene(const Preset& preset, std::uint64_t instrument_seed, const std::string& name,
                                    double room_degC = 20.0, std::uint64_t how_many_th = 1);

}  // namespace fringecal::virt

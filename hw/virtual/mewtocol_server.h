// The virtual PLC as a MEWTOCOL-COM station on a pseudo-terminal: RD, WD, RCS, WCS; refusals with the protocol's codes
// (40 BCC, 41 format, 42 unknown command, 53 busy, 60 parameter, 61 data). Frames for other stations get no answer.
#pragma once

#include "hw/virtual/byte_server.h"
#include "hw/virtual/plc_core.h"

#include <memory>
#include <string>

namespace fringecal::virt {

/// The core must outlive the server.
std::unique_ptr<ByteServer> serve_mewtocol(PlcCore& core, int station = 1, const std::string& link = "");

/// The text of the answer to one command's text: kind ('$' or '!') and text.
std::string answer_mewtocol(PlcCore& core, const std::string& command);

}  // namespace fringecal::virt

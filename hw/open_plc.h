// open_plc: the PLC behind a device address (hw/device_address.h).
#pragma once

#include "hw/register_plc.h"

#include <memory>
#include <string>

namespace fringecal::hw {

/// Opens the link. Throws InputError (the address) or PlcLost (nothing there).
std::unique_ptr<RegisterPlc> open_plc(const std::string& address, PlcLinkOptions options = {});

}  // namespace fringecal::hw

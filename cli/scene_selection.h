// "plane 3", the name of a virtual scanner's scene on the command line, as the virtual PLC's registers say it.
#pragma once

#include "hw/register_plc.h"

#include <string>

namespace fringecal::cli {

/// Scene and pose; stack seed and warm-up are left as they are by default. Throws InputError.
hw::VirtualSelection scene_selection(const std::string& words);

}  // namespace fringecal::cli

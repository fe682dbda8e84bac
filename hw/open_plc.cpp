#include "hw/open_plc.h"

#include "hw/device_address.h"
#include "hw/mewtocol_plc.h"
#include "hw/modbus_plc.h"

namespace fringecal::hw {

std::unique_ptr<RegisterPlc> open_plc(const std::string& address, PlcLinkOptions options) {
  const PlcAddress parsed = parse_plc_address(address);
  if (parsed.protocol == PlcProtocol::mewtocol) return std::make_unique<MewtocolPlc>(parsed, options);
  return std::make_unique<ModbusPlc>(parsed, options);
}

}  // namespace fringecal::hw

#include "hw/device_address.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <optional>
#include <string_view>

namespace fringecal::hw {
namespace {

constexpr const char* kForms =
    "modbus-tcp://127.0.0.1:5020, modbus-rtu:/dev/ttyUSB0?baud=115200&slave=1 or "
    "mewtocol:/dev/ttyUSB0?baud=9600&station=1";

std::optional<int> integer_from(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// The part of an address after '?', each key to be taken once.
class Query {
 public:
  Query(std::string address, std::string_view text) : address_(std::move(address)) {
    while (!text.empty()) {
      const std::string_view item = text.substr(0, text.find('&'));
      text.remove_prefix(std::min(text.size(), item.size() + 1));
      const auto equals = item.find('=');
      if (equals == std::string_view::npos || equals == 0) {
        throw InputError(fmt::format("PLC address '{}': '{}' is not of the form key=value", address_, item));
      }
      if (!items_.emplace(item.substr(0, equals), item.substr(equals + 1)).second) {
        throw InputError(fmt::format("PLC address '{}': '{}' is given twice", address_, item.substr(0, equals)));
      }
    }
  }

  int integer(const std::string& key, int absent, int least, int most) {
    const auto item = items_.find(key);
    if (item == items_.end()) return absent;
    const auto value = integer_from(item->second);
    if (!value || *value < least || *value > most) {
      throw InputError(fmt::format("PLC address '{}': {} is '{}'; it must be a whole number from {} to {}", address_,
                                   key, item->second, least, most));
    }
    items_.erase(item);
    return *value;
  }

  Parity parity(Parity absent) {
    const auto item = items_.find("parity");
    if (item == items_.end()) return absent;
    const std::string value = item->second;
    items_.erase(item);
    if (value == "none") return Parity::none;
    if (value == "even") return Parity::even;
    if (value == "odd") return Parity::odd;
    throw InputError(fmt::format("PLC address '{}': parity is '{}'; it can be none, even or odd", address_, value));
  }

  void finish() const {
    if (items_.empty()) return;
    throw InputError(fmt::format("PLC address '{}': '{}' is not a setting of this kind of address; known forms are {}",
                                 address_, items_.begin()->first, kForms));
  }

 private:
  std::string address_;
  std::map<std::string, std::string, std::less<>> items_;
};

void read_line(PlcAddress& address, std::string_view device, Query& query) {
  constexpr std::array kBauds = {1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400};
  if (device.empty() || device.front() != '/') {
    throw InputError(fmt::format("PLC address '{}': the serial device is '{}'; give its full path, as in {}",
                                 address.text, device, kForms));
  }
  address.line.device = device;
  address.line.baud = query.integer("baud", address.line.baud, 1, 1000000);
  if (std::find(kBauds.begin(), kBauds.end(), address.line.baud) == kBauds.end()) {
    throw InputError(fmt::format("PLC address '{}': {} baud is not a usual speed; one of {} is", address.text,
                                 address.line.baud, fmt::join(kBauds, ", ")));
  }
  address.line.parity = query.parity(address.line.parity);
  address.line.stop_bits = query.integer("stop", 1, 1, 2);
}

}  // namespace

std::string parse_ip_address(const std::string& text, const std::string& what) {
  std::array<int, 4> part{};
  std::string_view rest = text;
  bool good = true;
  for (std::size_t k = 0; k < 4 && good; ++k) {
    const std::string_view item = rest.substr(0, rest.find('.'));
    const auto value = integer_from(item);
    good = value && *value >= 0 && *value <= 255 && item.size() <= 3 && (k < 3) == (item.size() < rest.size());
    if (good) part[k] = *value;
    rest.remove_prefix(std::min(rest.size(), item.size() + 1));
  }
  if (!good) {
    throw InputError(fmt::format(
        "{} address '{}': give the device's IP address in four numbers, as in 192.168.1.20; a name would have to be "
        "searched for by a broadcast to everything on the network",
        what, text));
  }
  if (part[0] == 0 || part[0] >= 224) {
    throw InputError(fmt::format(
        "{} address '{}': this is a {} address, which reaches more than one device; give the device's own IP address",
        what, text,
        part[0] == 0    ? "wildcard"
        : part[0] < 240 ? "multicast"
                        : "broadcast or reserved"));
  }
  return fmt::format("{}.{}.{}.{}", part[0], part[1], part[2], part[3]);
}

PlcAddress parse_plc_address(const std::string& text) {
  PlcAddress address;
  address.text = text;
  std::string_view rest = text;
  const auto take = [&](std::string_view prefix) {
    if (!rest.starts_with(prefix)) return false;
    rest.remove_prefix(prefix.size());
    return true;
  };
  const auto mark = rest.find('?');
  Query query(text, mark == std::string_view::npos ? std::string_view() : rest.substr(mark + 1));
  rest = rest.substr(0, mark);
  if (take("modbus-tcp://")) {
    address.protocol = PlcProtocol::modbus_tcp;
    const auto colon = rest.find(':');
    address.host = parse_ip_address(std::string(rest.substr(0, colon)), "PLC");
    if (colon != std::string_view::npos) {
      const auto port = integer_from(rest.substr(colon + 1));
      if (!port || *port < 1 || *port > 65535) {
        throw InputError(fmt::format("PLC address '{}': the port is '{}'; it must be a number from 1 to 65535", text,
                                     rest.substr(colon + 1)));
      }
      address.port = *port;
    }
    address.station = query.integer("slave", 1, 0, 247);
  } else if (take("modbus-rtu:")) {
    address.protocol = PlcProtocol::modbus_rtu;
    read_line(address, rest, query);
    address.station = query.integer("slave", 1, 1, 247);
  } else if (take("mewtocol:")) {
    address.protocol = PlcProtocol::mewtocol;
    address.line = SerialLine{.device = "", .baud = 9600, .parity = Parity::odd, .stop_bits = 1};
    read_line(address, rest, query);
    address.station = query.integer("station", 1, 1, 99);
  } else {
    throw InputError(fmt::format("PLC address '{}': this is none of the known forms: {}", text, kForms));
  }
  query.finish();
  return address;
}

}  // namespace fringecal::hw

// Device addresses: the three forms, their defaults, and what is said about a wrong one.
#include "hw/device_address.h"

#include "core/error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace fringecal::hw {
namespace {

using testing::HasSubstr;

std::string complaint_about(const std::string& address) {
  try {
    parse_plc_address(address);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(DeviceAddress, ReadsAModbusTcpAddressAndItsDefaultPort) {
  const PlcAddress a = parse_plc_address("modbus-tcp://127.0.0.1:5020");
  EXPECT_EQ(a.protocol, PlcProtocol::modbus_tcp);
  EXPECT_EQ(a.host, "127.0.0.1");
  EXPECT_EQ(a.port, 5020);
  EXPECT_EQ(a.station, 1);
  EXPECT_EQ(parse_plc_address("modbus-tcp://10.1.2.3").port, 502);
  EXPECT_EQ(parse_plc_address("modbus-tcp://10.1.2.3?slave=17").station, 17);
}

TEST(DeviceAddress, ReadsASerialAddressWithAllItsSettings) {
  const PlcAddress a = parse_plc_address("modbus-rtu:/dev/ttyUSB0?baud=115200&slave=3&parity=none&stop=2");
  EXPECT_EQ(a.protocol, PlcProtocol::modbus_rtu);
  EXPECT_EQ(a.line.device, "/dev/ttyUSB0");
  EXPECT_EQ(a.line.baud, 115200);
  EXPECT_EQ(a.line.parity, Parity::none);
  EXPECT_EQ(a.line.stop_bits, 2);
  EXPECT_EQ(a.station, 3);
}

TEST(DeviceAddress, SerialDefaultsAreThoseOfTheProtocol) {
  const PlcAddress rtu = parse_plc_address("modbus-rtu:/dev/ttyS0");
  EXPECT_EQ(rtu.line.baud, 19200);
  EXPECT_EQ(rtu.line.parity, Parity::even);
  const PlcAddress mewtocol = parse_plc_address("mewtocol:/dev/ttyS0");
  EXPECT_EQ(mewtocol.line.baud, 9600);
  EXPECT_EQ(mewtocol.line.parity, Parity::odd);
  EXPECT_EQ(mewtocol.station, 1);
}

TEST(DeviceAddress, SaysWhatIsWrongAndWhatToWrite) {
  EXPECT_THAT(complaint_about("tcp:127.0.0.1"), HasSubstr("modbus-tcp://127.0.0.1:5020"));
  EXPECT_THAT(complaint_about("modbus-tcp://127.0.0.1:99999"), HasSubstr("1 to 65535"));
  EXPECT_THAT(complaint_about("modbus-tcp://plc.local"), HasSubstr("four numbers"));
  EXPECT_THAT(complaint_about("modbus-tcp://255.255.255.255"), HasSubstr("broadcast"));
  EXPECT_THAT(complaint_about("modbus-tcp://0.0.0.0"), HasSubstr("wildcard"));
  EXPECT_THAT(complaint_about("modbus-tcp://1.2.3.4.5"), HasSubstr("four numbers"));
  EXPECT_THAT(complaint_about("modbus-tcp://1.2.3."), HasSubstr("four numbers"));
  EXPECT_THAT(complaint_about("modbus-tcp://1.2.3.4?station=1"), HasSubstr("'station' is not a setting"));
  EXPECT_THAT(complaint_about("modbus-rtu:ttyUSB0"), HasSubstr("full path"));
  EXPECT_THAT(complaint_about("modbus-rtu:/dev/ttyUSB0?baud=9601"), HasSubstr("9601 baud"));
  EXPECT_THAT(complaint_about("modbus-rtu:/dev/ttyUSB0?slave=0"), HasSubstr("1 to 247"));
  EXPECT_THAT(complaint_about("modbus-rtu:/dev/ttyUSB0?parity=mark"), HasSubstr("none, even or odd"));
  EXPECT_THAT(complaint_about("mewtocol:/dev/ttyUSB0?station=100"), HasSubstr("1 to 99"));
  EXPECT_THAT(complaint_about("mewtocol:/dev/ttyUSB0?station"), HasSubstr("key=value"));
  EXPECT_THAT(complaint_about("mewtocol:/dev/ttyUSB0?station=1&station=2"), HasSubstr("twice"));
}

TEST(DeviceAddress, ACameraNameIsRefusedBecauseItWouldBroadcast) {
  EXPECT_EQ(parse_ip_address("192.168.1.20", "camera"), "192.168.1.20");
  try {
    parse_ip_address("Basler-21", "camera");
    FAIL() << "a name was accepted";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("camera address 'Basler-21'"));
    EXPECT_THAT(e.what(), HasSubstr("broadcast"));
  }
}

}  // namespace
}  // namespace fringecal::hw

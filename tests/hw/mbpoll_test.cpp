// An independent client, Debian's mbpoll, reads and writes the virtual PLC's registers over TCP and RTU.
#include "hw/plc_map.h"
#include "hw/virtual/modbus_server.h"
#include "tests/support/other_programs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace fringecal::hw {
namespace {

using fringecal::test::run_in_shell;
using testing::ContainsRegex;
using testing::HasSubstr;
using virt::PlcCore;

class Mbpoll : public testing::Test {
 protected:
  void SetUp() override {
    if (!fringecal::test::installed("mbpoll")) GTEST_SKIP() << "mbpoll is not installed: apt-get install mbpoll";
  }
  PlcCore core_;
};

// -0: references as protocol addresses, so "-r 4" is DT4. mbpoll's 32-bit integers have the low word first, as the map.
TEST_F(Mbpoll, ReadsAndWritesOverTcp) {
  const auto server = virt::serve_modbus_tcp(core_);
  const std::string mbpoll = "mbpoll -1 -0 -q -p " + std::to_string(server->port()) + " ";
  const std::string host = " 127.0.0.1 ";
  const auto version = run_in_shell(mbpoll + "-r 0" + host);
  EXPECT_EQ(version.status, 0) << version.output;
  EXPECT_THAT(version.output, ContainsRegex("\\[0\\]:[ \t]+1\n"));
  EXPECT_EQ(run_in_shell(mbpoll + "-r 20" + host + "0 1 7").status, 0);   // home, sequence 7
  EXPECT_EQ(run_in_shell(mbpoll + "-r 20" + host + "10 2 8").status, 0);  // to pattern 10
  const auto position = run_in_shell(mbpoll + "-t 4:int -r 4" + host);
  EXPECT_THAT(position.output, ContainsRegex("\\[4\\]:[ \t]+140000\n"));
  EXPECT_EQ(run_in_shell(mbpoll + "-r 23" + host + "1").status, 0);  // one register: function code 6
  EXPECT_TRUE(core_.snapshot().lamp_on);
  EXPECT_EQ(core_.snapshot().pattern, 10);
  const auto refused = run_in_shell(mbpoll + "-r 0" + host + "5");
  EXPECT_NE(refused.status, 0);
  EXPECT_THAT(refused.output, HasSubstr("Illegal data address"));
  const auto coils = run_in_shell(mbpoll + "-t 0 -r 0" + host);
  EXPECT_THAT(coils.output, HasSubstr("Illegal function"));
}

TEST_F(Mbpoll, ReadsAndWritesOverRtu) {
  const auto server = virt::serve_modbus_rtu(core_, 3);
  const std::string mbpoll = "mbpoll -1 -0 -q -m rtu -b 115200 -P none -a 3 ";
  const std::string line = " " + server->device() + " ";
  EXPECT_EQ(run_in_shell(mbpoll + "-r 20" + line + "0 1 7").status, 0);
  const auto done = run_in_shell(mbpoll + "-r 0 -c 14" + line);
  EXPECT_EQ(done.status, 0) << done.output;
  EXPECT_THAT(done.output, ContainsRegex("\\[3\\]:[ \t]+7\n"));
  EXPECT_THAT(done.output, ContainsRegex("\\[9\\]:[ \t]+2150\n"));  // 21.50 degC
}

}  // namespace
}  // namespace fringecal::hw

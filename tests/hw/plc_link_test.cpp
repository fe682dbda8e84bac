// The register map over the three wires, each against the virtual PLC on loopback or a pseudo-terminal: the same tests
// for Modbus TCP, Modbus RTU and MEWTOCOL-COM, with every fault of the line injected.
#include "hw/open_plc.h"

#include "core/capture.h"
#include "core/error.h"
#include "hw/capture_sequence.h"
#include "hw/mewtocol.h"
#include "hw/mewtocol_plc.h"
#include "hw/virtual/mewtocol_server.h"
#include "hw/virtual/modbus_server.h"
#include "tests/hw/support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>

namespace fringecal::hw {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using virt::ByteServer;
using virt::PlcCore;

enum class Wire { modbus_tcp, modbus_rtu, mewtocol };

std::string name_of(const testing::TestParamInfo<Wire>& info) {
  return info.param == Wire::modbus_tcp ? "ModbusTcp" : info.param == Wire::modbus_rtu ? "ModbusRtu" : "Mewtocol";
}

// Loopback answers within a millisecond even on a busy machine; 60 ms decides "no answer" without slowing the tests.
constexpr PlcLinkOptions kLink{.answer_limit = 60ms, .attempts = 2};

class PlcLink : public testing::TestWithParam<Wire> {
 protected:
  PlcLink() { serve(); }

  void serve() {
    const std::string link = (folder_ / "tty").string();
    switch (GetParam()) {
      case Wire::modbus_tcp:
        server_ = virt::serve_modbus_tcp(*core_, "127.0.0.1", port_);
        port_ = server_->port();
        address_ = "modbus-tcp://127.0.0.1:" + std::to_string(port_);
        break;
      case Wire::modbus_rtu:
        server_ = virt::serve_modbus_rtu(*core_, 1, link);
        address_ = "modbus-rtu:" + link + "?baud=115200&slave=1";
        break;
      case Wire::mewtocol:
        server_ = virt::serve_mewtocol(*core_, 1, link);
        address_ = "mewtocol:" + link + "?baud=9600&station=1";
        break;
    }
  }

  test::TemporaryFolder folder_{test::memory_folder()};
  int port_ = 0;
  std::unique_ptr<PlcCore> core_ = std::make_unique<PlcCore>();
  std::unique_ptr<ByteServer> server_;
  std::string address_;
};

INSTANTIATE_TEST_SUITE_P(All, PlcLink, testing::Values(Wire::modbus_tcp, Wire::modbus_rtu, Wire::mewtocol), name_of);

TEST_P(PlcLink, RunsTheWholeRegisterMap) {
  const auto plc = open_plc(address_, kLink);
  EXPECT_EQ(plc->identity(), "virtual PLC (register map 1, 11 patterns)");
  plc->command(PlcCommand::home, 1);
  EXPECT_EQ(plc->status().sequence_done, 1);
  plc->set_lamp(true, 0.5);
  plc->command(PlcCommand::move_to_pattern, 65535, 10);
  const PlcStatus s = plc->status();
  EXPECT_EQ(s.state, PlcState::in_position);
  EXPECT_EQ(s.sequence_done, 65535);
  EXPECT_EQ(s.position_um, 140000);  // 20 mm + 10 * 12 mm: more than 16 bits
  EXPECT_TRUE(s.lamp_on);
  EXPECT_TRUE(s.door_closed);
  EXPECT_DOUBLE_EQ(s.temperature_degC, 21.5);
  EXPECT_DOUBLE_EQ(s.temperature_room_degC, 20.0);
  EXPECT_DOUBLE_EQ(core_->snapshot().lamp_level, 0.5);
  plc->feed_watchdog();
  plc->turn_mrad(-0.123456);
  plc->select({.scene = 3, .pose = 2, .stack_seed = 0xFEDCBA9876543210, .warm_up_min = 7});
  const auto seen = core_->snapshot();
  EXPECT_EQ(seen.pattern, 10);
  EXPECT_DOUBLE_EQ(seen.adjuster_turns_mrad.at(0), -0.123456);
  EXPECT_EQ(seen.scene_name, "spheres 2");
  EXPECT_EQ(seen.selection.stack_seed, 0xFEDCBA9876543210u);
  EXPECT_EQ(plc->late_answers(), 0);
}

TEST_P(PlcLink, AnAnswerThatComesLateIsNotTakenForTheNextOne) {
  const auto plc = open_plc(address_, kLink);
  plc->command(PlcCommand::home, 1);
  // The late answer is that to the first question; the repetition gets its own. Over RTU and MEWTOCOL nothing in the
  // frame tells the two apart.
  core_->plan_answers({.answers = 1, .delay = 90ms});
  EXPECT_EQ(plc->status().sequence_done, 1);
  EXPECT_EQ(plc->late_answers(), 1);
  for (std::uint16_t k = 2; k < 12; ++k) {
    plc->command(PlcCommand::move_to_pattern, k, k % 11);
    EXPECT_EQ(plc->status().sequence_done, k);
  }
  EXPECT_EQ(plc->late_answers(), 1);
}

TEST_P(PlcLink, ACommandWhoseAnswerWasLostIsRepeatedAndStartsOnce) {
  const auto plc = open_plc(address_, kLink);
  plc->command(PlcCommand::home, 1);
  core_->plan_answers({.answers = 1, .silent = true});
  plc->turn_mrad(0.1);
  EXPECT_EQ(core_->snapshot().adjuster_turns_mrad.size(), 1u);
  core_->plan_answers({.answers = 1, .silent = true});
  plc->command(PlcCommand::move_to_pattern, 2, 4);
  EXPECT_EQ(plc->status().sequence_done, 2);
  EXPECT_EQ(plc->late_answers(), 2);
}

TEST_P(PlcLink, ASilentPlcIsLostAfterTheAttemptsWithOperationAndCause) {
  const auto plc = open_plc(address_, kLink);
  core_->plan_answers({.answers = 1000, .silent = true});
  const auto start = std::chrono::steady_clock::now();
  try {
    plc->status();
    FAIL() << "a silent PLC answered";
  } catch (const PlcLost& e) {
    EXPECT_EQ(std::string(e.what()), "PLC at " + address_ +
                                         ": reading the status (DT0 to DT13) failed: no answer within 60 ms "
                                         "(2 attempts)");
  }
  // Two attempts, each of one limit and one limit of listening: 240 ms; a second more for a busy machine.
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1240ms);
  core_->plan_answers({});
  EXPECT_EQ(plc->status().map_version, 1) << "the link works again without opening it";
}

TEST_P(PlcLink, ARefusalIsAFaultInWordsAndNotRepeated) {
  const auto plc = open_plc(address_, kLink);
  const int before = core_->telegrams();
  core_->plan_answers({.answers = 1, .refusal = 6});
  try {
    plc->command(PlcCommand::home, 1);
    FAIL() << "the refusal was lost";
  } catch (const PlcFault& e) {
    EXPECT_THAT(e.what(), HasSubstr("PLC at " + address_ + ": homing was refused: "));
    EXPECT_THAT(e.what(), HasSubstr("busy"));
  }
  EXPECT_EQ(core_->telegrams(), before + 1);
  EXPECT_EQ(plc->status().sequence_done, 0) << "nothing was started";
}

TEST_P(PlcLink, AKilledPlcIsLostAndAfterItsRestartTheLinkOpensAgain) {
  const auto plc = open_plc(address_, kLink);
  plc->command(PlcCommand::home, 7);
  server_.reset();
  EXPECT_THROW(plc->status(), PlcLost);
  EXPECT_THROW(plc->reopen(), PlcLost);
  EXPECT_THROW(plc->status(), PlcLost) << "a closed link says so";
  core_ = std::make_unique<PlcCore>();  // its memory is gone with it
  serve();
  plc->reopen();
  EXPECT_EQ(plc->status().sequence_done, 0);
  plc->command(PlcCommand::home, 8);
  EXPECT_EQ(plc->status().sequence_done, 8);
}

TEST_P(PlcLink, NobodyAtTheAddressIsSaidAtOnce) {
  server_.reset();
  EXPECT_THROW(open_plc(address_, kLink), PlcLost);
}

TEST_P(PlcLink, AnswersNobodyReadsDoNotReachTheNextClient) {
  {
    const auto plc = open_plc(address_, {.answer_limit = 10ms, .attempts = 1});
    core_->plan_answers({.answers = 1, .delay = 40ms});
    EXPECT_THROW(plc->status(), PlcLost);
  }
  std::this_thread::sleep_for(60ms);
  const auto plc = open_plc(address_, kLink);
  plc->command(PlcCommand::home, 3);
  EXPECT_EQ(plc->status().sequence_done, 3);
  EXPECT_EQ(plc->late_answers(), 0);
}

/// Real time, with a look-in whenever somebody waits.
class HookedClock : public SystemClock {
 public:
  void sleep_for(std::chrono::microseconds duration) override {
    if (hook) hook();
    SystemClock::sleep_for(duration);
  }
  std::function<void()> hook;
};

TEST_P(PlcLink, ACaptureSurvivesThePlcsRestartInTheMiddleOfAMove) {
  const virt::PlcCoreOptions moving{.patterns = 5, .per_pattern = 15ms, .homing = 10ms};
  server_.reset();
  core_ = std::make_unique<PlcCore>(moving);
  serve();
  const auto plc = open_plc(address_, kLink);
  test::FakeCamera camera(*core_);
  HookedClock clock;
  CaptureOptions options;
  options.folder = folder_ / "stack";
  options.plan.x = FringeCode{.gray_bits = 1, .phase_steps = 4};
  options.plan.patterns.push_back({.kind = PatternKind::gray});
  for (int k = 0; k < 4; ++k) options.plan.patterns.push_back({.kind = PatternKind::phase, .index = k});
  options.exposure_ms = 1.5;
  options.reopen_pause = 40ms;
  int waits_without_plc = 0;
  bool killed = false;
  // The move in question does not end before it is seen, however busy this computer is.
  camera.on_trigger = [&](int trigger) {
    if (trigger == 2) core_->set_stage_fault(virt::StageFault::never_reaches);
  };
  clock.hook = [&] {
    if (!killed && camera.triggers == 2 && !core_->snapshot().settled) {
      killed = true;
      server_.reset();
    } else if (killed && !server_ && ++waits_without_plc > 4) {
      core_ = std::make_unique<PlcCore>(moving);  // neither homed nor lit
      camera.use(*core_);
      serve();
    }
  };
  CaptureSequence sequence(camera, *plc, clock, options);
  const CaptureReport report = sequence.run();
  EXPECT_TRUE(killed);
  EXPECT_EQ(report.plc_reopened, 1);
  EXPECT_GE(report.events.size(), 1u);
  EXPECT_THAT(camera.taken, testing::ElementsAre(0, 1, 2, 3, 4)) << "no finished frame again";
  const PlcStatus end = plc->status();
  EXPECT_FALSE(end.lamp_on);
  EXPECT_EQ(end.position_um, 0);
  EXPECT_EQ(read_capture(options.folder).frames.size(), 5u);
}

TEST_P(PlcLink, ACaptureSurvivesLateAndLostAnswers) {
  const auto plc = open_plc(address_, kLink);
  test::FakeCamera camera(*core_);
  SystemClock clock;
  CaptureOptions options;
  options.folder = folder_ / "stack";
  options.plan.x = FringeCode{.gray_bits = 0, .phase_steps = 3};
  for (int k = 0; k < 3; ++k) options.plan.patterns.push_back({.kind = PatternKind::phase, .index = k});
  options.exposure_ms = 1.5;
  camera.on_trigger = [&](int trigger) {
    if (trigger == 1) core_->plan_answers({.answers = 1, .delay = 90ms});
    if (trigger == 2) core_->plan_answers({.answers = 1, .silent = true});
  };
  CaptureSequence sequence(camera, *plc, clock, options);
  const CaptureReport report = sequence.run();
  EXPECT_EQ(plc->late_answers(), 2);
  EXPECT_EQ(report.plc_reopened, 0);
  EXPECT_THAT(camera.taken, testing::ElementsAre(0, 1, 2));
}

TEST(ModbusTcp, TwoClientsAreServedAtOnce) {
  PlcCore core;
  const auto server = virt::serve_modbus_tcp(core);
  const std::string address = "modbus-tcp://127.0.0.1:" + std::to_string(server->port());
  const auto one = open_plc(address, kLink), two = open_plc(address, kLink);
  one->command(PlcCommand::home, 5);
  EXPECT_EQ(two->status().sequence_done, 5);
}

TEST(ModbusTcp, ServersStandSideBySideAndATakenPortIsSaid) {
  PlcCore core;
  const auto one = virt::serve_modbus_tcp(core), two = virt::serve_modbus_tcp(core);
  EXPECT_NE(one->port(), two->port());
  try {
    virt::serve_modbus_tcp(core, "127.0.0.1", one->port());
    FAIL() << "two servers on one port";
  } catch (const EnvironmentError& e) {
    EXPECT_THAT(e.what(), HasSubstr("127.0.0.1:" + std::to_string(one->port()) + ": binding failed"));
  }
}

// Reference: the CRC of 01 04 02 FF FF is B8 80 on the wire (Modbus over Serial Line, worked example of the
// literature).
TEST(ModbusRtu, TheCheckSumIsThatOfTheSpecification) {
  EXPECT_EQ(virt::modbus_crc(std::string_view("\x01\x04\x02\xFF\xFF", 5)), 0x80B8);
}

TEST(MewtocolPlc, ReadsAndWritesContacts) {
  PlcCore core;
  const auto server = virt::serve_mewtocol(core);
  MewtocolPlc plc(parse_plc_address("mewtocol:" + server->device()), kLink);
  EXPECT_TRUE(plc.read_contact("X0000"));
  plc.write_contact("Y0000", true);
  EXPECT_TRUE(plc.status().lamp_on);
  EXPECT_THROW(plc.write_contact("X0000", true), PlcFault);
}

TEST(MewtocolPlc, AnotherStationOnTheLineDoesNotAnswer) {
  PlcCore core;
  const auto server = virt::serve_mewtocol(core, 2);
  MewtocolPlc plc(parse_plc_address("mewtocol:" + server->device() + "?station=1"),
                  {.answer_limit = 20ms, .attempts = 1});
  EXPECT_THROW(plc.status(), PlcLost);
  MewtocolPlc right(parse_plc_address("mewtocol:" + server->device() + "?station=2"), kLink);
  EXPECT_EQ(right.status().map_version, 1);
}

TEST(MewtocolPlc, ADamagedAnswerIsAskedForAgain) {
  PlcCore core;
  int answers = 0;
  const auto server = ByteServer::on_pty("", [&](std::string& received) -> std::optional<ByteServer::Answer> {
    const auto end = received.find('\r');
    if (end == std::string::npos) return std::nullopt;
    const mewtocol::Frame command = mewtocol::decode(received.substr(0, end + 1));
    received.erase(0, end + 1);
    const std::string text = virt::answer_mewtocol(core, command.text).substr(1);
    std::string bytes = mewtocol::encode({1, mewtocol::FrameKind::answer, text});
    if (++answers == 1) bytes[8] ^= 0x04;
    return ByteServer::Answer{bytes, 0ms};
  });
  MewtocolPlc plc(parse_plc_address("mewtocol:" + server->device()), kLink);
  EXPECT_EQ(plc.status().map_version, 1);
  EXPECT_EQ(plc.late_answers(), 1);
}

}  // namespace
}  // namespace fringecal::hw

// The virtual PLC's behaviour, on a clock that jumps: every figure below is exact.
#include "hw/virtual/plc_core.h"

#include "tests/hw/support.h"

#include <gtest/gtest.h>

namespace fringecal::hw {
namespace {

using namespace std::chrono_literals;
using test::CorePlc;
using test::FakeClock;
using virt::PlcCore;
using virt::StageFault;

struct Bench {
  FakeClock clock;
  PlcCore core{{.per_pattern = 100ms, .homing = 300ms, .watchdog = 2000ms, .motion_limit = 5000ms}, clock};
  CorePlc plc{core};

  PlcStatus after(std::chrono::milliseconds time) {
    for (; time > 0ms; time -= 10ms) {
      plc.feed_watchdog();
      clock.sleep_for(10ms);
    }
    return plc.status();
  }
  void home() {
    plc.command(PlcCommand::home, 1);
    ASSERT_EQ(after(300ms).sequence_done, 1);
  }
};

TEST(VirtualPlc, HomingEndsIdleAndEchoesItsSequence) {
  Bench b;
  b.plc.command(PlcCommand::home, 41);
  EXPECT_EQ(b.plc.status().state, PlcState::homing);
  EXPECT_EQ(b.after(290ms).sequence_done, 0);
  EXPECT_EQ(b.after(10ms).sequence_done, 41);
  EXPECT_EQ(b.plc.status().state, PlcState::idle);
}

TEST(VirtualPlc, AMoveTakesItsTimeAndTheEchoComesWithThePosition) {
  Bench b;
  b.home();
  // From 0 to 20 mm + 3 * 12 mm = 56 mm at 12 mm per 100 ms: 467 ms (rounded to whole milliseconds).
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  EXPECT_FALSE(b.core.snapshot().settled);
  const PlcStatus halfway = b.after(230ms);
  EXPECT_EQ(halfway.state, PlcState::moving);
  EXPECT_EQ(halfway.position_um, 27580);  // 56000 * 230 / 467 = 27580.3
  EXPECT_EQ(halfway.sequence_done, 1);
  const PlcStatus there = b.after(240ms);
  EXPECT_EQ(there.state, PlcState::in_position);
  EXPECT_EQ(there.position_um, 56000);
  EXPECT_EQ(there.sequence_done, 2);
  EXPECT_EQ(b.core.snapshot().pattern, 3);
  EXPECT_TRUE(b.core.snapshot().settled);
}

TEST(VirtualPlc, TheSameSequenceAgainStartsNothing) {
  Bench b;
  b.home();
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  b.after(1000ms);
  b.plc.command(PlcCommand::move_to_pattern, 2, 7);
  EXPECT_EQ(b.after(2000ms).position_um, 56000);
}

TEST(VirtualPlc, RefusesToMoveBeforeHoming) {
  Bench b;
  b.plc.command(PlcCommand::move_to_pattern, 1, 0);
  const PlcStatus s = b.plc.status();
  EXPECT_EQ(s.state, PlcState::fault);
  EXPECT_EQ(s.fault_code, static_cast<std::uint16_t>(PlcFaultCode::not_homed));
  EXPECT_EQ(s.sequence_done, 0);
}

TEST(VirtualPlc, RefusesAPatternThatIsNotOnTheGratingAndACommandItDoesNotKnow) {
  Bench b;
  b.home();
  b.plc.command(PlcCommand::move_to_pattern, 2, 11);
  EXPECT_EQ(b.plc.status().fault_code, static_cast<std::uint16_t>(PlcFaultCode::no_such_pattern));
  b.plc.command(PlcCommand::clear_fault, 3);
  EXPECT_EQ(b.plc.status().state, PlcState::idle);
  b.plc.command(static_cast<PlcCommand>(9), 4);
  EXPECT_EQ(b.plc.status().fault_code, static_cast<std::uint16_t>(PlcFaultCode::no_such_command));
}

TEST(VirtualPlc, AJamIsNoticedHalfWayAndSwitchesTheLampOff) {
  Bench b;
  b.home();
  b.plc.set_lamp(true);
  b.core.set_stage_fault(StageFault::jam);
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  EXPECT_EQ(b.after(430ms).state, PlcState::moving);  // half of 467 ms, and 200 ms of detection
  const PlcStatus s = b.after(10ms);
  EXPECT_EQ(s.state, PlcState::fault);
  EXPECT_EQ(s.fault_code, static_cast<std::uint16_t>(PlcFaultCode::jam));
  EXPECT_EQ(s.position_um, 28000);
  EXPECT_FALSE(s.lamp_on);
}

TEST(VirtualPlc, AStageThatNeverReachesItsPositionIsAFaultAfterThePlcsLimit) {
  Bench b;
  b.home();
  b.core.set_stage_fault(StageFault::never_reaches);
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  EXPECT_EQ(b.after(4990ms).state, PlcState::moving);
  EXPECT_EQ(b.after(10ms).fault_code, static_cast<std::uint16_t>(PlcFaultCode::position_not_reached));
}

TEST(VirtualPlc, TheDoorStopsMotionAndLampAndMustBeClosedBeforeTheFaultIsCleared) {
  Bench b;
  b.home();
  b.plc.set_lamp(true);
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  b.after(200ms);
  b.core.set_door(false);
  const PlcStatus open = b.after(1000ms);
  EXPECT_EQ(open.fault_code, static_cast<std::uint16_t>(PlcFaultCode::door_open));
  EXPECT_FALSE(open.door_closed);
  EXPECT_FALSE(open.lamp_on);
  EXPECT_EQ(open.position_um, 23983);  // 56000 * 200 / 467 = 23982.9: it stopped where it was
  b.plc.command(PlcCommand::clear_fault, 3);
  EXPECT_EQ(b.plc.status().state, PlcState::fault);
  b.core.set_door(true);
  b.plc.command(PlcCommand::clear_fault, 4);
  EXPECT_EQ(b.plc.status().state, PlcState::idle);
  b.plc.set_lamp(true);
  EXPECT_TRUE(b.plc.status().lamp_on);
}

TEST(VirtualPlc, AHungryWatchdogStopsLampAndMotionAfterItsLimit) {
  Bench b;
  b.home();
  b.plc.set_lamp(true);
  b.plc.feed_watchdog();
  b.clock.sleep_for(1999ms);
  EXPECT_TRUE(b.plc.status().lamp_on);
  b.clock.sleep_for(1ms);
  const PlcStatus s = b.plc.status();
  EXPECT_FALSE(s.lamp_on);
  EXPECT_EQ(s.fault_code, static_cast<std::uint16_t>(PlcFaultCode::watchdog));
}

TEST(VirtualPlc, TheWatchdogSleepsWhileNothingMovesAndTheLampIsOff) {
  Bench b;
  b.home();
  b.clock.sleep_for(1h);
  EXPECT_EQ(b.plc.status().state, PlcState::idle);
  b.plc.set_lamp(true);
  b.clock.sleep_for(1s);
  EXPECT_TRUE(b.plc.status().lamp_on) << "the limit counts from the lamp's switching on";
}

TEST(VirtualPlc, AMotionThatEndedBeforeTheWatchdogsLimitIsNoFaultHoweverLateOneAsks) {
  Bench b;
  b.home();
  b.plc.command(PlcCommand::move_to_pattern, 2, 3);
  b.clock.sleep_for(1h);
  EXPECT_EQ(b.plc.status().state, PlcState::in_position);
}

TEST(VirtualPlc, HandsTurnsAndSelectionToTheCamera) {
  Bench b;
  b.plc.turn_mrad(-0.798123);
  b.plc.turn_mrad(0.25);
  b.plc.select({.scene = 1, .pose = 14, .stack_seed = 0x123456789ABCDEF0, .warm_up_min = 25});
  const auto seen = b.core.snapshot();
  ASSERT_EQ(seen.adjuster_turns_mrad.size(), 2u);
  EXPECT_DOUBLE_EQ(seen.adjuster_turns_mrad[0], -0.798123);  // a whole number of nrad
  EXPECT_DOUBLE_EQ(seen.adjuster_turns_mrad[1], 0.25);
  EXPECT_EQ(seen.scene_name, "calibration 14");
  EXPECT_EQ(seen.selection.stack_seed, 0x123456789ABCDEF0u);
  // 20 degC + 1.5 K (1 - 1/e) = 20.948 degC after one time constant of 25 min, in steps of 0.01 degC.
  EXPECT_NEAR(b.plc.status().temperature_degC, 20.95, 1e-9);
  std::array<std::uint16_t, 2> total{};
  ASSERT_TRUE(b.core.read(dt::kAdjusterTotal, total));
  EXPECT_EQ(int32_from(total[0], total[1]), -548123);
}

}  // namespace
}  // namespace fringecal::hw

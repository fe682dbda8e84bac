// The capture sequence against the virtual PLC's core and a camera without a sensor, on a clock that jumps: every fault
// with its exact outcome. Whatever happens, the lamp is off afterwards and the stage parked, or the message says why
// not.
#include "hw/capture_sequence.h"

#include "core/capture.h"
#include "core/error.h"
#include "hw/plc_map.h"
#include "tests/hw/support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <fstream>

namespace fringecal::hw {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;
using virt::PlcCore;
using virt::PlcCoreOptions;
using virt::StageFault;
namespace fs = std::filesystem;

PatternPlan small_plan() {
  PatternPlan plan;
  plan.x = FringeCode{.gray_bits = 2, .phase_steps = 4};
  for (int k = 0; k < 2; ++k) plan.patterns.push_back({.kind = PatternKind::gray, .index = k});
  for (int k = 0; k < 4; ++k) plan.patterns.push_back({.kind = PatternKind::phase, .index = k});
  return plan;
}

constexpr PlcCoreOptions kMoving{
    .patterns = 6, .per_pattern = 50ms, .homing = 200ms, .watchdog = 1000ms, .motion_limit = 60s};

struct Bench {
  explicit Bench(PlcCoreOptions plc_options = kMoving)
      : core_options(plc_options), core(std::make_unique<PlcCore>(plc_options, clock)), plc(*core), camera(*core) {
    options.folder = temporary / "stack";
    options.plan = small_plan();
    options.source = "bench";
    options.exposure_ms = 1.5;
  }

  /// The message of the run that must fail.
  template <class Error = EnvironmentError>
  std::string failure(const std::stop_token& stop = {}) {
    CaptureSequence sequence(camera, plc, clock, options);
    try {
      sequence.run(stop);
    } catch (const Error& e) {
      report = sequence.report();
      return e.what();
    }
    ADD_FAILURE() << "the run did not fail as expected";
    return "";
  }
  CaptureReport run() {
    CaptureSequence sequence(camera, plc, clock, options);
    return report = sequence.run();
  }

  void expect_safe() {
    std::array<std::uint16_t, dt::kStatusWords> w{};
    ASSERT_TRUE(core->read(0, w));
    EXPECT_EQ(w[dt::kLampOn], 0) << "the lamp is on";
    EXPECT_EQ(int32_from(w[dt::kPosition], w[dt::kPosition + 1]), 0) << "the stage is not parked";
    EXPECT_EQ(w[dt::kState], 0);
  }
  fs::path partial() const { return temporary / "stack.partial"; }
  int partial_frames() const {
    int n = 0;
    for (const auto& entry : fs::directory_iterator(partial())) n += entry.path().extension() == ".png";
    return n;
  }

  test::TemporaryFolder temporary{test::memory_folder()};
  test::FakeClock clock;
  PlcCoreOptions core_options;
  std::unique_ptr<PlcCore> core;
  test::CorePlc plc;
  test::FakeCamera camera;
  CaptureOptions options;
  CaptureReport report;
};

TEST(CaptureSequence, TakesEveryPatternOnceAndLeavesLampOffAndStageParked) {
  Bench b;
  const CaptureReport report = b.run();
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5));
  EXPECT_EQ(report.frames_taken, 6);
  EXPECT_EQ(report.retakes, 0);
  EXPECT_TRUE(report.events.empty());
  b.expect_safe();
  EXPECT_FALSE(fs::exists(b.partial()));
  const Capture capture = read_capture(b.options.folder);
  EXPECT_EQ(capture.info.plan.patterns, b.options.plan.patterns);
  EXPECT_EQ(capture.info.exposure_ms, 1.5);
  EXPECT_EQ(capture.info.devices.at("camera"), "Acme Eye 7");
  EXPECT_THAT(capture.info.devices.at("plc"), HasSubstr("register map 1"));
  EXPECT_DOUBLE_EQ(capture.info.temperatures_degC.at("grating"), 21.5);
  for (int k = 0; k < 6; ++k) {
    EXPECT_EQ(std::get<Image8>(capture.frames[static_cast<std::size_t>(k)])(0, 0), 150 + k);
  }
}

TEST(CaptureSequence, FindsTheExposureFromTestFrames) {
  Bench b;
  b.options.exposure_ms.reset();
  b.camera.set_exposure_ms(50);  // 5000 grey levels: saturated
  const CaptureReport report = b.run();
  const Capture capture = read_capture(b.options.folder);
  ASSERT_EQ(report.exposures_ms.size(), 1u);
  for (const GrayImage& frame : capture.frames) {
    EXPECT_LT(bright_level(frame), 255);
    EXPECT_GE(bright_level(frame), 198);  // 0.78 of 255
  }
  EXPECT_EQ(report.saturated_part, 0);
}

TEST(CaptureSequence, TwoExposuresAreMergedPixelByPixel) {
  Bench b;
  b.options.exposure_ms = 2.0;
  b.options.hdr_ratio = 8;
  const CaptureReport report = b.run();
  EXPECT_THAT(report.exposures_ms, ElementsAre(2.0, 16.0));
  EXPECT_EQ(report.frames_taken, 12);
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5));
  const Capture capture = read_capture(b.options.folder);
  ASSERT_EQ(capture.frames.size(), 6u);
  // Left half: 200 grey levels short, 1600 (saturated) long. Right half, halved in pattern 3: 10 short, 80 long, and
  // the modulation is eight times as large there.
  EXPECT_EQ(std::get<Image8>(capture.frames[3])(0, 0), 203);
  EXPECT_EQ(std::get<Image8>(capture.frames[3])(7, 0), 83);
  EXPECT_FALSE(fs::exists(b.partial()));
}

TEST(CaptureSequence, ALostFrameIsTakenAgainAndCounted) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger == 2 || trigger == 3 || trigger == 6) throw FrameLost("3 of 12 packets are missing");
  };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.retakes, 3);
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5));
  ASSERT_EQ(report.events.size(), 3u);
  EXPECT_EQ(report.events[0], "camera: taking pattern 1 ('gray 1'): 3 of 12 packets are missing");
}

TEST(CaptureSequence, LossesWithoutEndStopTheRunAfterTheAttemptsAndTheFramesAreKept) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger > 2) throw FrameLost("no frame within 2002 ms");
  };
  const std::string message = b.failure();
  EXPECT_EQ(message,
            "camera Acme Eye 7: taking pattern 2 ('phase 0') failed 4 times: no frame within 2002 ms; check "
            "cable, light and network load; 2 of 6 frames are kept in " +
                b.partial().string() + ", the same command continues there");
  EXPECT_EQ(b.camera.triggers, 6);  // two good ones and four attempts
  EXPECT_EQ(b.report.retakes, 3);
  EXPECT_EQ(b.partial_frames(), 2);
  b.expect_safe();
}

TEST(CaptureSequence, AFrameThatCameBeforeIsNotTakenForTheNextOne) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) { b.camera.repeat_id = trigger == 4; };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.retakes, 1);
  EXPECT_THAT(report.events.at(0), HasSubstr("came twice"));
}

TEST(CaptureSequence, AFrameUnderADarkLampDoesNotCount) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 3) b.core->write_contact("Y0000", false);
  };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.retakes, 1);
  EXPECT_THAT(report.events.at(0), HasSubstr("the lamp was off"));
  const Capture capture = read_capture(b.options.folder);
  EXPECT_EQ(std::get<Image8>(capture.frames[2])(0, 0), 152);
}

TEST(CaptureSequence, ALostCameraIsOpenedAgainAndGetsItsExposureBack) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger == 3) throw CameraLost("no answer");
  };
  b.camera.on_reopen = [&] { b.camera.set_exposure_ms(40); };  // its default after power-on
  const CaptureReport report = b.run();
  EXPECT_EQ(report.camera_reopened, 1);
  EXPECT_EQ(std::get<Image8>(read_capture(b.options.folder).frames[2])(0, 0), 152);
  b.expect_safe();
}

TEST(CaptureSequence, ACameraThatStaysAwayStopsTheRunWithDeviceOperationAndCause) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger > 3) throw CameraLost("192.168.1.20 does not answer");
  };
  b.camera.on_reopen = [] { throw CameraLost("192.168.1.20 does not answer"); };
  const std::string message = b.failure();
  EXPECT_THAT(message,
              HasSubstr("camera Acme Eye 7: taking pattern 3 ('phase 1') failed, and opening it again failed 5 "
                        "times: 192.168.1.20 does not answer; 3 of 6 frames are kept"));
  EXPECT_EQ(b.camera.reopened, 5);
  b.expect_safe();
}

TEST(CaptureSequence, ResumingTakesOnlyWhatIsMissing) {
  Bench b;
  b.options.exposure_ms.reset();
  b.camera.on_trigger = [](int trigger) {
    if (trigger > 7) throw CameraLost("gone");
  };
  b.camera.on_reopen = [] { throw CameraLost("gone"); };
  b.failure();
  const int kept = b.partial_frames();
  ASSERT_GT(kept, 0);
  ASSERT_LT(kept, 6);
  std::vector<int> missing;
  for (int k = kept; k < 6; ++k) missing.push_back(k);
  test::FakeCamera second(*b.core);
  CaptureSequence again(second, b.plc, b.clock, b.options);
  const CaptureReport report = again.run();
  EXPECT_EQ(report.frames_resumed, kept);
  EXPECT_EQ(second.taken, missing) << "the exposure is known, and no finished frame is taken again";
  EXPECT_EQ(read_capture(b.options.folder).frames.size(), 6u);
  EXPECT_FALSE(fs::exists(b.partial()));
}

TEST(CaptureSequence, ADamagedFrameOfAnEarlierRunIsTakenAgainAndOnlyThat) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger > 4) throw FrameLost("dark");
  };
  b.failure();
  std::ofstream(b.partial() / frame_file_name(1, b.options.plan.patterns[1])) << "half a fi";
  test::FakeCamera second(*b.core);
  CaptureSequence(second, b.plc, b.clock, b.options).run();
  EXPECT_THAT(second.taken, ElementsAre(1, 4, 5));
}

TEST(CaptureSequence, FramesOfAnotherCaptureAreNotMixedIn) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger > 2) throw FrameLost("dark");
  };
  b.failure();
  b.camera.on_trigger = nullptr;
  b.options.exposure_ms = 2.0;
  EXPECT_THAT(b.failure<InputError>(), HasSubstr("were exposed for 1.5 ms, now 2 ms are asked for"));
  b.options.exposure_ms = 1.5;
  b.options.source = "another object";
  EXPECT_THAT(b.failure<InputError>(), HasSubstr("another plan, camera, source"));
  EXPECT_EQ(b.partial_frames(), 2) << "nothing was touched";
}

TEST(CaptureSequence, AForeignFolderIsRefusedBeforeAnythingMoves) {
  Bench b;
  fs::create_directories(b.options.folder);
  std::ofstream(b.options.folder / "thesis.tex") << "x";
  EXPECT_THAT(b.failure<InputError>(), HasSubstr("not a capture"));
  EXPECT_EQ(b.camera.triggers, 0);
}

TEST(CaptureSequence, AFullDiskStopsTheRunWithLampOffAndStageParked) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger != 3) return;
    // A folder in the place of the next frame: writing it fails as it does on a full disk.
    fs::create_directories(b.partial() / frame_file_name(2, b.options.plan.patterns[2]) / "x");
  };
  EXPECT_THAT(b.failure(), HasSubstr("cannot be written"));
  b.expect_safe();
}

TEST(CaptureSequence, AStopRequestEndsTheRunSafelyInTheMiddleOfAMove) {
  Bench b;
  std::stop_source source;
  int reads = 0;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 2)
      b.plc.on_read = [&] {
        if (++reads == 8) source.request_stop();
      };
  };
  const std::string message = b.failure<CaptureStopped>(source.get_token());
  EXPECT_THAT(message, HasSubstr("the capture was stopped; 2 of 6 frames are kept in"));
  EXPECT_EQ(b.camera.triggers, 2);
  b.expect_safe();
  b.plc.on_read = nullptr;
  EXPECT_EQ(b.run().frames_resumed, 2);
}

TEST(CaptureSequence, AnUnexpectedExceptionAlsoSwitchesOffAndParks) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger == 3) throw std::bad_alloc();
  };
  CaptureSequence sequence(b.camera, b.plc, b.clock, b.options);
  EXPECT_THROW(sequence.run(), std::bad_alloc);
  b.expect_safe();
}

TEST(CaptureSequence, AJamStopsAtOnceWithTheFaultInWordsAndTheStageStaysWhereItIs) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 2) b.core->set_stage_fault(StageFault::jam);
  };
  const std::string message = b.failure();
  EXPECT_THAT(message, HasSubstr("moving to pattern 2 ('phase 0') failed: fault 1 (the drive is on and the stage does "
                                 "not move (jam))"));
  EXPECT_THAT(message, HasSubstr("the stage is not parked"));
  EXPECT_THAT(message, HasSubstr("2 of 6 frames are kept"));
  EXPECT_FALSE(b.core->snapshot().lamp_on);
  EXPECT_EQ(b.plc.status().state, PlcState::fault);
  EXPECT_EQ(b.plc.status().position_um, 38000);  // half-way between 32 and 44 mm
}

TEST(CaptureSequence, AStageThatNeverReachesItsPositionIsGivenUpAfterTheLimit) {
  Bench b;
  b.options.motion_limit = 3s;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 2) b.core->set_stage_fault(StageFault::never_reaches);
  };
  const auto start = b.clock.now();
  const std::string message = b.failure();
  EXPECT_THAT(message,
              HasSubstr("moving to pattern 2 ('phase 0') failed: not finished within 3000 ms (state 1, sequence "));
  // The park does not arrive either: two limits, and the second or so of good moves before.
  EXPECT_LT(b.clock.now() - start, 8s);
  EXPECT_THAT(message, HasSubstr("the stage is not parked"));
  EXPECT_FALSE(b.core->snapshot().lamp_on);
}

TEST(CaptureSequence, InPositionWithoutTheEchoIsThePositionOfAnEarlierCommand) {
  Bench b;
  b.options.motion_limit = 1s;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 2) b.core->set_stage_fault(StageFault::no_echo);
  };
  EXPECT_THAT(b.failure(), HasSubstr("not finished within 1000 ms (state 2, sequence 3 instead of 4"));
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1)) << "no frame without the echo";
}

TEST(CaptureSequence, AnOpenDoorStopsTheRunAndAClosedOneLetsItContinue) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 4) b.core->set_door(false);
  };
  EXPECT_THAT(b.failure(), HasSubstr("fault 3 (the door was opened)"));
  EXPECT_EQ(b.partial_frames(), 3) << "the frame during which it opened does not count";
  EXPECT_FALSE(b.core->snapshot().lamp_on);
  EXPECT_THAT(b.failure(), HasSubstr("the door is open; close it"));
  b.core->set_door(true);
  b.camera.taken.clear();
  const CaptureReport report = b.run();
  EXPECT_THAT(b.camera.taken, ElementsAre(3, 4, 5));
  EXPECT_EQ(report.frames_resumed, 3);
  b.expect_safe();
}

TEST(CaptureSequence, AWatchdogThatBitDuringAStallStopsTheRun) {
  Bench b;
  b.camera.on_trigger = [&](int trigger) {
    if (trigger == 4) b.clock.sleep_for(1500ms);  // the machine was asleep
  };
  EXPECT_THAT(b.failure(), HasSubstr("fault 4 (the watchdog was not fed in time)"));
  EXPECT_EQ(b.partial_frames(), 3);
  EXPECT_EQ(b.run().frames_taken, 3) << "the next run clears the fault and continues";
  b.expect_safe();
}

TEST(CaptureSequence, TheWatchdogIsFedDuringLongMoves) {
  PlcCoreOptions slow = kMoving;
  slow.per_pattern = 3s;  // three times the watchdog's limit
  Bench b(slow);
  b.options.motion_limit = 60s;
  EXPECT_EQ(b.run().frames_taken, 6);
  b.expect_safe();
}

TEST(CaptureSequence, APlcKilledInTheMiddleOfAMoveIsHomedAndLitAgainAfterItsRestart) {
  Bench b;
  bool dead = false;
  int moves = 0, refusals = 0;
  std::unique_ptr<PlcCore> old;
  b.plc.on_write = [&](std::uint16_t first, std::span<const std::uint16_t>) {
    if (dead) throw PlcLost("connection refused");
    if (first == dt::kTargetPattern && ++moves == 5) dead = true;  // home and three moves went before
  };
  b.plc.on_read = [&] {
    if (dead) throw PlcLost("connection reset");
  };
  b.plc.on_reopen = [&] {
    if (++refusals < 3) throw PlcLost("connection refused");
    dead = false;
    // A new process: not homed, lamp off, sequence 0. The camera looks at the same instrument.
    old = std::make_unique<PlcCore>(b.core_options, b.clock);
    old.swap(b.core);
    b.plc.use(*b.core);
    b.camera.use(*b.core);
  };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.plc_reopened, 1);
  EXPECT_EQ(refusals, 3);
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5)) << "no finished frame again";
  b.expect_safe();
}

TEST(CaptureSequence, APlcThatRestartedBetweenTwoFramesIsNoticedByItsFault) {
  Bench b;
  std::unique_ptr<PlcCore> old;
  int moves = 0;
  b.plc.on_write = [&](std::uint16_t first, std::span<const std::uint16_t>) {
    if (first == dt::kTargetPattern && ++moves == 4) {
      old = std::make_unique<PlcCore>(b.core_options, b.clock);
      old.swap(b.core);
      b.plc.use(*b.core);
      b.camera.use(*b.core);
    }
  };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.plc_reopened, 1);
  EXPECT_THAT(report.events.at(0), HasSubstr("it has been restarted (it is no longer homed)"));
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5));
  b.expect_safe();
}

TEST(CaptureSequence, APlcThatRestartsDuringAMoveIsNoticedByItsSequence) {
  Bench b;
  std::unique_ptr<PlcCore> old;
  int moves = 0;
  b.plc.on_write = [&](std::uint16_t first, std::span<const std::uint16_t>) {
    if (first == dt::kTargetPattern) ++moves;
  };
  b.plc.on_read = [&] {
    if (moves != 4 || old) return;
    old = std::make_unique<PlcCore>(b.core_options, b.clock);
    old.swap(b.core);
    b.plc.use(*b.core);
    b.camera.use(*b.core);
  };
  const CaptureReport report = b.run();
  EXPECT_EQ(report.plc_reopened, 1);
  EXPECT_THAT(report.events.at(0), HasSubstr("it has been restarted (the echoed sequence went from 3 to 0)"));
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5));
  b.expect_safe();
}

TEST(CaptureSequence, ACameraThatTakesLongToOpenStarvesTheWatchdogAndIsForgiven) {
  Bench b;
  b.camera.on_trigger = [](int trigger) {
    if (trigger == 3) throw CameraLost("no answer");
  };
  b.camera.on_reopen = [&] { b.clock.sleep_for(4s); };  // the watchdog's limit is 1 s
  EXPECT_EQ(b.run().frames_taken, 6);
  EXPECT_THAT(b.camera.taken, ElementsAre(0, 1, 2, 3, 4, 5));
  b.expect_safe();
}

TEST(CaptureSequence, APlcThatStaysAwayStopsTheRunAndTheMessageNamesTheWatchdog) {
  Bench b;
  bool dead = false;
  b.plc.on_read = [&] {
    if (dead) throw PlcLost("no answer within 500 ms");
  };
  b.plc.on_write = [&](auto, auto) {
    if (dead) throw PlcLost("no answer within 500 ms");
  };
  b.plc.on_reopen = [] { throw PlcLost("PLC under test: opening the link failed: no route to host"); };
  b.camera.on_trigger = [&](int trigger) { dead = trigger == 3; };
  const std::string message = b.failure();
  EXPECT_THAT(message, HasSubstr("PLC under test: opening the link failed: no route to host (while taking pattern 2 "
                                 "('phase 0'); opened again 5 times)"));
  EXPECT_THAT(message, HasSubstr("the PLC's watchdog stops both"));
  EXPECT_THAT(message, HasSubstr("2 of 6 frames are kept"));
  EXPECT_FALSE(b.core->snapshot().lamp_on) << "the watchdog did";
}

TEST(CaptureSequence, ARefusalOfThePlcStopsTheRunWithOperationAndCause) {
  Bench b;
  int moves = 0;
  b.plc.on_write = [&](std::uint16_t first, std::span<const std::uint16_t>) {
    if (first == dt::kTargetPattern && ++moves == 3) throw PlcFault("Modbus exception 4 (device failure)");
  };
  EXPECT_THAT(b.failure(), HasSubstr("PLC under test: moving to pattern 1 was refused: Modbus exception 4 (device "
                                     "failure) (while taking pattern 1 ('gray 1'))"));
  b.expect_safe();
}

}  // namespace
}  // namespace fringecal::hw

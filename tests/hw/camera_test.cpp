// The Aravis client against Aravis's own device, over UDP on loopback: what a run on a machine does, without the
// machine.
#include "core/error.h"
#include "core/file.h"
#include "hw/aravis_camera.h"
#include "hw/virtual/fake_camera.h"
#include "tests/support/program.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <map>
#include <thread>

namespace {

using namespace fringecal;
using namespace std::chrono_literals;
using hw::AravisCamera;

constexpr int kWidth = 640, kHeight = 480;

/// A picture that differs in every pixel's neighbourhood, from frame to frame and with the exposure.
GrayImage picture(int number, double exposure_ms, int bits) {
  const auto value = [&](int x, int y) {
    return static_cast<unsigned>((x * 7 + y * 13 + number * 101 + static_cast<int>(exposure_ms)) % (1 << bits));
  };
  if (bits == 8) {
    Image8 out(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) out(x, y) = static_cast<std::uint8_t>(value(x, y));
    return out;
  }
  Image16 out(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) out(x, y) = static_cast<std::uint16_t>(value(x, y));
  return out;
}

std::string hash(const GrayImage& image) {
  return std::visit(
      [](const auto& i) {
        return sha256_hex({reinterpret_cast<const char*>(i.data()), i.size() * sizeof(i.values()[0])});
      },
      image);
}

struct Fixture {
  std::atomic<int> rendered = 0;
  std::atomic<int> delay_ms = 0;  // of the next frame only
  std::unique_ptr<virt::FakeCamera> device;

  explicit Fixture(virt::FakeCameraOptions options = {}) {
    options.width_px = kWidth;
    options.height_px = kHeight;
    const int bits = options.bits;
    device = std::make_unique<virt::FakeCamera>(options, [this, bits](double exposure_ms) {
      std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms.exchange(0)));
      return picture(rendered++, exposure_ms, bits);
    });
  }
};

/// Frames that the socket may lose on a busy machine are taken again, as the capture sequence does.
hw::CameraFrame take(hw::Camera& camera, std::chrono::milliseconds limit = 2000ms) {
  for (int attempt = 0;; ++attempt) {
    try {
      return camera.take_frame(limit);
    } catch (const hw::FrameLost&) {
      if (attempt == 20) throw;
    }
  }
}

TEST(AravisCamera, GivesEveryByteOf200FramesAsTheDeviceSentThem) {
  const test::TemporaryFolder scratch;
  Fixture fixture({.address = "127.0.0.41", .frame_log = scratch / "frames"});
  AravisCamera camera({.address = "127.0.0.41"});
  std::vector<std::pair<std::uint64_t, std::string>> got;
  for (int i = 0; i < 200; ++i) {
    const auto frame = take(camera);
    got.emplace_back(frame.frame_id, hash(frame.image));
  }
  std::map<std::uint64_t, std::string> sent;  // ids pass 65535 on the way: the device begins at 65401
  std::ifstream log(scratch / "frames");
  std::uint64_t id = 0;
  for (std::string sha; log >> id >> sha;) sent[id] = sha;
  for (const auto& [frame_id, sha] : got) EXPECT_EQ(sent.at(frame_id), sha) << "frame " << frame_id;
  EXPECT_LT(got.back().first, 200u);  // the count passed its end
  EXPECT_EQ(camera.statistics().frames, 200u);
}

TEST(AravisCamera, ReadsTwelveBits) {
  Fixture fixture({.address = "127.0.0.42", .bits = 12});
  AravisCamera camera({.address = "127.0.0.42", .pixel_format = "Mono12"});
  EXPECT_EQ(camera.identity().bits, 12);
  const int before = fixture.rendered;
  const auto frame = camera.take_frame(2000ms);
  EXPECT_EQ(hash(frame.image), hash(picture(before, camera.exposure_ms(), 12)));
}

TEST(AravisCamera, SetsTheExposureAndRefusesOneOutOfRange) {
  Fixture fixture({.address = "127.0.0.43"});
  AravisCamera camera({.address = "127.0.0.43"});
  camera.set_exposure_ms(23);
  EXPECT_DOUBLE_EQ(camera.exposure_ms(), 23);
  const int before = fixture.rendered;
  EXPECT_EQ(hash(camera.take_frame(2000ms).image), hash(picture(before, 23, 8)));
  EXPECT_THROW(camera.set_exposure_ms(0.001), InputError);  // the device's range: 0.01 ms to 10 s
  camera.reopen();
  EXPECT_DOUBLE_EQ(camera.exposure_ms(), 23);
}

TEST(AravisCamera, ThrowsALateFrameAwayInsteadOfTakingItForTheNext) {
  Fixture fixture({.address = "127.0.0.44"});
  AravisCamera camera({.address = "127.0.0.44"});
  camera.take_frame(2000ms);
  const int number = fixture.rendered;
  fixture.delay_ms = 400;  // the frame comes 250 ms after its limit
  EXPECT_THROW(camera.take_frame(150ms), hw::FrameLost);
  const auto frame = camera.take_frame(2000ms);
  // The late picture has `number`, that of the second trigger the next one.
  EXPECT_EQ(hash(frame.image), hash(picture(number + 1, camera.exposure_ms(), 8)));
  EXPECT_EQ(camera.statistics().late_or_double, 1u);
  EXPECT_EQ(camera.statistics().timeouts, 1u);
  EXPECT_EQ(camera.statistics().recounts, 0u);
}

// 640 x 480 pixels are 38 packets of 8192 bytes, 40 with leader and trailer: at 0.2 % loss 92 % of the frames are
// whole, 30 frames need 33 triggers; 20 retakes of one frame are never used up (0.08^20).
TEST(AravisCamera, RetakesFramesAtATwoPerMilleLossOfPackets) {
  Fixture fixture({.address = "127.0.0.45", .packet_loss = 0.002});
  AravisCamera camera({.address = "127.0.0.45"});
  for (int i = 0; i < 30; ++i) {
    const auto frame = take(camera, 1000ms);
    EXPECT_EQ(hash(frame.image), hash(picture(fixture.rendered - 1, camera.exposure_ms(), 8)));
  }
  EXPECT_EQ(camera.statistics().frames, 30u);
}

// 0.98^40 = 45 % of the frames are whole: 10 frames need 22 triggers, and 20 retakes fail with 0.55^21 = 4e-6.
TEST(AravisCamera, GivesOnlyWholeFramesAtTwoPercentLoss) {
  Fixture fixture({.address = "127.0.0.46", .packet_loss = 0.02});
  AravisCamera camera({.address = "127.0.0.46", .frame_limit = 500ms});
  for (int i = 0; i < 10; ++i) {
    const auto frame = take(camera, 500ms);
    EXPECT_EQ(hash(frame.image), hash(picture(fixture.rendered - 1, camera.exposure_ms(), 8)));
  }
  EXPECT_GT(camera.statistics().incomplete + camera.statistics().timeouts, 0u);  // none lost: 0.45^10 = 3e-4
}

TEST(AravisCamera, SaysThatTheCameraIsGoneAndOpensItAgain) {
  auto fixture = std::make_unique<Fixture>(virt::FakeCameraOptions{.address = "127.0.0.47"});
  AravisCamera camera({.address = "127.0.0.47"});
  camera.take_frame(2000ms);
  fixture.reset();
  EXPECT_THROW(
      for (int i = 0; i < 3; ++i) {
        try {
          camera.take_frame(200ms);
        } catch (const hw::FrameLost&) {
        }
      },
      hw::CameraLost);
  EXPECT_THROW(camera.reopen(), hw::CameraLost);
  EXPECT_THROW(camera.take_frame(200ms), hw::CameraLost);  // closed, and says so
  fixture = std::make_unique<Fixture>(virt::FakeCameraOptions{.address = "127.0.0.47"});
  camera.reopen();
  const int before = fixture->rendered;
  EXPECT_EQ(hash(camera.take_frame(2000ms).image), hash(picture(before, camera.exposure_ms(), 8)));
  EXPECT_EQ(camera.statistics().reopened, 2u);
}

TEST(AravisCamera, IsNotTakenFromAnotherProgram) {
  Fixture fixture({.address = "127.0.0.48"});
  AravisCamera first({.address = "127.0.0.48"});
  EXPECT_THROW(AravisCamera({.address = "127.0.0.48", .takeover_limit = 0ms}), hw::CameraLost);
  first.take_frame(2000ms);
}

TEST(AravisCamera, RefusesWhatIsNotTheAddressOfOneCamera) {
  using hw::defect_of_camera_address;
  EXPECT_EQ(defect_of_camera_address("192.168.0.10"), "");
  EXPECT_NE(defect_of_camera_address("basler-1234").find("broadcast"), std::string::npos);
  EXPECT_NE(defect_of_camera_address("255.255.255.255").find("broadcast"), std::string::npos);
  EXPECT_NE(defect_of_camera_address("239.255.1.1").find("multicast"), std::string::npos);
  EXPECT_NE(defect_of_camera_address("127.255.255.255").find("broadcast"), std::string::npos);
  EXPECT_NE(defect_of_camera_address("0.0.0.0"), "");
  EXPECT_NE(defect_of_camera_address(""), "");
  EXPECT_THROW(AravisCamera({.address = "camera"}), InputError);
}

TEST(FakeCamera, LivesOnSeveralLoopbackAddressesAtOnce) {
  Fixture one({.address = "127.0.0.2"}), other({.address = "127.0.0.3"});
  other.rendered = 1000;
  AravisCamera first({.address = "127.0.0.2"}), second({.address = "127.0.0.3"});
  const int n = one.rendered, m = other.rendered;
  EXPECT_EQ(hash(first.take_frame(2000ms).image), hash(picture(n, first.exposure_ms(), 8)));
  EXPECT_EQ(hash(second.take_frame(2000ms).image), hash(picture(m, second.exposure_ms(), 8)));
}

TEST(FakeCamera, SaysThatItsAddressIsTaken) {
  Fixture fixture({.address = "127.0.0.49"});
  EXPECT_THROW(Fixture({.address = "127.0.0.49"}), EnvironmentError);
}

}  // namespace

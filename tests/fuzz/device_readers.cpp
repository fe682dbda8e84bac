#include "tests/fuzz/device_readers.h"

#include "core/error.h"
#include "hw/aravis_camera.h"
#include "hw/mewtocol.h"
#include "hw/mewtocol_plc.h"
#include "hw/modbus_plc.h"
#include "hw/virtual/byte_server.h"
#include "tests/support/gige_device.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <utility>

namespace fringecal::test {
namespace {

using namespace std::chrono_literals;
using virt::ByteServer;
using Bytes = std::string_view;

constexpr auto kSoundLimit = 2000ms;  // of a sound answer on a busy machine
constexpr auto kLimit = 5ms;          // what is not there by then is not waited for

/// Cut into pieces, each behind its length of `width` bytes, low byte first; the last may be short.
std::vector<std::string> pieces_of(Bytes bytes, std::size_t width) {
  std::vector<std::string> out;
  while (bytes.size() >= width) {
    std::size_t length = 0;
    for (std::size_t i = width; i-- > 0;) length = length << 8 | static_cast<unsigned char>(bytes[i]);
    bytes.remove_prefix(width);
    out.emplace_back(bytes.substr(0, length));
    bytes.remove_prefix(std::min(length, bytes.size()));
  }
  return out;
}

std::string joined(std::span<const std::string> pieces, std::size_t width) {
  std::string out;
  for (const std::string& piece : pieces) {
    for (std::size_t i = 0; i < width; ++i) out += static_cast<char>(piece.size() >> (8 * i));
    out += piece;
  }
  return out;
}

/// The answers that a server's thread gives to the next questions; none after the last.
class Replies {
 public:
  void set(std::vector<std::string> replies) {
    const std::lock_guard lock(mutex_);
    replies_ = std::move(replies);
    next_ = 0;
  }
  std::string next() {
    const std::lock_guard lock(mutex_);
    return next_ < replies_.size() ? replies_[next_++] : "";
  }

 private:
  std::mutex mutex_;
  std::vector<std::string> replies_;
  std::size_t next_ = 0;
};

/// Everything that is asked of a PLC in a capture, until it fails.
void talk_to(hw::RegisterPlc& plc) {
  plc.status();
  plc.identity();
  plc.command(hw::PlcCommand::home, 1);
  plc.feed_watchdog();
}

constexpr Bytes kZeros("\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 26);

std::string modbus(Bytes pdu) {
  return std::string("\0\0\0\0\0", 5) + static_cast<char>(pdu.size() + 1) + '\1' + std::string(pdu);
}

/// What is particular to a protocol: sound replies to all that talk_to() asks, a server that gives the replies set, a client.
struct PlcProtocol {
  const char* name;
  std::vector<std::string> sound;
  std::function<std::unique_ptr<ByteServer>(Replies&)> serve;
  std::function<std::unique_ptr<hw::RegisterPlc>(const ByteServer&, std::chrono::milliseconds limit)> open;
};

/// Bad replies end as the client's own errors, nothing else. The server is started with the first reading.
Reader plc_replies(const PlcProtocol& protocol) {
  struct Line {
    Replies replies;
    std::unique_ptr<ByteServer> server;
  };
  const auto read = [protocol, line = std::make_shared<Line>()](Bytes bytes, std::chrono::milliseconds limit) {
    if (!line->server) line->server = protocol.serve(line->replies);
    line->replies.set(pieces_of(bytes, 1));
    talk_to(*protocol.open(*line->server, limit));
  };
  const auto guarded = [read](Bytes bytes) {
    try {
      read(bytes, kLimit);
    } catch (const hw::PlcLost&) {
    } catch (const hw::PlcFault&) {
    }
  };
  return {protocol.name, {joined(protocol.sound, 1)}, guarded, [read](Bytes bytes) { read(bytes, kSoundLimit); }, true};
}

Reader modbus_replies() {
  const std::string status = "\3\x1c" + std::string("\0\1", 2) + std::string(kZeros);
  const auto written_at = [&](std::uint16_t first, std::uint16_t count) {
    return modbus(std::string{'\x10', static_cast<char>(first >> 8), static_cast<char>(first & 255),
                              static_cast<char>(count >> 8), static_cast<char>(count & 255)});
  };
  return plc_replies({.name = "modbus_replies",
                      .sound = {modbus(status), modbus(status), written_at(hw::dt::kTargetPattern, 3),
                                modbus(Bytes("\3\2\0\7", 4)), written_at(hw::dt::kWatchdog, 1)},
                      .serve =
                          [](Replies& replies) {
                            return ByteServer::on_tcp("127.0.0.1", 0, [&replies](std::string& question) {
                              if (question.size() < 6) return std::optional<ByteServer::Answer>();
                              const std::string number = question.substr(0, 2);
                              question.clear();
                              std::string reply = replies.next();
                              reply.replace(0, 2, number);
                              return std::optional(ByteServer::Answer{reply, 0ms});
                            });
                          },
                      .open =
                          [](const ByteServer& server, std::chrono::milliseconds limit) {
                            const std::string address = "modbus-tcp://127.0.0.1:" + std::to_string(server.port());
                            return std::make_unique<hw::ModbusPlc>(
                                hw::parse_plc_address(address),
                                hw::PlcLinkOptions{.answer_limit = limit, .attempts = 1});
                          }});
}

Reader mewtocol_replies() {
  using hw::mewtocol::encode;
  using hw::mewtocol::FrameKind;
  const std::string status = "RD0100" + std::string(13 * 4, '0');
  std::vector<std::string> sound;
  for (const std::string& text : {status, status, std::string("WD"), std::string("RD0700"), std::string("WD")}) {
    sound.push_back(encode({1, FrameKind::answer, text}));
  }
  sound.back().replace(sound.back().size() - 3, 2, "**");
  return plc_replies({.name = "mewtocol_replies",
                      .sound = sound,
                      .serve =
                          [](Replies& replies) {
                            return ByteServer::on_pty("", [&replies](std::string& question) {
                              const std::size_t end = question.find('\r');
                              if (end == std::string::npos) return std::optional<ByteServer::Answer>();
                              question.erase(0, end + 1);
                              return std::optional(ByteServer::Answer{replies.next(), 0ms});
                            });
                          },
                      .open =
                          [](const ByteServer& server, std::chrono::milliseconds limit) {
                            return std::make_unique<hw::MewtocolPlc>(
                                hw::parse_plc_address("mewtocol:" + server.device()),
                                hw::PlcLinkOptions{.answer_limit = limit, .attempts = 1});
                          }});
}

/// A device whose next frame is given, packet by packet, and the client that has it open.
class HostileCamera {
 public:
  static constexpr int kWidth = 64, kHeight = 24, kPacketBytes = 576;

  void read(Bytes bytes, std::chrono::milliseconds limit) {
    if (!device_) {
      device_ = std::make_unique<GigeDevice>(address_, kWidth, kHeight, [this](int) {
        const std::lock_guard lock(mutex_);
        return FrameFault{.instead = std::exchange(packets_, {})};
      });
    }
    if (!camera_) camera_ = std::make_unique<hw::AravisCamera>(options());
    {
      const std::lock_guard lock(mutex_);
      packets_ = pieces_of(bytes, 2);
    }
    try {
      const hw::CameraFrame frame = camera_->take_frame(limit);
      const auto& image = std::get<Image8>(frame.image);
      require(image.width() == kWidth && image.height() == kHeight, "a frame has the size that was set");
    } catch (const hw::CameraLost&) {
      camera_.reset();
      throw;
    }
  }

 private:
  hw::AravisCameraOptions options() const { return {.address = address_, .packet_size_bytes = kPacketBytes}; }

  // All of 127.x.x.x is loopback: one of this process's own, as several may run at once.
  std::string address_ = fmt::format("127.92.{}.{}", ::getpid() / 256 % 256, ::getpid() % 256);

  std::mutex mutex_;
  std::vector<std::string> packets_;
  std::unique_ptr<GigeDevice> device_;
  std::unique_ptr<hw::AravisCamera> camera_;
};

Reader gvsp_packets() {
  const auto camera = std::make_shared<HostileCamera>();
  const auto guarded = [camera](Bytes bytes) {
    try {
      camera->read(bytes, 3 * kLimit);
    } catch (const hw::FrameLost&) {
    } catch (const hw::CameraLost&) {
    }
  };
  return {
      "gvsp_packets",
      {joined(GigeDevice::packets(0, HostileCamera::kWidth, HostileCamera::kHeight, HostileCamera::kPacketBytes), 2)},
      guarded,
      [camera](Bytes bytes) { camera->read(bytes, kSoundLimit); },
      true};
}

}  // namespace

std::vector<Reader> device_readers() { return {modbus_replies(), mewtocol_replies(), gvsp_packets()}; }

}  // namespace fringecal::test

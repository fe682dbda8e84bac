#include "tests/support/gige_device.h"

#include "hw/gvcp.h"

#include <arpa/inet.h>
#include <arv.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <deque>
#include <map>
#include <mutex>
#include <span>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace fringecal::test {
namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

constexpr int kHeaderBytes = 36;  // of IP, UDP and GVSP, counted into the packet size
constexpr std::uint32_t kStreamPort = 0x0D00, kPacketSize = 0x0D04, kStreamAddress = 0x0D18;

void put(Bytes& out, std::uint64_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; --i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}
std::uint32_t get(std::span<const std::uint8_t> in, std::size_t place, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | in[place + static_cast<std::size_t>(i)];
  return value;
}

struct Frame {
  std::vector<Bytes> packets;
  FrameFault fault;
  std::map<int, int> requests;  // of dropped packets
};

}  // namespace

struct GigeDevice::State {
  std::string address;
  int width, height;
  Plan plan;
  ArvFakeCamera* registers = arv_fake_camera_new("T1");
  int control = -1, stream = -1;
  std::atomic<bool> stop = false;
  std::atomic<int> triggers = 0, resent = 0, packets = 0;
  std::uint16_t block = 65530;  // passes the end of the count early
  std::map<std::uint16_t, Frame> frames;
  std::deque<std::pair<Clock::time_point, std::uint16_t>> due;
  bool deaf = false;
  std::uint64_t controller = 0;  // address and port of the client that controls the device
  std::thread thread;

  std::uint32_t reg(std::uint32_t place) const {
    guint32 value = 0;
    arv_fake_camera_read_register(registers, place, &value);
    return value;
  }
  int bound(int port) const {
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(static_cast<std::uint16_t>(port));
    inet_pton(AF_INET, address.c_str(), &a.sin_addr);
    if (bind(fd, reinterpret_cast<sockaddr*>(&a), sizeof a) != 0) throw std::runtime_error("the address is taken");
    return fd;
  }

  void send(const Bytes& packet) const {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(static_cast<std::uint16_t>(reg(kStreamPort)));
    a.sin_addr.s_addr = htonl(reg(kStreamAddress));
    sendto(stream, packet.data(), packet.size(), 0, reinterpret_cast<sockaddr*>(&a), sizeof a);
  }

  void trigger() {
    const int number = triggers++;
    FrameFault fault = plan(number);
    if (fault.answers_nothing) deaf = true;
    if (fault.trigger_ignored) return;
    block = block == 65535 ? 1 : static_cast<std::uint16_t>(block + 1);
    Frame frame;
    const int packet_bytes = static_cast<int>(reg(kPacketSize) & 0xFFFF);
    for (std::string& p : fault.instead.empty() ? GigeDevice::packets(number, width, height, packet_bytes)
                                                : std::exchange(fault.instead, {})) {
      Bytes packet(p.begin(), p.end());
      if (packet.size() >= 4) {
        const std::uint32_t id = get(packet, 2, 2) + block;
        packet[2] = static_cast<std::uint8_t>(id >> 8);
        packet[3] = static_cast<std::uint8_t>(id);
      }
      frame.packets.push_back(std::move(packet));
    }
    packets = static_cast<int>(frame.packets.size());
    frame.fault = fault;
    frames[block] = std::move(frame);
    if (frames.size() > 8) frames.erase(frames.begin());
    for (int copies = fault.sent_twice ? 2 : 1; copies > 0; --copies)
      due.emplace_back(Clock::now() + fault.delay, block);
  }

  void send_due() {
    for (auto it = due.begin(); it != due.end();) {
      if (it->first > Clock::now()) {
        ++it;
        continue;
      }
      Frame& frame = frames.at(it->second);
      for (int i = 0; i < static_cast<int>(frame.packets.size()); ++i) {
        if (!frame.fault.drop.contains(i)) send(frame.packets[static_cast<std::size_t>(i)]);
      }
      it = due.erase(it);
    }
  }

  void resend(std::uint16_t id, int first, int last) {
    const auto found = frames.find(id);
    if (found == frames.end()) return;
    Frame& frame = found->second;
    for (int i = first; i <= std::min(last, static_cast<int>(frame.packets.size()) - 1); ++i) {
      if (frame.requests[i]++ < frame.fault.ignored_resends) continue;
      send(frame.packets[static_cast<std::size_t>(i)]);
      ++resent;
    }
  }

  Bytes answer(std::span<const std::uint8_t> command, std::uint64_t client) {
    const std::uint32_t code = get(command, 2, 2);
    const bool writes = code == 0x0082 || code == 0x0086;
    if (writes && controller != 0 && client != controller) return {};
    const auto data = command.subspan(8);
    Bytes body;
    if (code == 0x0040) {
      resend(static_cast<std::uint16_t>(get(data, 2, 2)), static_cast<int>(get(data, 4, 4) & 0xFFFFFF),
             static_cast<int>(get(data, 8, 4) & 0xFFFFFF));
      return {};
    }
    if (code == 0x0080) {
      for (std::size_t i = 0; i + 4 <= data.size(); i += 4) put(body, reg(get(data, i, 4)), 4);
    } else if (code == 0x0082) {
      for (std::size_t i = 0; i + 8 <= data.size(); i += 8) {
        const std::uint32_t place = get(data, i, 4), value = get(data, i + 4, 4);
        if (place == ARV_FAKE_CAMERA_REGISTER_TRIGGER_SOFTWARE) {
          if (value == 1) trigger();
        } else {
          arv_fake_camera_write_register(registers, place, value);
        }
        if (place == hw::kControlChannelPrivilege) controller = value == 0 ? 0 : client;
      }
      put(body, 1, 4);
    } else if (code == 0x0084) {
      const std::uint32_t place = get(data, 0, 4), count = get(data, 6, 2);
      put(body, place, 4);
      body.resize(4 + count);
      arv_fake_camera_read_memory(registers, place, count, body.data() + 4);
    } else if (code == 0x0086) {
      arv_fake_camera_write_memory(registers, get(data, 0, 4), static_cast<guint32>(data.size() - 4), data.data() + 4);
      put(body, static_cast<std::uint64_t>(data.size() - 4), 4);
    } else {
      return {};
    }
    Bytes out;
    put(out, 0, 2);
    put(out, code + 1, 2);
    put(out, body.size(), 2);
    put(out, get(command, 6, 2), 2);
    out.insert(out.end(), body.begin(), body.end());
    return out;
  }

  void serve() {
    Bytes buffer(65536);
    while (!stop) {
      pollfd p{control, POLLIN, 0};
      if (poll(&p, 1, 2) > 0) {
        sockaddr_in from{};
        socklen_t size = sizeof from;
        const ssize_t count =
            recvfrom(control, buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
        if (count >= 8 && !deaf) {
          const Bytes reply = answer(std::span(buffer).first(static_cast<std::size_t>(count)),
                                     std::uint64_t{from.sin_addr.s_addr} << 16 | from.sin_port);
          if (!reply.empty() && !deaf) {
            sendto(control, reply.data(), reply.size(), 0, reinterpret_cast<sockaddr*>(&from), size);
          }
        }
      }
      if (!deaf) send_due();
    }
  }
};

GigeDevice::GigeDevice(std::string address, int width_px, int height_px, Plan plan)
    : state_(std::make_unique<State>()) {
  state_->address = std::move(address);
  state_->width = width_px;
  state_->height = height_px;
  state_->plan = std::move(plan);
  for (const std::uint32_t place : {ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, ARV_FAKE_CAMERA_REGISTER_WIDTH}) {
    arv_fake_camera_write_register(state_->registers, place, static_cast<guint32>(width_px));
  }
  for (const std::uint32_t place : {ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, ARV_FAKE_CAMERA_REGISTER_HEIGHT}) {
    arv_fake_camera_write_register(state_->registers, place, static_cast<guint32>(height_px));
  }
  state_->control = state_->bound(hw::kGvcpPort);
  state_->stream = state_->bound(0);
  state_->thread = std::thread([s = state_.get()] { s->serve(); });
}

GigeDevice::~GigeDevice() {
  state_->stop = true;
  state_->thread.join();
  close(state_->control);
  close(state_->stream);
  g_object_unref(state_->registers);
}

Image8 GigeDevice::picture(int trigger, int width_px, int height_px) {
  Image8 out(width_px, height_px);
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) out(x, y) = static_cast<std::uint8_t>(x * 7 + y * 13 + trigger * 101);
  }
  return out;
}

std::vector<std::string> GigeDevice::packets(int trigger, int width_px, int height_px, int packet_bytes) {
  const Image8 image = picture(trigger, width_px, height_px);
  std::vector<std::string> out;
  const auto add = [&](std::uint64_t type, const Bytes& body) {
    Bytes p;
    put(p, 0, 4);  // status and block id
    put(p, type, 1);
    put(p, out.size(), 3);
    p.insert(p.end(), body.begin(), body.end());
    out.emplace_back(p.begin(), p.end());
  };
  Bytes leader;
  put(leader, 1, 4);  // an image
  put(leader, static_cast<std::uint64_t>(trigger) * 1'000'000, 8);
  put(leader, ARV_PIXEL_FORMAT_MONO_8, 4);
  put(leader, static_cast<std::uint64_t>(width_px), 4);
  put(leader, static_cast<std::uint64_t>(height_px), 4);
  put(leader, 0, 8);
  put(leader, 0, 4);
  add(1, leader);
  const auto step = static_cast<std::size_t>(packet_bytes - kHeaderBytes);
  for (std::size_t at = 0; at < image.size(); at += step) {
    add(3, Bytes(image.data() + at, image.data() + std::min(image.size(), at + step)));
  }
  Bytes trailer;
  put(trailer, 1, 4);
  put(trailer, static_cast<std::uint64_t>(height_px), 4);
  add(2, trailer);
  return out;
}

int GigeDevice::triggers() const { return state_->triggers; }
int GigeDevice::packets_per_frame() const { return state_->packets; }
int GigeDevice::packets_resent() const { return state_->resent; }

}  // namespace fringecal::test

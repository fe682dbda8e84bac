#include "hw/virtual/fake_camera.h"

#include "core/error.h"
#include "core/file.h"
#include "hw/gvcp.h"
#include "hw/virtual/loopback_interface.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <random>
#include <string_view>

namespace fringecal::virt {
namespace fs = std::filesystem;
namespace {

using hw::kGvcpPort;
constexpr std::uint32_t kModelName = 0x0068;      // [GigEVision, bootstrap registers], 32 characters
constexpr std::uint32_t kProbeRegister = 0xFF00;  // unused by the device; inside its memory of 64 KiB

/// A UDP socket of our own, closed at the end.
class Socket {
 public:
  Socket() : fd_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~Socket() {
    if (fd_ >= 0) close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  int fd() const { return fd_; }
  bool bind_to(const std::string& address, int port) {
    const sockaddr_in a = socket_address(address, port);
    return bind(fd_, reinterpret_cast<const sockaddr*>(&a), sizeof a) == 0;
  }
  static sockaddr_in socket_address(const std::string& address, int port) {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_port = htons(static_cast<std::uint16_t>(port));
    inet_pton(AF_INET, address.c_str(), &a.sin_addr);
    return a;
  }

 private:
  int fd_;
};

/// Aravis's description of its camera, with the grey pixel formats that we serve in place of its own list.
std::string description(ArvFakeCamera* original) {
  std::size_t size = 0;
  std::string xml = arv_fake_camera_get_genicam_xml(original, &size);
  const auto begin = xml.find("<EnumEntry", xml.find("<Enumeration Name=\"PixelFormat\""));
  const auto end = xml.find("<pValue>PixelFormatRegister");
  require(begin < end && end != std::string::npos, "Aravis's camera describes its pixel formats");
  std::string formats;
  for (const auto& [name, value] :
       {std::pair{"Mono8", ARV_PIXEL_FORMAT_MONO_8}, std::pair{"Mono12", ARV_PIXEL_FORMAT_MONO_12},
        std::pair{"Mono16", ARV_PIXEL_FORMAT_MONO_16}}) {
    formats +=
        fmt::format("<EnumEntry Name=\"{}\" NameSpace=\"Standard\"><Value>{}</Value></EnumEntry>\n\t\t", name, value);
  }
  return xml.replace(begin, end - begin, formats);
}

std::uint16_t scaled(unsigned v, int bits, int to_bits) {
  if (to_bits <= bits) return static_cast<std::uint16_t>(v >> (bits - to_bits));                      // eq. 2
  return static_cast<std::uint16_t>(v << (to_bits - bits) | (v >> std::max(0, 2 * bits - to_bits)));  // eq. 1
}

}  // namespace

struct FakeCamera::Device {
  FakeCameraOptions options;
  Render render;
  ArvGvFakeCamera* gv = nullptr;
  int log = -1;
  std::atomic<std::uint64_t> frames = 0;

  ~Device() {
    if (gv) g_object_unref(gv);  // joins its thread
    if (log >= 0) close(log);
  }

  void start();
  void fill(ArvBuffer* buffer, double exposure_ms, ArvPixelFormat format) noexcept;
};

void FakeCamera::Device::start() {
  const std::string& address = options.address;
  // Aravis's camera says that it runs even where its port was taken; so ask first ...
  if (Socket probe; !probe.bind_to(address, kGvcpPort)) {
    throw EnvironmentError(fmt::format(
        "{} port {}: {}", address, kGvcpPort,
        errno == EADDRINUSE ? "another camera or virtual scanner serves there; take another address, such as "
                              "127.0.0.2 (all of 127.x.x.x is loopback)"
                            : std::strerror(errno)));
  }
  {
    ArvFakeCamera* original = arv_fake_camera_new("V");
    const std::string xml = description(original);
    g_object_unref(original);
    std::string file = (fs::temp_directory_path() / "fringecal-genicam-XXXXXX").string();
    const int fd = mkstemp(file.data());
    if (fd < 0) throw EnvironmentError(fmt::format("{}: {}", file, std::strerror(errno)));
    close(fd);
    write_atomically(file, xml);
    std::optional<ListedLoopback> listed;
    if (address.starts_with("127.")) listed.emplace(address);
    // While this socket holds the broadcast address, Aravis cannot take it: the device stays invisible from outside.
    Socket broadcast;
    broadcast.bind_to("255.255.255.255", kGvcpPort);
    gv = arv_gv_fake_camera_new_full(address.c_str(), options.serial.c_str(), file.c_str());
    fs::remove(file);
  }
  ArvFakeCamera* camera = arv_gv_fake_camera_get_fake_camera(gv);
  g_object_set(gv, "gvsp-lost-ratio", options.packet_loss, nullptr);
  constexpr std::string_view model = kModel;
  arv_fake_camera_write_memory(camera, kModelName, model.size() + 1, model.data());
  const auto set = [&](std::uint32_t place, std::uint32_t value) {
    arv_fake_camera_write_register(camera, place, value);
  };
  set(ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH, static_cast<std::uint32_t>(options.width_px));
  set(ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT, static_cast<std::uint32_t>(options.height_px));
  set(ARV_FAKE_CAMERA_REGISTER_WIDTH, static_cast<std::uint32_t>(options.width_px));
  set(ARV_FAKE_CAMERA_REGISTER_HEIGHT, static_cast<std::uint32_t>(options.height_px));
  set(ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT, options.bits > 8 ? ARV_PIXEL_FORMAT_MONO_12 : ARV_PIXEL_FORMAT_MONO_8);
  set(ARV_FAKE_CAMERA_REGISTER_EXPOSURE_TIME_US, static_cast<std::uint32_t>(std::lround(1e3 * options.exposure_ms)));
  // It looks for a trigger in this rhythm, and spins through the last millisecond before each look: at 1000 Hz it would
  // keep a processor busy for as long as a client is connected.
  arv_fake_camera_set_trigger_frequency(camera, 100.0);
  arv_fake_camera_set_fill_pattern(
      camera,
      [](ArvBuffer* buffer, void* self, guint32 exposure_us, guint32, ArvPixelFormat format) {
        static_cast<Device*>(self)->fill(buffer, exposure_us / 1e3, format);
      },
      this);
  // ... and then ask for a number that only this device can know.
  const std::uint32_t number = std::random_device{}() & 0x7FFFFFFFu;
  set(kProbeRegister, number);
  if (hw::ask_register(address, kProbeRegister, std::chrono::seconds(3)) == number) return;
  throw EnvironmentError(
      fmt::format("{}: the virtual camera does not answer there; is this an address of this machine, "
                  "and is UDP port {} open?",
                  address, kGvcpPort));
}

void FakeCamera::Device::fill(ArvBuffer* buffer, double exposure_ms, ArvPixelFormat format) noexcept {
  const GrayImage picture = render(exposure_ms);
  std::size_t size = 0;
  // The buffer is the device's own and is there to be filled; only its accessor is const.
  auto* data = static_cast<std::uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, &size)));
  const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
  const int x0 = arv_buffer_get_image_x(buffer), y0 = arv_buffer_get_image_y(buffer);
  const int to_bits = format == ARV_PIXEL_FORMAT_MONO_8 ? 8 : format == ARV_PIXEL_FORMAT_MONO_12 ? 12 : 16;
  const std::size_t pixel = to_bits > 8 ? 2 : 1;
  const std::size_t bytes = pixel * static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::visit(
      [&](const auto& image) {
        for (int y = 0; y < height; ++y) {
          std::uint8_t* out = data + pixel * static_cast<std::size_t>(width) * static_cast<std::size_t>(y);
          for (int x = 0; x < width; ++x) {
            const unsigned v = image.contains(x + x0, y + y0) ? image(x + x0, y + y0) : 0u;
            const std::uint16_t w = scaled(v, options.bits, to_bits);
            if (pixel == 1) {
              out[x] = static_cast<std::uint8_t>(w);
            } else {
              std::memcpy(out + 2 * x, &w, 2);
            }
          }
        }
      },
      picture);
  ++frames;
  if (log < 0) return;
  const std::string line =
      fmt::format("{} {}\n", arv_buffer_get_frame_id(buffer), sha256_hex({reinterpret_cast<const char*>(data), bytes}));
  if (write(log, line.data(), line.size()) != static_cast<ssize_t>(line.size())) std::terminate();
}

FakeCamera::FakeCamera(FakeCameraOptions options, Render render) : device_(std::make_unique<Device>()) {
  require(options.width_px > 0 && options.height_px > 0, "a camera has pixels");
  require(options.bits == 8 || options.bits == 12, "a virtual camera has 8 or 12 bits");
  require(options.packet_loss >= 0 && options.packet_loss < 1, "packet loss is a share");
  require(!options.serial.empty() && options.serial.size() < 16, "a serial number has 1 to 15 characters");
  device_->options = std::move(options);
  device_->render = std::move(render);
  if (const fs::path& file = device_->options.frame_log; !file.empty()) {
    device_->log = open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (device_->log < 0) throw EnvironmentError(fmt::format("{}: {}", file.string(), std::strerror(errno)));
  }
  device_->start();
}

FakeCamera::~FakeCamera() = default;

std::uint64_t FakeCamera::frames() const { return device_->frames; }

}  // namespace fringecal::virt

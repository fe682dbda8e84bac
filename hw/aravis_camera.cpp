#include "hw/aravis_camera.h"

#include "core/error.h"
#include "hw/gvcp.h"
#include "hw/gvsp_filter.h"

#include <arpa/inet.h>
#include <arv.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <thread>
#include <vector>

namespace fringecal::hw {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kSocketBufferBytes = 4 << 20;  // nearly three frames of 1.45 MB
constexpr int kLoopbackPacketBytes = 8192;
constexpr int kBuffers = 6;  // frames under way, late ones included

struct Unref {
  void operator()(gpointer object) const { g_object_unref(object); }
};
template <class T>
using Owned = std::unique_ptr<T, Unref>;

/// Takes a GError, throws it as our own.
class Checked {
 public:
  Checked(const std::string& address, const char* operation) : address_(address), operation_(operation) {}
  ~Checked() { g_clear_error(&error_); }
  Checked(const Checked&) = delete;
  Checked& operator=(const Checked&) = delete;
  operator GError**() { return &error_; }
  void check() const {
    if (!error_) return;
    const std::string sentence = fmt::format("camera {}: {}: {}", address_, operation_, error_->message);
    // What the camera's own description refuses is the user's setting; all else is the link.
    const bool refused = error_->domain == ARV_GC_ERROR || error_->domain == ARV_CHUNK_PARSER_ERROR ||
                         g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_FEATURE_NOT_FOUND) ||
                         g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_WRONG_FEATURE) ||
                         g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_INVALID_PARAMETER);
    if (refused) throw InputError(sentence);
    throw CameraLost(sentence);
  }

 private:
  const std::string& address_;
  const char* operation_;
  GError* error_ = nullptr;
};

bool is_loopback(const std::string& address) { return address.starts_with("127."); }

/// The address of this machine from which packets go to the camera. Connecting a UDP socket sends nothing.
std::string local_address_towards(const std::string& address) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(kGvcpPort);
  inet_pton(AF_INET, address.c_str(), &to.sin_addr);
  sockaddr_in from{};
  socklen_t size = sizeof from;
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool found = fd >= 0 && connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0 &&
                     getsockname(fd, reinterpret_cast<sockaddr*>(&from), &size) == 0;
  const int reason = errno;
  if (fd >= 0) close(fd);
  if (!found) {
    throw CameraLost(
        fmt::format("camera {}: this machine has no network that leads there ({})", address, std::strerror(reason)));
  }
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &from.sin_addr, text, sizeof text);
  return text;
}

int bits_of(const std::string& pixel_format) {
  for (const int bits : {8, 10, 12, 14, 16}) {
    if (pixel_format == fmt::format("Mono{}", bits)) return bits;
  }
  throw InputError(
      fmt::format("pixel format {} is not read; use Mono8, Mono10, Mono12, Mono14 or Mono16 (unpacked)", pixel_format));
}

const char* words(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return "complete";
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "its last packets did not arrive";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "a packet had a wrong number";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "its size is not the announced one";
    case ARV_BUFFER_STATUS_FILLING:
      return "it was not finished";
    case ARV_BUFFER_STATUS_ABORTED:
      return "its transfer was aborted";
    default:
      return "its kind is not an image";
  }
}

template <class Pixel>
GrayImage copy_pixels(const void* data, int width, int height) {
  Image<Pixel> image(width, height);
  std::memcpy(image.data(), data, image.size() * sizeof(Pixel));
  return image;
}

}  // namespace

std::string defect_of_camera_address(const std::string& address) {
  in_addr parsed{};
  if (inet_pton(AF_INET, address.c_str(), &parsed) != 1) {
    return fmt::format(
        "{} is not an IPv4 address such as 192.168.0.10; names and serial numbers are not looked up, "
        "because that would broadcast into the network",
        address.empty() ? "an empty text" : address);
  }
  const std::uint32_t host = ntohl(parsed.s_addr);
  const char* why_not = nullptr;
  if (host == 0) why_not = "means no address at all";
  if (host >= 0xE0000000u) why_not = "reaches many devices (multicast or broadcast), not one camera";
  ifaddrs* interfaces = nullptr;
  if (!why_not && getifaddrs(&interfaces) == 0) {
    for (const ifaddrs* i = interfaces; i; i = i->ifa_next) {
      if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET || !i->ifa_netmask) continue;
      const auto value = [](const sockaddr* a) {
        return ntohl(reinterpret_cast<const sockaddr_in*>(a)->sin_addr.s_addr);
      };
      const std::uint32_t own = value(i->ifa_addr), mask = value(i->ifa_netmask);
      if (mask < 0xFFFFFFFEu && (own & mask) == (host & mask) && (host | mask) == 0xFFFFFFFFu) {
        why_not = "is the broadcast address of a network of this machine";
      }
    }
    freeifaddrs(interfaces);
  }
  return why_not ? fmt::format("{} {}; give the address of the camera itself", address, why_not) : "";
}

struct AravisCamera::Connection {
  Connection(const AravisCameraOptions& o, std::optional<double> exposure_ms);
  ~Connection();

  void set_exposure_ms(double exposure_ms);
  CameraFrame take_frame(milliseconds limit);
  void count_frames(milliseconds silence, milliseconds limit);
  CameraStatistics statistics() const;

  std::string address;
  int bits = 8, width = 0, height = 0;
  std::atomic<bool> control_lost = false;
  CameraStatistics counts;

  Owned<ArvDevice> device;
  Owned<ArvCamera> camera;
  Owned<ArvStream> stream;

 private:
  CameraStatistics stream_counts() const;
  void open_device(milliseconds takeover_limit);
  void start_stream();
  void trigger();
  Owned<ArvBuffer> pop(Clock::time_point deadline);
  void recycle(Owned<ArvBuffer> buffer) { arv_stream_push_buffer(stream.get(), buffer.release()); }
  CameraFrame frame_of(ArvBuffer& buffer) const;
  std::uint64_t next(std::uint64_t id) const { return id == last_id_ ? first_id_ : id + 1; }
  /// Whether id was counted before or at `than`, in the half circle behind it.
  bool before_or_at(std::uint64_t id, std::uint64_t than) const { return ((than - id) & last_id_) <= last_id_ / 2; }

  static constexpr std::uint64_t first_id_ = 1;
  std::uint64_t last_id_ = 0xFFFF;  // of 16-bit ids; all ones in the extended id mode
  std::uint64_t id_ = 0;            // expected at the last trigger
  CameraStatistics at_opening_;     // the frame that opening loses is no fault of the network
  bool counted_ = false;            // id_ is known
  bool unanswered_ = false;         // nothing came at the last trigger
};

AravisCamera::Connection::Connection(const AravisCameraOptions& o, std::optional<double> exposure_ms)
    : address(o.address), bits(bits_of(o.pixel_format)) {
  open_device(o.takeover_limit);
  g_signal_connect(device.get(), "control-lost",
                   G_CALLBACK(+[](ArvDevice*, gpointer lost) { static_cast<std::atomic<bool>*>(lost)->store(true); }),
                   &control_lost);
  const auto set = [&](const char* operation, auto&& action) {
    Checked e(address, operation);
    action(static_cast<GError**>(e));
    e.check();
  };
  set("reading its description", [&](GError** e) { camera.reset(arv_camera_new_with_device(device.get(), e)); });
  ArvCamera* c = camera.get();
  arv_camera_set_range_check_policy(c, ARV_RANGE_CHECK_POLICY_ENABLE);
  arv_camera_gv_set_stream_options(c, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  arv_camera_gv_set_packet_size_adjustment(c, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
  // A camera left running by a client that was killed keeps its settings locked.
  set("stopping its acquisition", [&](GError** e) { arv_camera_stop_acquisition(c, e); });
  set("setting the pixel format",
      [&](GError** e) { arv_camera_set_pixel_format_from_string(c, o.pixel_format.c_str(), e); });
  const std::optional<int> packet = o.packet_size_bytes    ? o.packet_size_bytes
                                    : is_loopback(address) ? std::optional(kLoopbackPacketBytes)
                                                           : std::nullopt;
  set("setting the packet size", [&](GError** e) {
    if (packet) {
      arv_camera_gv_set_packet_size(c, *packet, e);
    } else {
      arv_camera_gv_auto_packet_size(c, e);
    }
  });
  set("setting the acquisition mode",
      [&](GError** e) { arv_camera_set_acquisition_mode(c, ARV_ACQUISITION_MODE_CONTINUOUS, e); });
  if (arv_camera_is_exposure_auto_available(c, nullptr)) {
    set("switching automatic exposure off", [&](GError** e) { arv_camera_set_exposure_time_auto(c, ARV_AUTO_OFF, e); });
  }
  if (arv_camera_is_gain_auto_available(c, nullptr)) {
    set("switching automatic gain off", [&](GError** e) { arv_camera_set_gain_auto(c, ARV_AUTO_OFF, e); });
  }
  set("setting the software trigger", [&](GError** e) { arv_camera_set_trigger(c, "Software", e); });
  set("reading the size of its frames",
      [&](GError** e) { arv_camera_get_region(c, nullptr, nullptr, &width, &height, e); });
  if (arv_camera_is_feature_available(c, "GevGVSPExtendedIDMode", nullptr) &&
      g_strcmp0(arv_camera_get_string(c, "GevGVSPExtendedIDMode", nullptr), "On") == 0) {
    last_id_ = ~std::uint64_t{0};
  }
  if (exposure_ms) set_exposure_ms(*exposure_ms);
  start_stream();
  // Twice the silence that a frame under way from an earlier client could need on a link that works.
  count_frames(milliseconds(100), o.frame_limit);
  at_opening_ = stream_counts();
}

void AravisCamera::Connection::open_device(milliseconds takeover_limit) {
  const std::string here = local_address_towards(address);
  const auto deadline = Clock::now() + takeover_limit;
  const auto controlled = [&] {
    return CameraLost(fmt::format("camera {}: another program controls it; close that program", address));
  };
  const auto privilege = ask_register(address, kControlChannelPrivilege);
  if (!privilege) {
    throw CameraLost(
        fmt::format("camera {}: nothing answers there; check its power, its cable and its address", address));
  }
  if (*privilege != 0 && takeover_limit.count() == 0) throw controlled();
  do {
    device.reset();
    const Owned<GInetAddress> interface(g_inet_address_new_from_string(here.c_str()));
    const Owned<GInetAddress> there(g_inet_address_new_from_string(address.c_str()));
    Checked e(address, "opening it");
    device.reset(arv_gv_device_new(interface.get(), there.get(), e));
    e.check();
    if (arv_gv_device_is_controller(ARV_GV_DEVICE(device.get()))) return;
  } while (Clock::now() < deadline);
  throw controlled();
}

AravisCamera::Connection::~Connection() {
  if (device) g_signal_handlers_disconnect_by_data(device.get(), &control_lost);
  if (camera && stream && !control_lost) arv_camera_stop_acquisition(camera.get(), nullptr);
}

void AravisCamera::Connection::set_exposure_ms(double exposure_ms) {
  double low_us = 0, high_us = 0;
  {
    Checked e(address, "reading the range of its exposure");
    arv_camera_get_exposure_time_bounds(camera.get(), &low_us, &high_us, e);
    e.check();
  }
  const double us = 1e3 * exposure_ms;
  if (!(us >= low_us && us <= high_us)) {
    throw InputError(fmt::format("camera {}: an exposure of {:.3g} ms is outside its range of {:.3g} to {:.3g} ms",
                                 address, exposure_ms, 1e-3 * low_us, 1e-3 * high_us));
  }
  Checked e(address, "setting the exposure");
  arv_camera_set_exposure_time(camera.get(), us, e);
  e.check();
}

void AravisCamera::Connection::start_stream() {
  Checked e(address, "opening its stream");
  stream.reset(arv_camera_create_stream(camera.get(), nullptr, nullptr, e));
  e.check();
  g_object_set(stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
               kSocketBufferBytes, "packet-resend", ARV_GV_STREAM_PACKET_RESEND_ALWAYS, nullptr);
  const guint payload = arv_camera_get_payload(camera.get(), e);
  e.check();
  const auto packet_bytes = static_cast<std::uint32_t>(arv_camera_gv_get_packet_size(camera.get(), e));
  e.check();
  // Where the system takes no filter, frames are received as well, and a hostile packet is not held back.
  filter_stream(arv_gv_stream_get_port(ARV_GV_STREAM(stream.get())), payload, packet_bytes);
  for (int i = 0; i < kBuffers; ++i) arv_stream_push_buffer(stream.get(), arv_buffer_new_allocate(payload));
  arv_camera_start_acquisition(camera.get(), e);
  e.check();
}

void AravisCamera::Connection::trigger() {
  Checked e(address, "triggering it");
  arv_camera_software_trigger(camera.get(), e);
  try {
    e.check();
  } catch (const CameraLost&) {
    control_lost = true;
    throw;
  }
}

Owned<ArvBuffer> AravisCamera::Connection::pop(Clock::time_point deadline) {
  // In slices, so that a loss of the control channel is seen while waiting.
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::microseconds>(deadline - Clock::now()).count();
    const auto slice = std::clamp<std::int64_t>(left, 0, 100'000);
    ArvBuffer* buffer = slice > 0 ? arv_stream_timeout_pop_buffer(stream.get(), static_cast<guint64>(slice))
                                  : arv_stream_try_pop_buffer(stream.get());
    if (buffer) return Owned<ArvBuffer>(buffer);
    if (control_lost) throw CameraLost(fmt::format("camera {}: it stopped answering", address));
    if (left <= 0) return nullptr;
  }
}

void AravisCamera::Connection::count_frames(milliseconds silence, milliseconds limit) {
  counted_ = unanswered_ = false;
  for (int attempt = 0; attempt < 3; ++attempt) {
    while (auto buffer = pop(Clock::now() + silence)) recycle(std::move(buffer));
    trigger();
    int frames = 0;
    // The first frame may come in pieces or not at all while the socket's buffer is set; its id is in any piece.
    for (auto deadline = Clock::now() + limit; auto buffer = pop(deadline); deadline = Clock::now() + silence) {
      if (const std::uint64_t id = arv_buffer_get_frame_id(buffer.get()); id != 0) {  // 0: its leader is lost
        id_ = id;
        ++frames;
      }
      recycle(std::move(buffer));
    }
    if (frames == 1) {
      counted_ = true;
      return;
    }
  }
  throw CameraLost(
      fmt::format("camera {}: it answers, but a trigger does not give one frame within {} ms; check that its "
                  "packets of {} bytes pass the network and no firewall stops UDP",
                  address, limit.count(), arv_camera_gv_get_packet_size(camera.get(), nullptr)));
}

CameraFrame AravisCamera::Connection::take_frame(milliseconds limit) {
  if (!counted_) {
    ++counts.recounts;
    count_frames(2 * limit, limit);
  }
  while (auto buffer = pop(Clock::now())) {  // frames of earlier triggers
    ++counts.late_or_double;
    recycle(std::move(buffer));
  }
  trigger();
  id_ = next(id_);
  const auto deadline = Clock::now() + limit;
  bool earlier_seen = false;
  while (auto buffer = pop(deadline)) {
    const std::uint64_t id = arv_buffer_get_frame_id(buffer.get());
    const ArvBufferStatus status = arv_buffer_get_status(buffer.get());
    // Without its leader a frame has id 0; whichever it is, it is not whole.
    const bool nameless = id == 0 && status != ARV_BUFFER_STATUS_SUCCESS;
    if (id != id_ && !nameless) {
      ++counts.late_or_double;
      recycle(std::move(buffer));
      if (id != 0 && before_or_at(id, id_)) {
        earlier_seen = true;
        continue;
      }
      counted_ = false;
      throw FrameLost(fmt::format("camera {}: a frame with id {} came where {} was due; the count is taken anew",
                                  address, id, id_));
    }
    unanswered_ = false;
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
      ++counts.incomplete;
      recycle(std::move(buffer));
      throw FrameLost(fmt::format("camera {}: frame {} is incomplete: {}", address, id_, words(status)));
    }
    CameraFrame frame = frame_of(*buffer);
    recycle(std::move(buffer));
    ++counts.frames;
    return frame;
  }
  ++counts.timeouts;
  // Twice in doubt, or an earlier frame in place of this one: a trigger may have been lost, and the count is off.
  if (unanswered_ || earlier_seen) counted_ = false;
  unanswered_ = true;
  throw FrameLost(fmt::format("camera {}: no frame with id {} within {} ms", address, id_, limit.count()));
}

CameraFrame AravisCamera::Connection::frame_of(ArvBuffer& buffer) const {
  std::size_t size = 0;
  const void* data = arv_buffer_get_image_data(&buffer, &size);
  gint x_padding = 0, y_padding = 0;
  arv_buffer_get_image_padding(&buffer, &x_padding, &y_padding);
  const int w = arv_buffer_get_image_width(&buffer), h = arv_buffer_get_image_height(&buffer);
  const std::size_t pixel = bits > 8 ? 2 : 1;
  if (!data || w != width || h != height || x_padding != 0 || y_padding != 0 ||
      size < pixel * static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) {
    throw CameraLost(
        fmt::format("camera {}: a frame of {} x {} pixels and {} bytes came where {} x {} pixels of {} byte "
                    "were set; its settings were changed from outside",
                    address, w, h, size, width, height, pixel));
  }
  CameraFrame frame;
  frame.frame_id = arv_buffer_get_frame_id(&buffer);
  frame.image = bits > 8 ? copy_pixels<std::uint16_t>(data, w, h) : copy_pixels<std::uint8_t>(data, w, h);
  return frame;
}

CameraStatistics AravisCamera::Connection::statistics() const {
  CameraStatistics out = counts;
  const CameraStatistics now = stream_counts();
  out.packets = now.packets - at_opening_.packets;
  out.missing_packets = now.missing_packets - at_opening_.missing_packets;
  out.resend_requests = now.resend_requests - at_opening_.resend_requests;
  out.resent_packets = now.resent_packets - at_opening_.resent_packets;
  return out;
}

CameraStatistics AravisCamera::Connection::stream_counts() const {
  CameraStatistics out;
  const auto info = [&](const char* name) { return arv_stream_get_info_uint64_by_name(stream.get(), name); };
  out.packets = info("n_received_packets");
  out.missing_packets = info("n_missing_packets");
  out.resend_requests = info("n_resend_requests");
  out.resent_packets = info("n_resent_packets");
  return out;
}

AravisCamera::AravisCamera(AravisCameraOptions options) : options_(std::move(options)) {
  if (const std::string defect = defect_of_camera_address(options_.address); !defect.empty()) throw InputError(defect);
  connection_ = std::make_unique<Connection>(options_, std::nullopt);
}

AravisCamera::~AravisCamera() { close(); }

void AravisCamera::close() {
  if (!connection_ || !connection_->control_lost) {
    connection_.reset();
    return;
  }
  // Aravis says goodbye to a camera that is gone with nine seconds of time-outs. Nobody waits for that, and should the
  // camera come back meanwhile, it takes no order from one who no longer controls it.
  std::thread([gone = std::move(connection_)]() mutable { gone.reset(); }).detach();
}

void AravisCamera::reopen() {
  before_ = statistics();
  ++before_.reopened;
  close();
  connection_ = std::make_unique<Connection>(options_, exposure_ms_);
}

CameraStatistics AravisCamera::statistics() const {
  CameraStatistics out = before_;
  if (!connection_) return out;
  const CameraStatistics now = connection_->statistics();
  out.frames += now.frames;
  out.incomplete += now.incomplete;
  out.timeouts += now.timeouts;
  out.late_or_double += now.late_or_double;
  out.recounts += now.recounts;
  out.packets += now.packets;
  out.missing_packets += now.missing_packets;
  out.resend_requests += now.resend_requests;
  out.resent_packets += now.resent_packets;
  return out;
}

namespace {

void require_open(const void* connection, const std::string& address) {
  if (!connection) throw CameraLost(fmt::format("camera {}: it is not open", address));
}

}  // namespace

CameraFrame AravisCamera::take_frame(milliseconds limit) {
  require(limit.count() > 0, "a frame needs time");
  require_open(connection_.get(), options_.address);
  return connection_->take_frame(limit);
}

void AravisCamera::set_exposure_ms(double exposure_ms) {
  require_open(connection_.get(), options_.address);
  connection_->set_exposure_ms(exposure_ms);
  exposure_ms_ = exposure_ms;
}

double AravisCamera::exposure_ms() {
  require_open(connection_.get(), options_.address);
  Checked e(options_.address, "reading its exposure");
  const double us = arv_camera_get_exposure_time(connection_->camera.get(), e);
  e.check();
  return 1e-3 * us;
}

CameraIdentity AravisCamera::identity() {
  require_open(connection_.get(), options_.address);
  CameraIdentity out;
  const auto text = [&](const char* feature) {
    const char* value = nullptr;
    if (arv_camera_is_feature_available(connection_->camera.get(), feature, nullptr)) {
      value = arv_camera_get_string(connection_->camera.get(), feature, nullptr);
    }
    return std::string(value ? value : "");
  };
  out.vendor = text("DeviceVendorName");
  out.model = text("DeviceModelName");
  out.serial = text("DeviceSerialNumber");
  if (out.serial.empty()) out.serial = text("DeviceID");
  out.firmware = text("DeviceFirmwareVersion");
  if (out.firmware.empty()) out.firmware = text("DeviceVersion");
  out.width_px = connection_->width;
  out.height_px = connection_->height;
  out.bits = connection_->bits;
  return out;
}

CameraLink AravisCamera::link() {
  require_open(connection_.get(), options_.address);
  CameraLink out;
  out.socket_buffer_bytes = kSocketBufferBytes;
  Checked e(options_.address, "reading its packet size");
  out.packet_size_bytes = static_cast<int>(arv_camera_gv_get_packet_size(connection_->camera.get(), e));
  e.check();
  std::vector<double> times_ms;
  for (int i = 0; i < 20; ++i) {
    guint32 value = 0;
    const auto begin = Clock::now();
    arv_device_read_register(connection_->device.get(), kControlChannelPrivilege, &value, e);
    e.check();
    times_ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
  }
  std::nth_element(times_ms.begin(), times_ms.begin() + 10, times_ms.end());
  out.round_trip_ms = times_ms[10];
  return out;
}

}  // namespace fringecal::hw

#include "hw/virtual/byte_server.h"

#include "core/error.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pty.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <thread>
#include <utility>
#include <vector>

namespace fringecal::virt {
namespace {

namespace fs = std::filesystem;

/// A request that stands incomplete for so long is dropped, as the silence between telegrams does on a serial line.
constexpr int kSilence_ms = 200;

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }

 private:
  int fd_;
};

struct Connection {
  Descriptor fd;
  std::string received;
};

}  // namespace

struct ByteServer::State {
  Protocol protocol;
  Descriptor listener, wake{::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)}, pty_client_side;
  std::vector<Connection> connections;  // of the thread, once it runs
  bool terminal = false;
  int port = 0;
  std::string device;
  fs::path link;
  std::thread thread;

  void run();
  bool serve(Connection& connection);
  bool send(int fd, const std::string& bytes) const;
  /// True where the server is to end.
  bool wait(std::chrono::milliseconds duration) const {
    pollfd ended{.fd = wake.get(), .events = POLLIN, .revents = 0};
    return ::poll(&ended, 1, static_cast<int>(duration.count())) > 0;
  }
};

void ByteServer::State::run() {
  for (;;) {
    std::vector<pollfd> polled = {{.fd = wake.get(), .events = POLLIN, .revents = 0},
                                  {.fd = listener.get(), .events = POLLIN, .revents = 0}};
    bool incomplete = false;
    for (const Connection& c : connections) {
      polled.push_back({.fd = c.fd.get(), .events = POLLIN, .revents = 0});
      incomplete |= !c.received.empty();
    }
    const int ready = ::poll(polled.data(), polled.size(), incomplete ? kSilence_ms : -1);
    if (ready < 0 && errno != EINTR) return;
    if (polled[0].revents != 0) return;
    if (ready == 0) {
      for (Connection& c : connections) c.received.clear();
      continue;
    }
    std::vector<Connection> alive;
    for (std::size_t k = 0; k < connections.size(); ++k) {
      if (polled[k + 2].revents == 0 || serve(connections[k])) alive.push_back(std::move(connections[k]));
    }
    connections = std::move(alive);
    if (polled[1].revents != 0) {
      Descriptor fd(::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
      if (fd.get() < 0) continue;
      const int on = 1;
      ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      connections.push_back({std::move(fd), {}});
    }
  }
}

bool ByteServer::State::serve(Connection& connection) {
  std::array<char, 1024> bytes{};
  const ssize_t n = ::read(connection.fd.get(), bytes.data(), bytes.size());
  if (n < 0) return errno == EAGAIN || errno == EINTR;
  if (n == 0) return false;
  connection.received.append(bytes.data(), static_cast<std::size_t>(n));
  while (auto answer = protocol(connection.received)) {
    if (answer->delay.count() > 0 && wait(answer->delay)) return false;
    if (!answer->bytes.empty() && !send(connection.fd.get(), answer->bytes)) return terminal;
  }
  return true;
}

bool ByteServer::State::send(int fd, const std::string& bytes) const {
  // Answers are below 300 bytes: one that does not fit at once meets a client that does not read.
  const ssize_t n = terminal ? ::write(fd, bytes.data(), bytes.size())
                             : ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  return n == static_cast<ssize_t>(bytes.size());
}

ByteServer::ByteServer(std::unique_ptr<State> state) : state_(std::move(state)) {
  state_->thread = std::thread([s = state_.get()] { s->run(); });
}

ByteServer::~ByteServer() {
  const std::uint64_t one = 1;
  while (::write(state_->wake.get(), &one, sizeof one) < 0 && errno == EINTR) {
  }
  state_->thread.join();
  if (!state_->link.empty()) {
    std::error_code ignored;
    fs::remove(state_->link, ignored);
  }
}

int ByteServer::port() const { return state_->port; }
const std::string& ByteServer::device() const { return state_->device; }

std::unique_ptr<ByteServer> ByteServer::on_tcp(const std::string& host, int port, Protocol protocol) {
  const auto fail = [&](const char* operation) {
    throw EnvironmentError(fmt::format("{}:{}: {} failed ({}); choose another port, or 0 for a free one", host, port,
                                       operation, std::strerror(errno)));
  };
  auto state = std::make_unique<State>();
  state->protocol = std::move(protocol);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  errno = EINVAL;
  if (::inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1) fail("reading the address");
  state->listener = Descriptor(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (state->listener.get() < 0) fail("opening a socket");
  const int on = 1;
  ::setsockopt(state->listener.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  socklen_t size = sizeof address;
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  if (::bind(state->listener.get(), generic, size) != 0) fail("binding");
  if (::listen(state->listener.get(), 8) != 0) fail("listening");
  if (::getsockname(state->listener.get(), generic, &size) != 0) fail("asking for the port");
  state->port = ntohs(address.sin_port);
  return std::unique_ptr<ByteServer>(new ByteServer(std::move(state)));
}

std::unique_ptr<ByteServer> ByteServer::on_pty(const std::string& link, Protocol protocol) {
  const auto fail = [&](const std::string& operation, const std::string& cause) {
    throw EnvironmentError(
        fmt::format("{}: {} failed ({})", link.empty() ? "pseudo-terminal" : link, operation, cause));
  };
  auto state = std::make_unique<State>();
  state->protocol = std::move(protocol);
  state->terminal = true;
  int server_side = -1, client_side = -1;
  if (::openpty(&server_side, &client_side, nullptr, nullptr, nullptr) != 0) {
    fail("opening a pseudo-terminal", std::strerror(errno));
  }
  state->connections.push_back({Descriptor(server_side), {}});
  // Held open so that the line outlives its clients.
  state->pty_client_side = Descriptor(client_side);
  ::fcntl(server_side, F_SETFD, FD_CLOEXEC);
  ::fcntl(client_side, F_SETFD, FD_CLOEXEC);
  ::fcntl(server_side, F_SETFL, O_NONBLOCK);
  termios raw{};
  ::tcgetattr(client_side, &raw);
  ::cfmakeraw(&raw);
  ::tcsetattr(client_side, TCSANOW, &raw);
  std::array<char, 64> name{};
  if (::ttyname_r(client_side, name.data(), name.size()) != 0) fail("asking for its name", std::strerror(errno));
  state->device = name.data();
  if (!link.empty()) {
    std::error_code error;
    if (fs::is_symlink(link, error)) fs::remove(link, error);
    fs::create_symlink(state->device, link, error);
    if (error) fail("making a link to the pseudo-terminal", error.message());
    state->link = link;
    state->device = link;
  }
  return std::unique_ptr<ByteServer>(new ByteServer(std::move(state)));
}

}  // namespace fringecal::virt

#include "hw/serial_port.h"

#include "core/error.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>

namespace fringecal::hw {
namespace {

using SteadyClock = std::chrono::steady_clock;

[[noreturn]] void fail(const std::string& operation) {
  throw std::system_error(errno, std::generic_category(), operation);
}

speed_t speed_of(int baud) {
  switch (baud) {
    case 1200:
      return B1200;
    case 2400:
      return B2400;
    case 4800:
      return B4800;
    case 9600:
      return B9600;
    case 19200:
      return B19200;
    case 38400:
      return B38400;
    case 57600:
      return B57600;
    case 115200:
      return B115200;
    case 230400:
      return B230400;
    default:
      throw std::logic_error("broken contract: a serial line has one of the speeds of parse_plc_address");
  }
}

/// A pseudo-terminal has no parity; asked for it, the C library reports an invalid argument, though not always.
bool is_pseudo_terminal(int fd) {
  struct stat info {};
  const bool known = ::fstat(fd, &info) == 0 && S_ISCHR(info.st_mode);
  return known && major(info.st_rdev) >= 136 && major(info.st_rdev) <= 143;  // Linux: UNIX98_PTY_SLAVE_MAJOR
}

int milliseconds_until(SteadyClock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - SteadyClock::now()).count();
  return left > 0 ? static_cast<int>(left) : 0;
}

}  // namespace

SerialPort::SerialPort(const SerialLine& line) {
  fd_ = ::open(line.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) fail("opening the serial line");
  termios settings{};
  if (::tcgetattr(fd_, &settings) != 0) {
    const int error = errno;
    ::close(fd_);
    throw std::system_error(error, std::generic_category(), "asking for the serial line's settings");
  }
  ::cfmakeraw(&settings);
  settings.c_cflag |= CLOCAL | CREAD | CS8;
  settings.c_cflag &= ~static_cast<tcflag_t>(PARENB | PARODD | CSTOPB | CRTSCTS);
  if (line.parity != Parity::none && !is_pseudo_terminal(fd_)) settings.c_cflag |= PARENB;
  if (line.parity == Parity::odd) settings.c_cflag |= PARODD;
  if (line.stop_bits == 2) settings.c_cflag |= CSTOPB;
  settings.c_cc[VMIN] = 0;
  settings.c_cc[VTIME] = 0;
  ::cfsetispeed(&settings, speed_of(line.baud));
  ::cfsetospeed(&settings, speed_of(line.baud));
  if (::tcsetattr(fd_, TCSANOW, &settings) != 0) {
    const int error = errno;
    ::close(fd_);
    throw std::system_error(error, std::generic_category(), "setting up the serial line");
  }
}

SerialPort::~SerialPort() { ::close(fd_); }

void SerialPort::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
    if (n > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
    } else if (errno == EAGAIN) {
      pollfd line{.fd = fd_, .events = POLLOUT, .revents = 0};
      // 118 characters take 1.1 s at 1200 baud; a line that takes none for two seconds is blocked.
      if (::poll(&line, 1, 2000) == 0) {
        errno = ETIMEDOUT;
        fail("writing to the serial line");
      }
    } else if (errno != EINTR) {
      fail("writing to the serial line");
    }
  }
}

std::optional<std::string> SerialPort::read_until(char terminator, std::size_t most_bytes,
                                                  std::chrono::milliseconds limit) {
  const auto deadline = SteadyClock::now() + limit;
  std::string bytes;
  while (bytes.size() < most_bytes) {
    pollfd line{.fd = fd_, .events = POLLIN, .revents = 0};
    const int ready = ::poll(&line, 1, milliseconds_until(deadline));
    if (ready < 0 && errno != EINTR) fail("waiting for the serial line");
    if (ready == 0) return std::nullopt;
    char byte = 0;
    const ssize_t n = ::read(fd_, &byte, 1);
    if (n == 1) {
      bytes.push_back(byte);
      if (byte == terminator) return bytes;
    } else if (n == 0) {
      errno = ENODEV;  // hung up
      fail("reading from the serial line");
    } else if (errno != EAGAIN && errno != EINTR) {
      fail("reading from the serial line");
    }
  }
  return std::nullopt;
}

void SerialPort::drain(std::chrono::milliseconds silence) {
  const auto deadline = SteadyClock::now() + 4 * silence;
  std::array<char, 256> waste{};
  while (SteadyClock::now() < deadline) {
    pollfd line{.fd = fd_, .events = POLLIN, .revents = 0};
    if (::poll(&line, 1, static_cast<int>(silence.count())) <= 0) return;
    if (::read(fd_, waste.data(), waste.size()) <= 0) return;
  }
}

void SerialPort::flush() { ::tcflush(fd_, TCIFLUSH); }

}  // namespace fringecal::hw

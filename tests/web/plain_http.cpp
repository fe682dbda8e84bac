#include "tests/web/plain_http.h"

#include "tests/web/served.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <stdexcept>

namespace fringecal::test {
namespace {

/// Puts chunks together (RFC 9112, 7.1).
std::string unchunked(const std::string& body) {
  std::string out;
  for (std::size_t at = 0; at < body.size();) {
    const std::size_t end = body.find("\r\n", at);
    if (end == std::string::npos) break;
    const std::size_t size = std::stoul(body.substr(at, end - at), nullptr, 16);
    out += body.substr(end + 2, size);
    at = end + 2 + size + 2;
    if (size == 0) break;
  }
  return out;
}

/// False while more is to come.
bool parse(const std::string& bytes, Answer& out) {
  const std::size_t head = bytes.find("\r\n\r\n");
  if (head == std::string::npos) return false;
  out = {};
  out.status = std::atoi(bytes.c_str() + 9);
  for (std::size_t at = bytes.find("\r\n") + 2; at < head + 2;) {
    const std::size_t end = bytes.find("\r\n", at), colon = bytes.find(':', at);
    std::string name = bytes.substr(at, colon - at);
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    const std::size_t value = std::min(bytes.find_first_not_of(' ', colon + 1), end);
    out.headers.emplace(name, bytes.substr(value, end - value));
    at = end + 2;
  }
  out.body = bytes.substr(head + 4);
  if (const std::string length = out.header("content-length"); !length.empty()) {
    return out.body.size() >= std::stoul(length);
  }
  if (out.header("transfer-encoding") == "chunked") {
    const bool whole = out.body.ends_with("0\r\n\r\n");
    if (whole) out.body = unchunked(out.body);
    return whole;
  }
  return false;
}

}  // namespace

int connect_to(int port) {
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (s >= 0 && ::connect(s, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0) return s;
  if (s >= 0) ::close(s);
  return -1;
}

Answer talk(int port, const std::string& request, double limit_s) {
  Answer out;
  const int s = connect_to(port);
  if (s < 0) return out;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(limit_s);
  std::string received;
  std::size_t sent = 0;
  bool writing = true;
  while (std::chrono::steady_clock::now() < deadline) {
    if (sent == request.size()) writing = false;
    pollfd p{s, static_cast<short>(POLLIN | (writing ? POLLOUT : 0)), 0};
    if (::poll(&p, 1, 100) < 0) break;
    if (p.revents & POLLOUT) {
      const ssize_t n = ::send(s, request.data() + sent, std::min<std::size_t>(65536, request.size() - sent),
                               MSG_NOSIGNAL | MSG_DONTWAIT);
      if (n > 0) sent += static_cast<std::size_t>(n);
      if (n < 0 && errno != EAGAIN) writing = false;
    }
    if (p.revents & (POLLIN | POLLHUP | POLLERR)) {
      char part[65536];
      const ssize_t n = ::recv(s, part, sizeof part, MSG_DONTWAIT);
      if (n < 0 && errno == EAGAIN) continue;
      if (n <= 0) break;
      received.append(part, static_cast<std::size_t>(n));
      if (parse(received, out)) break;
    }
  }
  ::close(s);
  parse(received, out);
  return out;
}

int Served::free_port() {
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof at;
  const bool bound = s >= 0 && ::bind(s, reinterpret_cast<sockaddr*>(&at), sizeof at) == 0 &&
                     ::getsockname(s, reinterpret_cast<sockaddr*>(&at), &size) == 0;
  if (s >= 0) ::close(s);
  if (!bound) throw std::runtime_error("no free port");
  return ntohs(at.sin_port);
}

}  // namespace fringecal::test

#include "cli/serve/connection.h"

#include "cli/serve/http.h"

#include <fcntl.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace fringecal::cli::serve {

Connection::Connection(int socket, ssl_ctx_st* tls)
    : socket_(socket), deadline_(Clock::now() + kRequestLimit), left_(kMaxRequestBytes) {
  fcntl(socket_, F_SETFL, fcntl(socket_, F_GETFL) | O_NONBLOCK);
  if (!tls) return;
  ssl_ = SSL_new(tls);
  good_ = ssl_ != nullptr && SSL_set_fd(ssl_, socket_) == 1;
  while (good_) {
    const int code = SSL_accept(ssl_);
    if (code == 1) return;
    good_ = again(code, deadline_);
  }
}

Connection::~Connection() {
  if (ssl_ && good_) SSL_shutdown(ssl_);
  SSL_free(ssl_);
  ::shutdown(socket_, SHUT_RDWR);
  ::close(socket_);
}

bool Connection::wait(short events, Clock::time_point until) const {
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    if (left <= 0) return false;
    pollfd watched{socket_, events, 0};
    const int ready = ::poll(&watched, 1, static_cast<int>(left));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

bool Connection::again(int code, Clock::time_point until) const {
  switch (SSL_get_error(ssl_, code)) {
    case SSL_ERROR_WANT_READ:
      return wait(POLLIN, until);
    case SSL_ERROR_WANT_WRITE:
      return wait(POLLOUT, until);
    default:
      return false;
  }
}

bool Connection::wait_readable() { return (ssl_ && SSL_pending(ssl_) > 0) || wait(POLLIN, deadline_); }

bool Connection::wait_writable() { return wait(POLLOUT, Clock::now() + kWriteLimit); }

long Connection::read(char* to, std::size_t size) {
  size = std::min(size, left_);
  if (size == 0) return -1;
  for (;;) {
    if (!wait_readable()) return -1;
    long count = 0;
    if (ssl_) {
      count = SSL_read(ssl_, to, static_cast<int>(size));
      if (count <= 0 && again(static_cast<int>(count), deadline_)) continue;
    } else {
      count = ::recv(socket_, to, size, 0);
      if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    }
    if (count > 0) left_ -= static_cast<std::size_t>(count);
    return count;
  }
}

long Connection::write(const char* from, std::size_t size) {
  const auto until = Clock::now() + kWriteLimit;
  for (;;) {
    if (!wait(POLLOUT, until)) return -1;
    long count = 0;
    if (ssl_) {
      count = SSL_write(ssl_, from, static_cast<int>(size));
      if (count <= 0 && again(static_cast<int>(count), until)) continue;
    } else {
      count = ::send(socket_, from, size, MSG_NOSIGNAL);
      if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    }
    return count;
  }
}

}  // namespace fringecal::cli::serve

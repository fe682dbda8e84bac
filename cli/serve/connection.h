// One accepted connection, plain or under TLS, with the limits of cli/serve/http.h: all waiting ends at a deadline.
#pragma once

#include <chrono>
#include <memory>
#include <string>

struct ssl_st;
struct ssl_ctx_st;

namespace fringecal::cli::serve {

class Connection {
 public:
  /// Takes the socket over. tls: null for plain HTTP; otherwise the handshake is made here, see good().
  Connection(int socket, ssl_ctx_st* tls);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool good() const { return good_; }
  int socket() const { return socket_; }
  /// Waits for input or for room. False at the deadline of the request, or after kWriteLimit.
  bool wait_readable();
  bool wait_writable();
  /// Bytes moved, 0 at the end of the stream, -1 on failure, at the deadline or beyond the size limit.
  long read(char* to, std::size_t size);
  long write(const char* from, std::size_t size);

 private:
  using Clock = std::chrono::steady_clock;
  bool wait(short events, Clock::time_point until) const;
  /// Whether the TLS call that returned `code` may be made again.
  bool again(int code, Clock::time_point until) const;

  int socket_;
  ssl_st* ssl_ = nullptr;
  bool good_ = true;
  Clock::time_point deadline_;
  std::size_t left_;
};

}  // namespace fringecal::cli::serve

// ByteServer: one thread that serves a byte protocol on a TCP socket or on a pseudo-terminal (a serial line without
// wires). The protocol is a function from received bytes to an answer; it knows nothing of sockets.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace fringecal::virt {

class ByteServer {
 public:
  struct Answer {
    std::string bytes;                   // empty: swallowed
    std::chrono::milliseconds delay{0};  // sent so much later
  };
  /// Takes one complete request off the front of `received` and answers it; nothing where it is not complete yet.
  /// Called by the server's thread only.
  using Protocol = std::function<std::optional<Answer>(std::string& received)>;

  /// host: an IPv4 address of this machine; port 0: the system chooses, port() tells. Throws EnvironmentError.
  static std::unique_ptr<ByteServer> on_tcp(const std::string& host, int port, Protocol protocol);
  /// link: a symbolic link to the terminal, made here and removed at the end; empty: none. Throws EnvironmentError.
  static std::unique_ptr<ByteServer> on_pty(const std::string& link, Protocol protocol);
  /// Stops serving and closes every connection.
  ~ByteServer();

  int port() const;
  /// The terminal (or the link to it) that a client opens.
  const std::string& device() const;

 private:
  struct State;
  explicit ByteServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace fringecal::virt

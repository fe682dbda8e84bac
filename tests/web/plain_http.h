// HTTP as bytes on a socket: what a client sends is exactly what the test wrote.
#pragma once

#include <map>
#include <string>

namespace fringecal::test {

struct Answer {
  int status = 0;                                   // 0: closed without an answer
  std::multimap<std::string, std::string> headers;  // names in lower case
  std::string body;
  std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? "" : found->second;
  }
};

/// A connected socket of 127.0.0.1, or -1.
int connect_to(int port);

/// Sends and reads until the other side closes, all that Content-Length says is there, or the limit.
Answer talk(int port, const std::string& request, double limit_s = 30);

}  // namespace fringecal::test

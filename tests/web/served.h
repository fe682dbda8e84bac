// `fringecal serve` on a folder, and a browser's session with it, as bytes.
#pragma once

#include "core/value.h"
#include "tests/support/program.h"
#include "tests/web/plain_http.h"

#include <memory>
#include <string>
#include <vector>

namespace fringecal::test {

class Served {
 public:
  /// Starts the server on a free port and takes a session by the printed address.
  explicit Served(const std::filesystem::path& folder, int port = free_port()) {
    std::vector<std::string> words = {"serve", folder.string(), "--port", std::to_string(port)};
    program_ = std::make_unique<RunningProgram>(words);
    address_ = program_->line();
    const auto colon = address_.rfind(':'), slash = address_.find('/', colon);
    if (colon == std::string::npos || slash == std::string::npos) throw std::runtime_error("not served: " + address_);
    port_ = std::stoi(address_.substr(colon + 1, slash - colon - 1));
    first_ = address_.substr(slash);
  }
  /// Uses the one-time address up.
  void sign_in() {
    const Answer a = get(first_);
    const std::string cookie = a.header("set-cookie");
    cookie_ = cookie.substr(0, cookie.find(';'));
  }

  Answer get(const std::string& path) const { return talk(port_, request("GET", path, own() + cookie_line())); }
  Answer post(const std::string& path, const std::string& body) const {
    return talk(port_, request("POST", path,
                               own() + cookie_line() + "Origin: http://" + host() +
                                   "\r\nContent-Type: application/json\r\nContent-Length: " +
                                   std::to_string(body.size()) + "\r\n") +
                           body);
  }
  Value state() const { return parse_json(get("/api/state").body, "state"); }

  static std::string request(const std::string& method, const std::string& path, const std::string& headers) {
    return method + " " + path + " HTTP/1.1\r\n" + headers + "\r\n";
  }
  std::string host() const { return "127.0.0.1:" + std::to_string(port_); }
  std::string own() const { return "Host: " + host() + "\r\n"; }
  std::string cookie_line() const { return cookie_.empty() ? "" : "Cookie: " + cookie_ + "\r\n"; }
  const std::string& cookie() const { return cookie_; }
  const std::string& address() const { return address_; }
  const std::string& first_path() const { return first_; }
  int port() const { return port_; }
  RunningProgram& program() { return *program_; }

 private:
 public:
  /// Of 127.0.0.1, at this moment.
  static int free_port();

 private:
  std::unique_ptr<RunningProgram> program_;
  std::string address_, first_, cookie_;
  int port_ = 0;
};

}  // namespace fringecal::test

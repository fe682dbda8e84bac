// A time-stamping authority on the loopback interface, for tests: `openssl ts -reply` behind an HTTP server.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace fringecal::test {

class StampingAuthority {
 public:
  enum class Validity { of_today, ended };  // of the authority's certificate

  /// Makes a root and the authority's certificate in the folder.
  explicit StampingAuthority(const std::filesystem::path& folder, Validity validity = Validity::of_today);
  ~StampingAuthority();

  std::filesystem::path root() const { return folder_ / "root.pem"; }
  /// The DER answer to a DER request.
  std::string answer(const std::string& request) const;
  /// /stamp answers; the others misbehave: /status (500), /moved (a redirect to /stamp), /html, /long (without end),
  /// /silent (nothing for 30 s), /drip (a byte each 0.2 s), /replay (always the first answer that was given).
  std::string url(const std::string& path = "/stamp") const;
  int answers_given() const;

 private:
  struct Server;
  std::filesystem::path folder_;
  std::unique_ptr<Server> server_;
};

}  // namespace fringecal::test

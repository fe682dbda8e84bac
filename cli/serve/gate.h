// Who may ask: every request passes here before anything else looks at it, in this order.
//
//   Host    one of this server's own names with its port, else 421                       (a name rebound to 127.0.0.1)
//   Origin  where the request has one: this server's own, else 403. A POST must have one (a page of another origin)
//   Type    a POST is application/json, else 415                                         (a form of another page)
//   Session the cookie of a session, else 401. What is open without: the sign-in page, its style, its POST
//
// A session begins with the one-time token of the printed address, GET /?token=..., or, where a password is set, with
// POST /sign-in {"password": ...}: one attempt a second. The token is used up by its first use, and a new one is made.
// The cookie is HttpOnly, SameSite=Strict, Secure under TLS, and named after the port, because cookies are shared by all
// ports of a host. Sessions last kSessionLimit; kept on disk are their SHA-256 only, so that a server that is started
// again knows its browsers, and a reader of the file gains nothing.
#pragma once

#include "cli/serve/http.h"

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli::serve {

inline constexpr std::chrono::hours kSessionLimit{24 * 7};
inline constexpr std::size_t kMaxSessions = 32;  // the oldest goes

struct GateOptions {
  std::vector<std::string> hosts;  // "127.0.0.1:8750"
  bool tls = false;
  std::string password_sha256;          // empty: by token only
  std::filesystem::path sessions_file;  // where they are kept
  std::function<void(const std::string& token)> on_new_token = {};
};

class Gate {
 public:
  explicit Gate(GateOptions options);
  /// What to answer at once; nothing where the request may go on.
  std::optional<HttpResponse> check(const HttpRequest& request);
  /// POST /sign-in, which check() lets through.
  HttpResponse sign_in(const std::string& password);
  std::string token() const;
  bool by_password() const { return !options_.password_sha256.empty(); }

 private:
  std::optional<HttpResponse> check_origin(const HttpRequest& request) const;
  bool has_session(const std::string& cookies);
  HttpResponse begin_session();
  void load();
  void keep() const;

  GateOptions options_;
  mutable std::mutex mutex_;
  std::string token_;
  std::map<std::string, std::int64_t> sessions_;  // SHA-256 of the cookie's value, end in seconds since 1970
  std::chrono::steady_clock::time_point next_attempt_{};
};

/// The headers that every answer has: nothing from elsewhere, nothing inline, no frame, no guess, no copy kept.
std::vector<std::pair<std::string, std::string>> safe_headers();

/// 256 random bits, hexadecimal. Throws EnvironmentError.
std::string random_word();

}  // namespace fringecal::cli::serve

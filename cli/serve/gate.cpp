#include "cli/serve/gate.h"

#include "core/error.h"
#include "core/file.h"
#include "core/value.h"

#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <fstream>

namespace fringecal::cli::serve {
namespace {

constexpr std::string_view kOpen[] = {"/sign-in", "/style.css", "/sign-in.js", "/favicon.svg"};

std::int64_t now_s() { return static_cast<std::int64_t>(std::time(nullptr)); }

/// Equal or not, in a time that does not say how much of it is equal: what is compared are hashes.
bool same(const std::string& a, const std::string& b) { return sha256_hex(a) == sha256_hex(b); }

/// The value of a cookie; empty where it is absent.
std::string cookie_in(const std::string& header, const std::string& name) {
  for (std::size_t at = 0; at < header.size();) {
    const std::size_t end = std::min(header.find(';', at), header.size());
    at = std::min(header.find_first_not_of(' ', at), end);
    if (header.compare(at, name.size() + 1, name + "=") == 0) {
      return header.substr(at + name.size() + 1, end - at - name.size() - 1);
    }
    at = end + 1;
  }
  return "";
}

HttpResponse refusal(int status, const char* sentence) {
  return {.status = status, .type = "text/plain; charset=utf-8", .body = std::string(sentence) + "\n"};
}

}  // namespace

std::string random_word() {
  std::array<unsigned char, 32> bytes;
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw EnvironmentError("serve: this machine gives no random numbers");
  }
  std::string out;
  for (const unsigned char byte : bytes) out += fmt::format("{:02x}", byte);
  return out;
}

std::vector<std::pair<std::string, std::string>> safe_headers() {
  return {{"Content-Security-Policy",
           "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
           "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
          {"X-Content-Type-Options", "nosniff"},
          {"Referrer-Policy", "no-referrer"},
          {"Cross-Origin-Opener-Policy", "same-origin"},
          {"Cross-Origin-Resource-Policy", "same-origin"},
          {"Cache-Control", "no-store"}};
}

Gate::Gate(GateOptions options) : options_(std::move(options)), token_(random_word()) {
  require(!options_.hosts.empty(), "a server has a name");
  load();
}

std::string Gate::token() const {
  const std::lock_guard hold(mutex_);
  return token_;
}

std::optional<HttpResponse> Gate::check_origin(const HttpRequest& request) const {
  const auto ours = [&](const std::string& host) {
    return std::find(options_.hosts.begin(), options_.hosts.end(), host) != options_.hosts.end();
  };
  if (!ours(request.host)) return refusal(421, "This server is not the one that was asked for.");
  const std::string scheme = options_.tls ? "https://" : "http://";
  const bool own = request.origin.starts_with(scheme) && request.origin.substr(scheme.size()) == request.host;
  if (!request.origin.empty() && !own) return refusal(403, "Requests from other pages are refused.");
  if (request.method != "POST") return std::nullopt;
  if (request.origin.empty()) return refusal(403, "A change needs the header Origin.");
  if (!request.content_type.starts_with("application/json")) return refusal(415, "A change is sent as JSON.");
  return std::nullopt;
}

std::optional<HttpResponse> Gate::check(const HttpRequest& request) {
  if (auto refused = check_origin(request)) return refused;
  if (request.path == "/" && request.method == "GET" && request.query.contains("token")) {
    {
      const std::lock_guard hold(mutex_);
      if (!same(request.query.at("token"), token_)) {
        return refusal(401, "This address was used already. Open the newest one that fringecal serve has printed.");
      }
      token_ = random_word();
      if (options_.on_new_token) options_.on_new_token(token_);
    }
    return begin_session();
  }
  if (by_password() && std::find(std::begin(kOpen), std::end(kOpen), request.path) != std::end(kOpen)) {
    return std::nullopt;
  }
  if (has_session(request.cookie)) return std::nullopt;
  if (by_password() && request.path == "/") return HttpResponse{.status = 303, .headers = {{"Location", "/sign-in"}}};
  return refusal(401, "Open the address that fringecal serve has printed; it holds the key to this page.");
}

HttpResponse Gate::sign_in(const std::string& password) {
  {
    const std::lock_guard hold(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (now < next_attempt_) return refusal(429, "One attempt a second.");
    next_attempt_ = now + std::chrono::seconds(1);
    if (!by_password() || sha256_hex(password) != options_.password_sha256) {
      return refusal(401, "This is not the password.");
    }
    next_attempt_ = {};
  }
  return begin_session();
}

bool Gate::has_session(const std::string& cookies) {
  const std::string word =
      cookie_in(cookies, "fringecal_" + options_.hosts.front().substr(options_.hosts.front().rfind(':') + 1));
  if (word.empty()) return false;
  const std::lock_guard hold(mutex_);
  const auto found = sessions_.find(sha256_hex(word));
  return found != sessions_.end() && found->second > now_s();
}

HttpResponse Gate::begin_session() {
  const std::string word = random_word();
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(kSessionLimit).count();
  {
    const std::lock_guard hold(mutex_);
    std::erase_if(sessions_, [](const auto& session) { return session.second <= now_s(); });
    if (sessions_.size() >= kMaxSessions) {
      sessions_.erase(std::min_element(sessions_.begin(), sessions_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; }));
    }
    sessions_[sha256_hex(word)] = now_s() + seconds;
    keep();
  }
  const std::string& host = options_.hosts.front();
  return {.status = 303,
          .headers = {{"Location", "/"},
                      {"Set-Cookie",
                       fmt::format("fringecal_{}={}; Path=/; Max-Age={}; HttpOnly; SameSite=Strict{}",
                                   host.substr(host.rfind(':') + 1), word, seconds, options_.tls ? "; Secure" : "")}}};
}

void Gate::load() {
  std::error_code error;
  if (options_.sessions_file.empty() || !std::filesystem::exists(options_.sessions_file, error)) return;
  try {
    const Value kept = read_json(options_.sessions_file);
    if (const auto* all = kept.if_object()) {
      for (const auto& [hash, end] : *all) {
        if (end.if_integer() && *end.if_integer() > now_s()) sessions_[hash] = *end.if_integer();
      }
    }
  } catch (const InputError&) {  // damaged: everybody signs in again
  }
}

void Gate::keep() const {
  if (options_.sessions_file.empty()) return;
  Value out = Value::object();
  for (const auto& [hash, end] : sessions_) out.set(hash, end);
  write_atomically(options_.sessions_file, to_json(out));
  chmod(options_.sessions_file.c_str(), S_IRUSR | S_IWUSR);
}

}  // namespace fringecal::cli::serve

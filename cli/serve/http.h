// What a request and an answer are to the pages, and the server that carries them: bounded in everything that a client
// can make large.
//
//   connections  kWorkers are served at a time, kWaiting wait; the next one gets 503 and is closed at once           (1)
//   request      head and body within kRequestLimit of time and kMaxRequestBytes of size, else it is closed          (2)
//   body         at most kMaxBodyBytes, else 413                                                                     (3)
//   answer       a client that takes nothing for kWriteLimit is closed                                               (4)
//   streams      at most kMaxStreams of the workers hold a stream of events; the next one gets 503                   (5)
//   path         decoded; a segment "..", a backslash or a control character: 400 before anything looks at it        (6)
// Each connection carries one request. No method but GET, HEAD and POST. Nothing is read from disk here.
// TLS 1.2 and newer, where a certificate is given.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace fringecal::cli::serve {

inline constexpr std::size_t kWorkers = 24, kWaiting = 64, kMaxStreams = 12;
inline constexpr std::size_t kMaxBodyBytes = 64 * 1024, kMaxRequestBytes = 128 * 1024;
inline constexpr std::chrono::seconds kRequestLimit{5}, kWriteLimit{10};

struct HttpRequest {
  std::string method, path, body;
  std::map<std::string, std::string> query;
  /// Empty where the request has none, or has it twice: nothing that decides may be ambiguous.
  std::string host, origin, cookie, content_type;
};

struct HttpResponse {
  int status = 200;
  std::string type = "application/json; charset=utf-8";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  /// Server-sent events: called again and again, each call waits at most a second; the text of an event, "" where
  /// nothing happened, nothing at the end. Absent: `body` is the answer.
  std::function<std::optional<std::string>()> events;
};

struct HttpOptions {
  std::string address = "127.0.0.1";
  int port = 0;                                              // 0: a free one
  std::string certificate, key;                              // PEM files; both empty: plain HTTP
  std::vector<std::pair<std::string, std::string>> headers;  // of every answer that has not its own of that name
};

class HttpServer {
 public:
  /// May answer before the body is read: nothing where the request shall go on to the handler.
  using Gate = std::function<std::optional<HttpResponse>(const HttpRequest&)>;
  using Handler = std::function<HttpResponse(const HttpRequest&)>;

  /// Listens when constructed. Throws EnvironmentError (address in use), InputError (certificate or key).
  HttpServer(const HttpOptions& options, Gate gate, Handler handler);
  ~HttpServer();
  int port() const;
  /// Until stop(), which any thread may call.
  void run();
  void stop();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace fringecal::cli::serve

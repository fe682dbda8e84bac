// The only file that includes cpp-httplib: its parser and its answers, over connections of our own (connection.h).
#include "cli/serve/http.h"

#include "cli/serve/connection.h"
#include "core/error.h"

#include <fmt/format.h>
#include <httplib.h>
#include <netinet/tcp.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <atomic>

namespace fringecal::cli::serve {
namespace {

/// httplib's view of a Connection. Its bytes come through a buffer: httplib asks for a header's one by one.
class Bytes final : public httplib::Stream {
 public:
  explicit Bytes(Connection& connection) : connection_(connection) {}
  bool is_readable() const override { return begin_ < end_ || connection_.wait_readable(); }
  bool is_writable() const override { return connection_.wait_writable(); }
  ssize_t read(char* to, size_t size) override {
    if (begin_ == end_) {
      const long count = connection_.read(buffer_.data(), buffer_.size());
      if (count <= 0) return count;
      begin_ = 0;
      end_ = static_cast<std::size_t>(count);
    }
    const std::size_t count = std::min(size, end_ - begin_);
    std::copy_n(buffer_.data() + begin_, count, to);
    begin_ += count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* from, size_t size) override { return connection_.write(from, size); }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  socket_t socket() const override { return connection_.socket(); }

 private:
  Connection& connection_;
  std::array<char, 4096> buffer_;
  std::size_t begin_ = 0, end_ = 0;
};

thread_local bool refusing = false;  // the accepting thread, while all places are taken

/// Workers and waiting places, eq. 1. Where all are taken, the accepting thread itself refuses.
class BoundedQueue final : public httplib::TaskQueue {
 public:
  BoundedQueue() : pool_(kWorkers) {}
  void enqueue(std::function<void()> work) override {
    if (present_.fetch_add(1) >= kWorkers + kWaiting) {
      refusing = true;
      work();
      refusing = false;
      present_.fetch_sub(1);
      return;
    }
    pool_.enqueue([this, work = std::move(work)] {
      work();
      present_.fetch_sub(1);
    });
  }
  void shutdown() override { pool_.shutdown(); }

 private:
  std::atomic<std::size_t> present_{0};
  httplib::ThreadPool pool_;
};

class Server final : public httplib::Server {
 public:
  explicit Server(SSL_CTX* tls) : tls_(tls) {}
  /// httplib listens with room for five: the sixth connection that comes at once would wait a second for its next try.
  void make_room() { ::listen(svr_sock_, kBacklog); }

 private:
  static constexpr int kBacklog = 1024;
  bool process_and_close_socket(socket_t socket) override {
    if (refusing) {
      constexpr std::string_view kBusy =
          "HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";
      if (!tls_) ::send(socket, kBusy.data(), kBusy.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
      ::close(socket);
      return true;
    }
    Connection connection(socket, tls_);
    if (!connection.good()) return false;
    Bytes bytes(connection);
    bool closed = false;
    return process_request(bytes, true, closed, nullptr);
  }

  SSL_CTX* tls_;
};

std::string single(const httplib::Request& from, const char* header) {
  return from.get_header_value_count(header) == 1 ? from.get_header_value(header) : "";
}

HttpRequest request_from(const httplib::Request& from) {
  HttpRequest out{from.method,
                  from.path,
                  from.body,
                  {},
                  single(from, "Host"),
                  single(from, "Origin"),
                  single(from, "Cookie"),
                  single(from, "Content-Type")};
  for (const auto& [name, value] : from.params) out.query.emplace(name, value);
  return out;
}

/// Eq. 6. The path is decoded once, as whoever opens a file would see it.
bool acceptable(const std::string& path) {
  if (!path.starts_with('/') || path.find('\\') != std::string::npos) return false;
  if (std::any_of(path.begin(), path.end(), [](unsigned char c) { return c < 32 || c == 127; })) return false;
  for (std::size_t at = 0; at < path.size();) {
    const std::size_t end = std::min(path.find('/', at + 1), path.size());
    if (path.compare(at, end - at, "/..") == 0) return false;
    at = end;
  }
  return true;
}

SSL_CTX* tls_context(const HttpOptions& options) {
  if (options.certificate.empty() && options.key.empty()) return nullptr;
  SSL_CTX* context = SSL_CTX_new(TLS_server_method());
  require(context != nullptr, "OpenSSL has a TLS server");
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  SSL_CTX_set_mode(context, SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER);
  const auto refuse = [&](const std::string& file, const char* what) {
    SSL_CTX_free(context);
    throw InputError(fmt::format("{}: not {} in PEM form that belongs with the other one", file, what));
  };
  if (SSL_CTX_use_certificate_chain_file(context, options.certificate.c_str()) != 1) {
    refuse(options.certificate, "a certificate");
  }
  if (SSL_CTX_use_PrivateKey_file(context, options.key.c_str(), SSL_FILETYPE_PEM) != 1 ||
      SSL_CTX_check_private_key(context) != 1) {
    refuse(options.key, "a private key");
  }
  return context;
}

}  // namespace

struct HttpServer::State {
  SSL_CTX* tls;
  Server server;
  Gate gate;
  Handler handler;
  std::vector<std::pair<std::string, std::string>> headers;
  int port = 0;
  std::atomic<std::size_t> streams{0};
  std::atomic<bool> stopping{false};

  State(const HttpOptions& options, Gate g, Handler h)
      : tls(tls_context(options)), server(tls), gate(std::move(g)), handler(std::move(h)), headers(options.headers) {}
  ~State() { SSL_CTX_free(tls); }

  void stream(httplib::Response& to, std::function<std::optional<std::string>()> events) {
    if (streams.fetch_add(1) >= kMaxStreams) {
      streams.fetch_sub(1);
      to.status = 503;  // eq. 5
      return;
    }
    to.set_chunked_content_provider(
        "text/event-stream",
        [this, events = std::move(events)](std::size_t, httplib::DataSink& sink) {
          if (stopping) return false;
          const auto event = events();
          if (!event) {
            sink.done();
            return true;
          }
          const std::string text = event->empty() ? ":\n\n" : *event;  // a comment: finds clients that are gone
          return sink.write(text.data(), text.size());
        },
        [this](bool) { streams.fetch_sub(1); });
  }

  void answer(httplib::Response& to, HttpResponse from) {
    to.status = from.status;
    for (const auto& [name, value] : from.headers) to.set_header(name, value);
    for (const auto& [name, value] : headers) {
      if (!to.has_header(name)) to.set_header(name, value);
    }
    if (from.events) return stream(to, std::move(from.events));
    if (from.body.empty()) return;
    // A provider with a length: set_content() would have the answer compressed, which costs more than loopback.
    auto body = std::make_shared<const std::string>(std::move(from.body));
    to.set_content_provider(body->size(), from.type, [body](std::size_t at, std::size_t size, httplib::DataSink& sink) {
      return sink.write(body->data() + at, std::min(size, body->size() - at));
    });
  }

  void install() {
    server.new_task_queue = [] { return new BoundedQueue; };
    server.set_payload_max_length(kMaxBodyBytes);
    server.set_socket_options([](socket_t socket) {
      const int on = 1, seconds = 2;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
      // A browser's idle connection in reserve takes no worker: it is accepted when it says something.
      setsockopt(socket, IPPROTO_TCP, TCP_DEFER_ACCEPT, &seconds, sizeof seconds);
    });
    server.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      using Next = httplib::Server::HandlerResponse;
      const bool known = request.method == "GET" || request.method == "HEAD" || request.method == "POST";
      std::optional<HttpResponse> early;
      if (!known) early = HttpResponse{.status = 405};
      if (known && !acceptable(request.path)) early = HttpResponse{.status = 400};
      if (!early) early = gate(request_from(request));
      if (!early) return Next::Unhandled;
      answer(response, std::move(*early));
      return Next::Handled;
    });
    const auto handle = [this](const httplib::Request& request, httplib::Response& response) {
      answer(response, handler(request_from(request)));
    };
    server.Get(".*", handle);
    server.Post(".*", handle);
    server.set_exception_handler(
        [](const httplib::Request& request, httplib::Response& response, const std::exception_ptr& e) {
          try {
            std::rethrow_exception(e);
          } catch (const std::exception& failure) {
            fmt::print(stderr, "serve: {} {}: {}\n", request.method, request.path, failure.what());
          }
          response.status = 500;
        });
  }
};

HttpServer::HttpServer(const HttpOptions& options, Gate gate, Handler handler)
    : state_(std::make_unique<State>(options, std::move(gate), std::move(handler))) {
  state_->install();
  state_->port = options.port > 0 && state_->server.bind_to_port(options.address, options.port)
                     ? options.port
                     : (options.port > 0 ? -1 : state_->server.bind_to_any_port(options.address));
  if (state_->port > 0) {
    state_->server.make_room();
    return;
  }
  throw EnvironmentError(fmt::format("serve: {}{} cannot be served; it is in use or not an address of this machine",
                                     options.address, options.port > 0 ? fmt::format(":{}", options.port) : ""));
}

HttpServer::~HttpServer() = default;
int HttpServer::port() const { return state_->port; }
void HttpServer::run() { state_->server.listen_after_bind(); }

void HttpServer::stop() {
  state_->stopping = true;
  state_->server.stop();
}

}  // namespace fringecal::cli::serve

#include "reports/http_post.h"

#include "core/error.h"

#include <fmt/format.h>
#include <httplib.h>

#include <condition_variable>
#include <mutex>
#include <thread>

namespace fringecal::reports {
namespace {

struct Address {
  std::string server, path;
};

Address address_of(const std::string& url) {
  const auto refuse = [&] {
    return InputError(fmt::format("\"{}\" is not the address of a server; write http://host/path", url.substr(0, 200)));
  };
  const auto scheme = url.starts_with("http://") ? 7u : url.starts_with("https://") ? 8u : 0u;
  if (scheme == 0 || url.size() > 2000) throw refuse();
  for (const char c : url) {
    if (c <= ' ' || c == 0x7f || c == '@') throw refuse();  // no second header line, no password on a command line
  }
  const auto slash = url.find('/', scheme);
  if (slash == scheme || url.size() == scheme) throw refuse();
  if (slash == std::string::npos) return {url, "/"};
  return {url.substr(0, slash), url.substr(slash)};
}

/// Closes the connection when the time is up: a server may send a byte now and then for ever.
class Watch {
 public:
  Watch(httplib::Client& client, std::chrono::seconds limit)
      : thread_([this, &client, limit] {
          std::unique_lock lock(mutex_);
          if (!done_.wait_for(lock, limit, [this] { return is_done_; })) {
            expired_ = true;
            client.stop();
          }
        }) {}
  ~Watch() { finish(); }
  bool finish() {
    {
      const std::lock_guard lock(mutex_);
      is_done_ = true;
    }
    done_.notify_one();
    if (thread_.joinable()) thread_.join();
    return expired_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable done_;
  bool is_done_ = false, expired_ = false;
  std::thread thread_;
};

}  // namespace

std::string http_post(const HttpPost& post) {
  const Address address = address_of(post.url);
  httplib::Client client(address.server);
  if (!client.is_valid()) throw InputError(fmt::format("\"{}\" is not the address of a server", post.url));
  client.set_follow_location(false);
  client.set_connection_timeout(post.together);
  client.set_read_timeout(post.together);
  client.set_write_timeout(post.together);
  httplib::Request request;
  request.method = "POST";
  request.path = address.path;
  request.body = post.body;
  request.set_header("Content-Type", post.content_type);
  request.set_header("Accept", post.accept);
  std::string answer;
  bool too_long = false;
  request.content_receiver = [&](const char* bytes, std::size_t n, std::uint64_t, std::uint64_t) {
    too_long = answer.size() + n > post.largest_answer;
    if (!too_long) answer.append(bytes, n);
    return !too_long;
  };
  Watch watch(client, post.together);
  const auto result = client.send(request);
  const bool expired = watch.finish();
  const auto failed = [&](const std::string& why) { return EnvironmentError(fmt::format("{}: {}", post.url, why)); };
  if (too_long) throw failed(fmt::format("the answer is longer than {} bytes", post.largest_answer));
  if (expired) throw failed(fmt::format("no answer within {} s", post.together.count()));
  if (!result) throw failed(fmt::format("no answer ({})", httplib::to_string(result.error())));
  if (result->status != 200) throw failed(fmt::format("the server answers with status {}", result->status));
  const std::string type = result->get_header_value("Content-Type");
  if (type.substr(0, type.find(';')) != post.accept) {
    throw failed(fmt::format("the answer is \"{}\", not {}", type.substr(0, 80), post.accept));
  }
  return answer;
}

}  // namespace fringecal::reports

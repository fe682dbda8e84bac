#include "tests/support/stamping_authority.h"

#include "core/file.h"
#include "tests/support/test_key.h"

#include <httplib.h>

#include <atomic>
#include <mutex>
#include <thread>

namespace fringecal::test {
namespace {

void must(const std::vector<std::string>& arguments) {
  const auto result = run(arguments);
  if (result.status != 0) throw std::runtime_error(arguments[1] + ": " + result.errors);
}

constexpr const char* kReply = "application/timestamp-reply";

}  // namespace

struct StampingAuthority::Server {
  httplib::Server http;
  std::thread thread;
  int port = 0;
  std::atomic<int> answers{0};
  std::atomic<bool> ends{false};
  std::mutex one_at_a_time;  // openssl counts serial numbers in a file
  std::string first;
};

StampingAuthority::StampingAuthority(const std::filesystem::path& folder, Validity validity)
    : folder_(folder), server_(std::make_unique<Server>()) {
  const auto file = [&](const char* name) { return (folder_ / name).string(); };
  std::filesystem::create_directories(folder_);
  make_test_key(folder_, "root", "ec", "/O=Example/CN=TEST root of time stamps");
  write_atomically(file("extensions"), "extendedKeyUsage=critical,timeStamping\nkeyUsage=critical,digitalSignature\n");
  write_atomically(file("tsa.cnf"), "[one]\nserial = " + file("serial") +
                                        "\nsigner_digest = sha256\ndefault_policy = 1.2.3.4.1\ndigests = sha256\n"
                                        "ess_cert_id_alg = sha256\n");
  must({"openssl", "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj",
        "/O=Example/CN=TEST time stamps", "-keyout", file("tsa.key"), "-out", file("tsa.csr")});
  must({"openssl", "x509", "-req", "-in", file("tsa.csr"), "-CA", file("root.pem"), "-CAkey", file("root.key"),
        "-CAcreateserial", "-days", validity == Validity::of_today ? "30" : "-1", "-extfile", file("extensions"),
        "-out", file("tsa.pem")});
  auto& http = server_->http;
  http.Post("/stamp", [this](const httplib::Request& request, httplib::Response& response) {
    const std::string der = answer(request.body);
    if (server_->answers++ == 0) server_->first = der;
    response.set_content(der, kReply);
  });
  http.Post("/replay", [this](const httplib::Request&, httplib::Response& response) {
    response.set_content(server_->first, kReply);
  });
  http.Post("/status", [](const httplib::Request&, httplib::Response& response) { response.status = 500; });
  http.Post("/moved", [this](const httplib::Request&, httplib::Response& response) {
    response.set_redirect(url("/stamp"), 307);
  });
  http.Post("/html", [](const httplib::Request&, httplib::Response& response) {
    response.set_content("<html>log in first</html>", "text/html");
  });
  http.Post("/long", [](const httplib::Request&, httplib::Response& response) {
    response.set_chunked_content_provider(kReply, [](std::size_t, httplib::DataSink& sink) {
      return sink.write(std::string(10'000, 'x').data(), 10'000);
    });
  });
  const auto wait = [this](int tenths) {
    for (int k = 0; k < tenths && !server_->ends; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  };
  http.Post("/silent", [wait](const httplib::Request&, httplib::Response&) { wait(300); });
  http.Post("/drip", [this, wait](const httplib::Request&, httplib::Response& response) {
    response.set_chunked_content_provider(kReply, [this, wait](std::size_t, httplib::DataSink& sink) {
      wait(2);
      return !server_->ends && sink.write("x", 1);
    });
  });
  server_->port = http.bind_to_any_port("127.0.0.1");
  server_->thread = std::thread([this] { server_->http.listen_after_bind(); });
  while (!http.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

StampingAuthority::~StampingAuthority() {
  server_->ends = true;
  server_->http.stop();
  server_->thread.join();
}

std::string StampingAuthority::answer(const std::string& request) const {
  const std::lock_guard lock(server_->one_at_a_time);
  const auto file = [&](const char* name) { return (folder_ / name).string(); };
  write_atomically(file("query"), request);
  must({"openssl", "ts", "-reply", "-config", file("tsa.cnf"), "-section", "one", "-queryfile", file("query"),
        "-signer", file("tsa.pem"), "-inkey", file("tsa.key"), "-out", file("reply")});
  return read_bytes(file("reply"));
}

std::string StampingAuthority::url(const std::string& path) const {
  return "http://127.0.0.1:" + std::to_string(server_->port) + path;
}

int StampingAuthority::answers_given() const { return server_->answers; }

}  // namespace fringecal::test

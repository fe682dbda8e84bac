// fringecal serve: the workbench's page; fringecal keep-job: beside each job that the page starts.
#include "cli/commands.h"
#include "cli/interrupt.h"
#include "cli/serve/routes.h"
#include "core/error.h"
#include "core/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>

namespace fringecal::cli {
namespace {

constexpr int kPort = 8750;

struct Options {
  std::string folder = ".", address = "127.0.0.1", name, certificate, key, password_file;
  std::optional<int> port;
};

/// One server on a folder: its file descriptor, to be closed at the end.
int lock_of(const std::filesystem::path& folder) {
  const int lock = ::open((folder / "server.lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock >= 0 && ::flock(lock, LOCK_EX | LOCK_NB) == 0) return lock;
  throw InputError(fmt::format("{}: another fringecal serve is at work there; open its page, or end it first",
                               folder.parent_path().string()));
}

std::string password_hash(const std::string& file) {
  std::string password = read_bytes(file);
  while (!password.empty() && (password.back() == '\n' || password.back() == '\r')) password.pop_back();
  if (password.size() < 12) throw InputError(fmt::format("{}: the password has fewer than 12 characters", file));
  return sha256_hex(password);
}

void refuse_open_address(const Options& o) {
  const bool loopback = o.address.starts_with("127.") || o.address == "::1";
  if (o.certificate.empty() != o.key.empty()) throw InputError("serve: give --tls-certificate and --tls-key together");
  if (loopback) return;
  if (o.certificate.empty() || o.password_file.empty()) {
    throw InputError(fmt::format(
        "serve: --address {} can be reached from other machines; that needs --tls-certificate, --tls-key and "
        "--password-file",
        o.address));
  }
}

void serve_pages(const Options& o) {
  refuse_open_address(o);
  const Interrupt interrupt;
  std::signal(SIGPIPE, SIG_IGN);  // a browser that goes away is not a reason to end
  serve::Workbench workbench(o.folder);
  if (!std::filesystem::is_directory(workbench.folder())) {
    throw InputError(fmt::format("{}: there is no such folder", workbench.folder().string()));
  }
  serve::Jobs jobs(workbench.serve_folder());
  const int lock = lock_of(workbench.serve_folder());
  serve::StateFeed feed(workbench, jobs);
  serve::LiveFeed live(workbench, jobs);
  std::unique_ptr<serve::Gate> gate;
  serve::HttpOptions options{.address = o.address,
                             .port = o.port.value_or(0),
                             .certificate = o.certificate,
                             .key = o.key,
                             .headers = serve::safe_headers()};
  const auto serves = [&](int port) {
    options.port = port;
    return std::make_unique<serve::HttpServer>(
        options, [&](const serve::HttpRequest& request) { return gate->check(request); },
        [&](const serve::HttpRequest& request) {
          return serve::answer(request, {*gate, workbench, jobs, feed, live});
        });
  };
  std::unique_ptr<serve::HttpServer> server;
  try {
    server = serves(o.port.value_or(kPort));
  } catch (const EnvironmentError&) {
    if (o.port) throw;
    server = serves(0);  // the usual port is taken: a free one
  }
  const bool tls = !o.certificate.empty();
  const std::string port = fmt::format(":{}", server->port());
  const std::string shown = (o.name.empty() ? o.address : o.name) + port;
  const auto say = [&](const std::string& token) {
    fmt::print("{}://{}/?token={}\n", tls ? "https" : "http", shown, token);
    std::fflush(stdout);
  };
  serve::GateOptions rules{.hosts = {shown, o.address + port},
                           .tls = tls,
                           .password_sha256 = o.password_file.empty() ? "" : password_hash(o.password_file),
                           .sessions_file = workbench.serve_folder() / "sessions.json",
                           .on_new_token = say};
  if (o.address == "127.0.0.1") rules.hosts.push_back("localhost" + port);
  gate = std::make_unique<serve::Gate>(rules);
  fmt::print(stderr, "fringecal serves {}; Ctrl-C ends the page, not a running job. Open, once per browser:\n",
             workbench.folder().string());
  say(gate->token());
  std::jthread watch([&](const std::stop_token& end) {
    while (!end.stop_requested() && !interrupt.wait(std::chrono::milliseconds(200))) {
    }
    server->stop();
  });
  server->run();
  ::close(lock);
}

}  // namespace

void add_serve(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("serve", "The workbench as a page in the browser, on this machine");
  command->add_option("folder", o->folder, "The workbench's folder, with commissioning/, verification*/, history.db")
      ->capture_default_str();
  command->add_option("--port", o->port, fmt::format("Port (default: {}, or a free one where that is taken)", kPort))
      ->check(CLI::Range(1, 65535));
  command
      ->add_option("--address", o->address,
                   "Address to serve at; another than this machine's own needs TLS and a password")
      ->capture_default_str();
  command->add_option("--name", o->name, "Name by which other machines reach this one, as in its certificate");
  command->add_option("--tls-certificate", o->certificate, "Certificate chain, PEM");
  command->add_option("--tls-key", o->key, "Its private key, PEM");
  command->add_option("--password-file", o->password_file, "File with the password, 12 characters or more");
  command->footer("Example: fringecal serve .");
  command->callback([o] { serve_pages(*o); });

  auto job = std::make_shared<std::string>();
  CLI::App* keeper =
      app.add_subcommand("keep-job", "Runs the job of a folder and writes down its end (started by serve)");
  keeper->group("");
  keeper->add_option("folder", *job, "The folder with job.json")->required();
  keeper->callback([job] { serve::keep_job(*job); });
}

}  // namespace fringecal::cli

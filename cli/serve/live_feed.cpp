#include "cli/serve/live_feed.h"

#include "cli/argument_vector.h"
#include "cli/serve/capture_watch.h"
#include "cli/serve/state_feed.h"
#include "cli/virtual_child.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <utility>
#include <vector>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

constexpr int kPictureWidth = 480;
constexpr const char* kPattern = "7";  // the first phase step: fringes to focus by
constexpr std::chrono::seconds kEndLimit{5};

/// `fringecal live` and the virtual scanner it looks at, where there is no other.
class LiveChild {
 public:
  LiveChild(const Workbench& workbench, const fs::path& folder) : errors_(folder / "live-errors") {
    fs::path scanner = workbench.folder() / "scanner.toml";
    if (!fs::exists(scanner)) {
      scanner = folder / "live-scanner.toml";
      virtual_.emplace(virtual_arguments(workbench, scanner));
    }
    std::vector<std::string> words = {"fringecal",      "live",      "--scanner",
                                      scanner.string(), "--pattern", kPattern,
                                      "--json",         "--picture", std::to_string(kPictureWidth)};
    const std::vector<char*> argv = argument_vector(words);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw EnvironmentError("serve: no channel to the live picture");
    output_ = ends[0];
    posix_spawn_file_actions_t files;
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_addopen(&files, STDERR_FILENO, errors_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setpgroup(&attributes, 0);  // Ctrl-C reaches the server alone, which ends this
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    const int failure = posix_spawn(&process_, "/proc/self/exe", &files, &attributes, argv.data(), environ);
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&attributes);
    ::close(ends[1]);
    if (failure == 0) return;
    ::close(output_);
    throw EnvironmentError(fmt::format("serve: the live picture cannot be started: {}", std::strerror(failure)));
  }

  ~LiveChild() {
    ::close(output_);
    ::kill(process_, SIGINT);  // lamp off
    const auto deadline = std::chrono::steady_clock::now() + kEndLimit;
    while (::waitpid(process_, nullptr, WNOHANG) == 0) {
      if (std::chrono::steady_clock::now() > deadline) ::kill(process_, SIGKILL);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  LiveChild(const LiveChild&) = delete;
  LiveChild& operator=(const LiveChild&) = delete;

  /// The next whole document; "" where none came within 200 ms; nothing at the end.
  std::optional<std::string> next() {
    constexpr std::string_view kEnd = "\n}\n";
    pollfd watched{output_, POLLIN, 0};
    if (::poll(&watched, 1, 200) > 0) {
      char part[65536];
      const ssize_t count = ::read(output_, part, sizeof part);
      if (count <= 0) return std::nullopt;
      received_.append(part, static_cast<std::size_t>(count));
    }
    const auto end = received_.rfind(kEnd);
    if (end == std::string::npos) return "";
    // Of several the newest: whoever looks slowly sees fewer, not older ones.
    const auto before = end == 0 ? std::string::npos : received_.rfind(kEnd, end - 1);
    const std::size_t begin = before == std::string::npos ? 0 : before + kEnd.size();
    std::string document = received_.substr(begin, end + 2 - begin);
    received_.erase(0, end + kEnd.size());
    return document;
  }

  /// What it said when it ended by itself.
  std::string last_words() const {
    std::string text = fs::exists(errors_) ? read_bytes(errors_) : "";
    while (!text.empty() && text.back() == '\n') text.pop_back();
    return text.substr(text.rfind('\n') + 1);
  }

 private:
  static std::vector<std::string> virtual_arguments(const Workbench& workbench, const fs::path& scanner) {
    std::vector<std::string> out = {"--scene", "spheres 0", "--scanner-file", scanner.string()};
    const fs::path begun = workbench.commissioning() / "commission.json";
    if (!fs::exists(begun)) return out;
    const Value choices = read_json(begun);
    for (const char* key : {"preset", "seed"}) {
      const Value* value = choices.find(key);
      if (value && value->if_text()) out.insert(out.end(), {std::string("--") + key, *value->if_text()});
    }
    return out;
  }

  fs::path errors_;
  std::optional<VirtualChild> virtual_;  // destroyed after the child that talks to it has ended
  int output_ = -1, process_ = -1;
  std::string received_;
};

}  // namespace

struct LiveFeed::Watcher {
  explicit Watcher(LiveFeed& f) : feed(f) {
    const std::lock_guard hold(feed.mutex_);
    ++feed.watchers_;
    seen = feed.version_;
  }
  ~Watcher() {
    const std::lock_guard hold(feed.mutex_);
    --feed.watchers_;
  }
  LiveFeed& feed;
  std::uint64_t seen = 0;
};

void LiveFeed::tell(std::string event) {
  const std::lock_guard hold(mutex_);
  event_ = std::move(event);
  ++version_;
  changed_.notify_all();
}

bool LiveFeed::watched() {
  const std::lock_guard hold(mutex_);
  return watchers_ > 0;
}

void LiveFeed::show_camera(const std::stop_token& stop) {
  LiveChild child(workbench_, jobs_.folder());
  while (!stop.stop_requested() && watched()) {
    auto document = child.next();
    if (!document) return tell(event_of("trouble", child.last_words()));
    if (!document->empty()) tell(event_of("live", *document));
  }
}

void LiveFeed::show_job(const std::stop_token& stop) {
  tell(event_of("job", ""));
  CaptureWatch capture(workbench_.commissioning());
  while (!stop.stop_requested() && watched() && jobs_.running()) {
    if (const auto document = capture.next(kPictureWidth)) tell(event_of("live", *document));
    std::this_thread::sleep_for(CaptureWatch::kPeriod);
  }
}

void LiveFeed::read(const std::stop_token& stop) {
  try {
    if (jobs_.running()) {
      show_job(stop);
    } else {
      show_camera(stop);
    }
  } catch (const std::exception& e) {
    tell(event_of("trouble", e.what()));
  }
  const std::lock_guard hold(mutex_);
  over_ = true;
  changed_.notify_all();
}

void LiveFeed::begin() {
  const std::lock_guard one(starting_);
  {
    const std::lock_guard hold(mutex_);
    if (!over_) return;
    over_ = false;
  }
  if (reader_.joinable()) reader_.join();
  reader_ = std::jthread([this](const std::stop_token& stop) { read(stop); });
}

void LiveFeed::give_way(const std::function<void()>& action) {
  const std::lock_guard one(starting_);
  if (reader_.joinable()) {
    reader_.request_stop();
    reader_.join();
  }
  action();
}

std::function<std::optional<std::string>()> LiveFeed::events() {
  auto watcher = std::make_shared<Watcher>(*this);
  begin();
  return [this, watcher, begun = false]() mutable -> std::optional<std::string> {
    if (!std::exchange(begun, true)) return "retry: 500\n\n";  // ms until a browser asks again after the end
    std::unique_lock hold(mutex_);
    changed_.wait_for(hold, std::chrono::seconds(1), [&] { return watcher->seen != version_ || over_; });
    if (watcher->seen != version_) {
      watcher->seen = version_;
      return event_;
    }
    if (over_) return std::nullopt;
    return "";
  };
}

}  // namespace fringecal::cli::serve

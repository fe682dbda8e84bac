#include "cli/virtual_child.h"

#include "cli/argument_vector.h"
#include "core/error.h"
#include "core/value.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

namespace fringecal::cli {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kStartLimit{60};  // 0.3 s on an idle machine; under a sanitizer and load far more
constexpr std::chrono::seconds kEndLimit{10};

/// Starts this program's own file. Returns the process; its standard output goes to `output`.
pid_t start(std::vector<std::string> words, int output) {
  const std::vector<char*> argv = argument_vector(words);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  pid_t process = -1;
  const int failure = posix_spawn(&process, "/proc/self/exe", &files, &attributes, argv.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  if (failure != 0) {
    throw EnvironmentError(fmt::format("the virtual scanner cannot be started: {}", std::strerror(failure)));
  }
  return process;
}

}  // namespace

VirtualChild::VirtualChild(const std::vector<std::string>& arguments) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) {
    throw EnvironmentError(fmt::format("the virtual scanner cannot be started: {}", std::strerror(errno)));
  }
  output_ = ends[0];
  std::vector<std::string> words = {"fringecal", "virtual", "--address", "free", "--parent", std::to_string(getpid())};
  words.insert(words.end(), arguments.begin(), arguments.end());
  try {
    process_ = start(std::move(words), ends[1]);
    close(ends[1]);
    read_ready_line();
  } catch (...) {
    end();
    throw;
  }
}

VirtualChild::~VirtualChild() { end(); }

void VirtualChild::read_ready_line() {
  std::string line;
  const auto deadline = Clock::now() + kStartLimit;
  while (line.find('\n') == std::string::npos) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    pollfd ready{output_, POLLIN, 0};
    char part[1024];
    const ssize_t count =
        left.count() > 0 && poll(&ready, 1, static_cast<int>(left.count())) > 0 ? read(output_, part, sizeof part) : 0;
    if (count <= 0) {
      throw EnvironmentError(fmt::format("the virtual scanner did not start within {} s; 'fringecal virtual' says why",
                                         kStartLimit.count()));
    }
    line.append(part, static_cast<std::size_t>(count));
  }
  const Value ready = parse_json(line, "the virtual scanner's answer");
  const auto word = [&](const char* key) {
    const Value* value = ready.find(key);
    require(value && value->if_text(), "the virtual scanner says where it serves");
    return *value->if_text();
  };
  camera_ = word("camera");
  pixel_format_ = word("pixel_format");
  plc_ = word("plc");
}

void VirtualChild::end() {
  if (process_ > 0) {
    kill(process_, SIGTERM);
    const auto deadline = Clock::now() + kEndLimit;
    while (waitpid(process_, nullptr, WNOHANG) == 0) {
      if (Clock::now() > deadline) kill(process_, SIGKILL);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    process_ = -1;
  }
  if (output_ >= 0) close(output_);
  output_ = -1;
}

}  // namespace fringecal::cli

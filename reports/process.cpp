#include "reports/process.h"

#include "core/error.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace fringecal::reports {
namespace {

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  ~Descriptor() { close(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  int get() const { return fd_; }
  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }

 private:
  int fd_;
};

/// Both ends close on exec. A socket and not a pipe: send() can be told not to raise SIGPIPE.
std::pair<Descriptor, Descriptor> channel() {
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    throw EnvironmentError(fmt::format("no channel to another program can be opened ({})", std::strerror(errno)));
  }
  return {Descriptor(ends[0]), Descriptor(ends[1])};
}

/// A child that is killed and waited for unless wait() was reached.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (pid_ < 0) return;
    ::kill(pid_, SIGKILL);
    wait();
  }
  int wait() {
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  pid_t pid_;
};

pid_t spawn(const std::vector<std::string>& arguments, const std::array<int, 3>& streams, const std::string& advice) {
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (const auto& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const char* search = std::getenv("PATH");
  std::string path = fmt::format("PATH={}", search != nullptr ? search : "/usr/bin:/bin"), locale = "LC_ALL=C.UTF-8";
  std::array<char*, 3> environment = {path.data(), locale.data(), nullptr};
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  for (int k = 0; k < 3; ++k) ::posix_spawn_file_actions_adddup2(&actions, streams[static_cast<std::size_t>(k)], k);
  pid_t pid = -1;
  const int error = ::posix_spawnp(&pid, argv[0], &actions, nullptr, argv.data(), environment.data());
  ::posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) throw EnvironmentError(fmt::format("{} is not installed; {}", arguments[0], advice));
  if (error != 0) throw EnvironmentError(fmt::format("{} cannot be started ({})", arguments[0], std::strerror(error)));
  return pid;
}

/// Appends what has arrived; closes at the end.
void receive(Descriptor& from, std::string& to) {
  std::array<char, 65536> buffer;
  const ssize_t n = ::recv(from.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
  if (n > 0) to.append(buffer.data(), static_cast<std::size_t>(n));
  if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) from.close();
}

/// Sends what fits; closes when all is sent or the reader is gone (its exit status then says why).
void send_some(Descriptor& to, std::string_view& rest) {
  const ssize_t n = ::send(to.get(), rest.data(), rest.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (n > 0) rest.remove_prefix(static_cast<std::size_t>(n));
  if (rest.empty() || (n < 0 && errno != EAGAIN && errno != EINTR)) to.close();
}

}  // namespace

FilterOutput run_filter(const std::vector<std::string>& arguments, std::string_view input, std::chrono::seconds limit,
                        const std::string& advice) {
  require(!arguments.empty(), "a program to run has a name");
  auto [in, child_in] = channel();
  auto [out, child_out] = channel();
  auto [err, child_err] = channel();
  Child child(spawn(arguments, {child_in.get(), child_out.get(), child_err.get()}, advice));
  child_in.close();
  child_out.close();
  child_err.close();

  FilterOutput result;
  const auto end = std::chrono::steady_clock::now() + limit;
  while (out.get() >= 0 || err.get() >= 0) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
    if (left.count() <= 0) {
      throw EnvironmentError(fmt::format("{} gave no answer within {} s and was stopped", arguments[0], limit.count()));
    }
    // poll() skips negative descriptors.
    std::array<pollfd, 3> watched = {pollfd{in.get(), POLLOUT, 0}, pollfd{out.get(), POLLIN, 0},
                                     pollfd{err.get(), POLLIN, 0}};
    if (::poll(watched.data(), watched.size(), static_cast<int>(left.count())) < 0 && errno != EINTR) {
      throw EnvironmentError(fmt::format("waiting for {} failed ({})", arguments[0], std::strerror(errno)));
    }
    if (watched[0].revents != 0) send_some(in, input);
    if (watched[1].revents != 0) receive(out, result.output);
    if (watched[2].revents != 0) receive(err, result.errors);
  }
  result.status = child.wait();
  return result;
}

}  // namespace fringecal::reports

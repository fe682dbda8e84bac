#include "cli/operator.h"

#include "hw/capture_sequence.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>

namespace fringecal::cli {
namespace {

constexpr int kLook_ms = 100;  // how soon a stop is noticed

[[noreturn]] void nobody_there() {
  throw hw::CaptureStopped("nobody answered; what is finished is kept, the same command on a terminal continues there");
}

}  // namespace

void Operator::ask(const std::string& what) const {
  // On a terminal the line of the progress stands there.
  fmt::print(stderr, "{}>> {}: Enter when done\n", isatty(STDERR_FILENO) ? "\r\033[K" : "", what);
  for (;;) {
    if (stop_.stop_requested()) {
      throw hw::CaptureStopped("stopped; what is finished is kept, the same command continues there");
    }
    pollfd input{STDIN_FILENO, POLLIN, 0};
    const int ready = poll(&input, 1, kLook_ms);
    if (ready < 0 && errno != EINTR) nobody_there();
    if (ready <= 0) continue;
    char c = 0;
    const ssize_t count = read(STDIN_FILENO, &c, 1);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) nobody_there();
    if (c == '\n') return;
  }
}

}  // namespace fringecal::cli

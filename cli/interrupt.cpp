#include "cli/interrupt.h"

#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <condition_variable>
#include <mutex>

namespace fringecal::cli {
namespace {

sigset_t stop_signals() {
  sigset_t set;
  sigemptyset(&set);
  for (const int s : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&set, s);
  return set;
}

pid_t first_parent = 0;

}  // namespace

Interrupt::Interrupt() {
  const sigset_t set = stop_signals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  thread_ = std::jthread([this, set](const std::stop_token& end) {
    const timespec look{0, 50'000'000};
    while (!end.stop_requested()) {
      if (sigtimedwait(&set, nullptr, &look) < 0) continue;
      source_.request_stop();
      pthread_sigmask(SIG_UNBLOCK, &set, nullptr);  // the next signal has its usual effect
      return;
    }
  });
}

Interrupt::~Interrupt() = default;

bool Interrupt::wait(std::chrono::milliseconds duration) const {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  never.wait_for(lock, source_.get_token(), duration, [] { return false; });
  return source_.stop_requested();
}

bool end_with_parent(std::optional<int> process) {
  first_parent = process.value_or(getppid());
  prctl(PR_SET_PDEATHSIG, SIGTERM);  // asks first, looks then: a parent that ends in between is not missed
  return parent_lives();
}

bool parent_lives() { return getppid() == first_parent; }

}  // namespace fringecal::cli

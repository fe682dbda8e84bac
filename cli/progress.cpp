#include "cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace fringecal::cli {
namespace {

std::string as_minutes(double seconds) {
  const int s = static_cast<int>(seconds + 0.5);
  return fmt::format("{}:{:02}", s / 60, s % 60);
}

}  // namespace

Progress::Progress(double weight_total)
    : begin_(std::chrono::steady_clock::now()), total_(weight_total), terminal_(isatty(STDERR_FILENO) != 0) {}

Progress::~Progress() {
  if (terminal_) std::fputs("\r\033[K", stderr);
}

void Progress::start(const std::string& what) {
  what_ = what;
  draw();
}

void Progress::done(double weight, bool skipped) {
  done_ += weight;
  if (!skipped) measured_ += weight;
  draw();
}

void Progress::finish_step(const std::string& sentence) {
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  fmt::print(stderr, "{}[{}] {}\n", terminal_ ? "\r\033[K" : "", as_minutes(elapsed), sentence);
}

void Progress::draw() {
  if (!terminal_) return;
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  std::string left = "estimating the time left";
  if (measured_ > 0)
    left = fmt::format("about {} left", as_minutes(elapsed / measured_ * std::max(0.0, total_ - done_)));
  fmt::print(stderr, "\r\033[K{:3.0f} %  {}  ({})", 100.0 * std::min(1.0, done_ / total_), what_, left);
  std::fflush(stderr);
}

double Stopwatch::seconds() const {
  if (std::getenv("SOURCE_DATE_EPOCH")) return 0;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
}

}  // namespace fringecal::cli

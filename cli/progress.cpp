#include "cli/progress.h"

#include "core/file.h"
#include "core/value.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <optional>

namespace fringecal::cli {
namespace {

std::string as_minutes(double seconds) {
  const long s = std::lround(seconds);
  return fmt::format("{}:{:02}", s / 60, s % 60);
}

/// FRINGECAL_PROGRESS_FILE in the environment names a file that always holds the newest state, for whoever watches:
/// {"fraction": 0 .. 1, "what": TEXT, "left_s": absent until something was measured}.
void tell(double fraction, const std::string& what, std::optional<double> left_s) {
  const char* file = std::getenv("FRINGECAL_PROGRESS_FILE");
  if (!file) return;
  Value now = Value::object().set("fraction", fraction).set("what", what);
  if (left_s) now.set("left_s", *left_s);
  write_atomically(file, to_json(now));
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
  const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  const double fraction = std::min(1.0, done_ / total_);
  std::optional<double> left_s;
  if (measured_ > 0) left_s = elapsed / measured_ * std::max(0.0, total_ - done_);
  tell(fraction, what_, left_s);
  if (!terminal_) return;
  const std::string left = left_s ? fmt::format("about {} left", as_minutes(*left_s)) : "estimating the time left";
  fmt::print(stderr, "\r\033[K{:3.0f} %  {}  ({})", 100.0 * fraction, what_, left);
  std::fflush(stderr);
}

double Stopwatch::seconds() const {
  if (std::getenv("SOURCE_DATE_EPOCH")) return 0;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
}

}  // namespace fringecal::cli

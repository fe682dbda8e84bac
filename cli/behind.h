// Work that goes on behind the caller, one piece at a time and in the order given: a stack is evaluated while the next
// one is captured.
#pragma once

#include <functional>
#include <future>

namespace fringecal::cli {

class Behind {
 public:
  /// Waits for the piece before, then starts this one.
  void run(std::function<void()> work) {
    finish();
    current_ = std::async(std::launch::async, std::move(work));
  }
  /// Waits for all that was given; what a piece threw is thrown here.
  void finish() {
    if (current_.valid()) current_.get();
  }

 private:
  std::future<void> current_;  // waits in its destructor: what was begun is brought to its end
};

}  // namespace fringecal::cli

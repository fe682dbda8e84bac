// Ctrl-C and SIGTERM as a request to stop in an orderly way: lamp off, stage parked, files whole. A second signal ends
// the program at once.
#pragma once

#include <chrono>
#include <optional>
#include <stop_token>
#include <thread>

namespace fringecal::cli {

class Interrupt {
 public:
  /// To be made before other threads, which then leave the signals to it.
  Interrupt();
  ~Interrupt();
  std::stop_token token() const { return source_.get_token(); }
  /// Asks for a stop as a signal would.
  void stop() { source_.request_stop(); }
  /// Returns when a stop was requested or the time is over; true in the first case.
  bool wait(std::chrono::milliseconds duration) const;

 private:
  std::stop_source source_;
  std::jthread thread_;
};

/// Has the system end this program with SIGTERM when the program that started it ends. False where that has already
/// happened; that can only be told where the number of its process is known (absent: whoever is the parent now).
bool end_with_parent(std::optional<int> process = {});
/// Whether the program that started this one is still there; end_with_parent() was called before.
bool parent_lives();

}  // namespace fringecal::cli

// The state of the workbench for everybody who watches: looked at kLooks times a second while somebody does, told on
// change.
#pragma once

#include "cli/serve/jobs.h"
#include "cli/serve/workbench.h"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace fringecal::cli::serve {

class StateFeed {
 public:
  StateFeed(const Workbench& workbench, const Jobs& jobs) : workbench_(workbench), jobs_(jobs) {}
  /// JSON, not older than kPeriod.
  std::string state();
  /// For HttpResponse::events: the state at once, and again whenever it has changed.
  std::function<std::optional<std::string>()> events();

 private:
  static constexpr std::chrono::milliseconds kPeriod{250};
  void look();

  const Workbench& workbench_;
  const Jobs& jobs_;
  std::mutex mutex_;
  std::string state_;
  std::uint64_t version_ = 0;
  std::chrono::steady_clock::time_point looked_{};
};

/// A text as one server-sent event.
std::string event_of(const std::string& name, const std::string& text);

}  // namespace fringecal::cli::serve

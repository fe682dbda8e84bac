#include "cli/serve/state_feed.h"

#include <thread>

namespace fringecal::cli::serve {

std::string event_of(const std::string& name, const std::string& text) {
  std::string out = "event: " + name + "\ndata: ";
  for (const char c : text) {
    out += c;
    if (c == '\n') out += "data: ";
  }
  return out + "\n\n";
}

void StateFeed::look() {
  const auto now = std::chrono::steady_clock::now();
  if (version_ > 0 && now - looked_ < kPeriod) return;
  looked_ = now;
  std::string state = to_json(workbench_.state(jobs_.state()));
  if (state == state_) return;
  state_ = std::move(state);
  ++version_;
}

std::string StateFeed::state() {
  const std::lock_guard hold(mutex_);
  look();
  return state_;
}

std::function<std::optional<std::string>()> StateFeed::events() {
  return [this, seen = std::uint64_t{0}]() mutable -> std::optional<std::string> {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    while (std::chrono::steady_clock::now() < until) {
      {
        const std::lock_guard hold(mutex_);
        look();
        if (seen != version_) {
          seen = version_;
          return event_of("state", state_);
        }
      }
      std::this_thread::sleep_for(kPeriod / 2);
    }
    return "";
  };
}

}  // namespace fringecal::cli::serve

// The camera's picture for everybody who watches: `fringecal live` as a child, as long as somebody does and no job runs.
// With FOLDER/scanner.toml it is that scanner; without, the virtual one of the commissioning, served for the time.
#pragma once

#include "cli/serve/jobs.h"
#include "cli/serve/workbench.h"

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace fringecal::cli::serve {

class LiveFeed {
 public:
  LiveFeed(const Workbench& workbench, const Jobs& jobs) : workbench_(workbench), jobs_(jobs) {}
  ~LiveFeed() { end(); }
  /// For HttpResponse::events: "live" with the JSON of `fringecal live --json --picture`, or "trouble" with a sentence,
  /// and then the end.
  std::function<std::optional<std::string>()> events();
  /// Gives the camera back: when it returns, lamp and stage are as `live` leaves them.
  void end();

 private:
  struct Watcher;
  void begin();
  void read(const std::stop_token& stop);
  void tell(std::string event);

  const Workbench& workbench_;
  const Jobs& jobs_;
  std::mutex starting_;  // begin() and end(), one after the other
  std::mutex mutex_;
  std::condition_variable changed_;
  std::string event_;
  std::uint64_t version_ = 0;
  int watchers_ = 0;
  bool over_ = true;
  std::jthread reader_;
};

}  // namespace fringecal::cli::serve

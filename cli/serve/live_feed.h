// The camera's picture for everybody who watches: `fringecal live` as a child, as long as somebody does and no job runs.
// With FOLDER/scanner.toml it is that scanner; without, the virtual one of the commissioning, served for the time.
// While a job runs the camera is the job's: shown are the frames that it saves (capture_watch.h). When a job begins or
// ends the streams end, and a browser that asks again sees the other one.
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
  /// For HttpResponse::events: "job" where the pictures will be a job's, "live" with the JSON of `fringecal live --json
  /// --picture`, or "trouble" with a sentence, and then the end.
  std::function<std::optional<std::string>()> events();
  void end() {
    give_way([] {});
  }
  /// Gives the camera back (lamp and stage are as `live` leaves them), and does not take it until `action` has returned.
  void give_way(const std::function<void()>& action);

 private:
  struct Watcher;
  void begin();
  void read(const std::stop_token& stop);
  void show_camera(const std::stop_token& stop);
  void show_job(const std::stop_token& stop);
  bool watched();
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

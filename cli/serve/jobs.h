// One command of this program at a time on a folder, started from the page, and not lost with it.
//
// The command is a process of its own in a session of its own: the page, the browser and the server may go and come
// back. Beside it waits a *keeper* (`fringecal keep-job FOLDER`), which writes down how it ended. Both hold a lock on
// FOLDER/job.lock that the system ends with them, so that
//   running  the lock is held                                                                                     (1)
//   ended    the lock is free and job.json has an exit code                                                       (2)
//   broken   the lock is free and job.json has none: the machine went off; the same command continues              (3)
// and whoever cannot take the lock cannot start (the other window, another server). In FOLDER:
//   job.json       "fringecal.job", version 1: number, arguments, begun, keeper, ended, exit_code
//   output, errors what the command printed
//   progress.json  see cli/progress.h
// Commands are argument vectors of this very program; no shell is involved.
#pragma once

#include "core/value.h"

#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli::serve {

class Jobs {
 public:
  /// Makes the folder.
  explicit Jobs(std::filesystem::path folder);
  /// False where a job runs already. Throws EnvironmentError.
  bool start(const std::vector<std::string>& arguments);
  /// Asks the running job to end in an orderly way, as Ctrl-C would; asked again, at once. False where none runs.
  bool stop();
  bool running() const;
  /// {state: "none" | "running" | "ended" | "broken", number, arguments, begun, ended?, exit_code?, progress?, lines}
  Value state() const;
  const std::filesystem::path& folder() const { return folder_; }

 private:
  std::filesystem::path folder_;
  mutable std::mutex mutex_;  // the look at the lock, eq. 1, takes it for a moment
};

/// The keeper: runs the command of FOLDER/job.json and writes down its end. Returns when it has ended.
void keep_job(const std::filesystem::path& folder);

}  // namespace fringecal::cli::serve

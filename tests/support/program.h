// Running the program as its user does: an argument vector, no shell; exit code and both outputs.
#pragma once

#include "tests/support/temporary_folder.h"

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::test {

struct ProgramResult {
  int exit_code = -1;  // 128 + signal where a signal ended it
  std::string output, errors;
};

/// Runs FRINGECAL_PROGRAM with the arguments. file_size_limit: bytes a single file may reach (RLIMIT_FSIZE), 0 for none
/// - a write beyond it fails as on a full disk. permissions_bind: those of files and folders hold for root as well.
ProgramResult run_fringecal(const std::vector<std::string>& arguments, std::size_t file_size_limit = 0,
                            bool permissions_bind = false);

/// The program while it runs; ended by SIGKILL with the object at the latest.
class RunningProgram {
 public:
  /// dialogue: say() is its standard input, and what it says on standard error is part of its output.
  explicit RunningProgram(const std::vector<std::string>& arguments, bool dialogue = false);
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// The next line of its standard output; empty where none came in time or it ended.
  std::string line(std::chrono::milliseconds limit = std::chrono::seconds(60));
  /// A line on its standard input; `hang_up`: its end.
  void say(const std::string& line);
  void hang_up();
  void send(int signal) const;
  /// Exit code as in ProgramResult; nothing where it still runs after the limit.
  std::optional<int> wait(std::chrono::milliseconds limit = std::chrono::seconds(60));

 private:
  int child_ = -1, input_ = -1, output_ = -1;
  std::string received_;
};

using ScratchFolder = TemporaryFolder;

/// Names of everything below a folder, sorted: to see that nothing half-written is left.
std::vector<std::string> listing(const std::filesystem::path& folder);

}  // namespace fringecal::test

// Running the program as its user does: an argument vector, no shell; exit code and both outputs.
#pragma once

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
/// - a write beyond it fails as on a full disk.
ProgramResult run_fringecal(const std::vector<std::string>& arguments, std::size_t file_size_limit = 0);

/// The program while it runs; ended by SIGKILL with the object at the latest.
class RunningProgram {
 public:
  explicit RunningProgram(const std::vector<std::string>& arguments);
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// The next line of its standard output; empty where none came in time or it ended.
  std::string line(std::chrono::milliseconds limit = std::chrono::seconds(60));
  void send(int signal) const;
  /// Exit code as in ProgramResult; nothing where it still runs after the limit.
  std::optional<int> wait(std::chrono::milliseconds limit = std::chrono::seconds(60));

 private:
  int child_ = -1, output_ = -1;
  std::string received_;
};

/// A folder of its own for one test, removed at the end of the test.
class ScratchFolder {
 public:
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Names of everything below a folder, sorted: to see that nothing half-written is left.
std::vector<std::string> listing(const std::filesystem::path& folder);

}  // namespace fringecal::test

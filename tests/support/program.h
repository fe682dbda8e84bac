// Running the program as its user does: an argument vector, no shell; exit code and both outputs.
#pragma once

#include <filesystem>
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

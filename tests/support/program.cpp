#include "tests/support/program.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>

namespace fringecal::test {
namespace fs = std::filesystem;
namespace {

std::string contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

[[noreturn]] void become(const std::string& program, std::vector<char*>& argv) {
  setenv("FRINGECAL_ROOT_IS_MEANT", "1", 1);  // tests run as whoever builds; the warning has a test of its own
  execv(program.c_str(), argv.data());
  _exit(127);
}

}  // namespace

ProgramResult run_fringecal(const std::vector<std::string>& arguments, std::size_t file_size_limit,
                            bool permissions_bind) {
  const ScratchFolder scratch;
  const fs::path output = scratch / "stdout", errors = scratch / "stderr";
  std::vector<char*> argv;
  std::string program = FRINGECAL_PROGRAM;
  argv.push_back(program.data());
  std::vector<std::string> copies = arguments;
  for (auto& a : copies) argv.push_back(a.data());
  argv.push_back(nullptr);
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("fork failed");
  if (child == 0) {
    const int out = ::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    const int err = ::open(errors.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out, STDOUT_FILENO);
    dup2(err, STDERR_FILENO);
    if (file_size_limit > 0) {
      signal(SIGXFSZ, SIG_IGN);  // write() then fails with EFBIG instead of ending the program
      const rlimit limit{file_size_limit, file_size_limit};
      setrlimit(RLIMIT_FSIZE, &limit);
    }
    if (permissions_bind && geteuid() == 0) {
      prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE);
      prctl(PR_CAPBSET_DROP, CAP_DAC_READ_SEARCH);
    }
    become(program, argv);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ProgramResult result;
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  result.output = contents(output);
  result.errors = contents(errors);
  return result;
}

RunningProgram::RunningProgram(const std::vector<std::string>& arguments, bool dialogue) {
  std::string program = FRINGECAL_PROGRAM;
  std::vector<std::string> copies = arguments;
  std::vector<char*> argv = {program.data()};
  for (auto& a : copies) argv.push_back(a.data());
  argv.push_back(nullptr);
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
  int said[2] = {-1, -1};
  if (dialogue && pipe2(said, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
  child_ = fork();
  if (child_ < 0) throw std::runtime_error("fork failed");
  if (child_ == 0) {
    dup2(ends[1], STDOUT_FILENO);
    if (dialogue) {
      dup2(ends[1], STDERR_FILENO);
      dup2(said[0], STDIN_FILENO);
    }
    become(program, argv);
  }
  close(ends[1]);
  output_ = ends[0];
  if (dialogue) close(said[0]);
  input_ = said[1];
}

void RunningProgram::say(const std::string& line) {
  const std::string bytes = line + "\n";
  if (write(input_, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) {
    throw std::runtime_error("the program does not listen");
  }
}

void RunningProgram::hang_up() {
  if (input_ >= 0) close(input_);
  input_ = -1;
}

RunningProgram::~RunningProgram() {
  if (child_ > 0) {
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
  }
  hang_up();
  close(output_);
}

std::string RunningProgram::line(std::chrono::milliseconds limit) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  for (;;) {
    if (const auto end = received_.find('\n'); end != std::string::npos) {
      const std::string out = received_.substr(0, end);
      received_.erase(0, end + 1);
      return out;
    }
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd p{output_, POLLIN, 0};
    if (left.count() <= 0 || poll(&p, 1, static_cast<int>(left.count())) <= 0) return "";
    char part[4096];
    const ssize_t count = read(output_, part, sizeof part);
    if (count <= 0) return "";
    received_.append(part, static_cast<std::size_t>(count));
  }
}

void RunningProgram::send(int signal) const {
  if (child_ > 0) kill(child_, signal);
}

std::optional<int> RunningProgram::wait(std::chrono::milliseconds limit) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  for (int status = 0;;) {
    if (waitpid(child_, &status, WNOHANG) == child_) {
      child_ = -1;
      return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    if (std::chrono::steady_clock::now() > deadline) return std::nullopt;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

std::vector<std::string> listing(const fs::path& folder) {
  std::vector<std::string> names;
  if (!fs::exists(folder)) return names;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    names.push_back(fs::relative(entry.path(), folder).string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace fringecal::test

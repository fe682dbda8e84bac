#include "cli/serve/jobs.h"

#include "cli/argument_vector.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <thread>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

constexpr const char* kSchema = "fringecal.job";
constexpr int kLock = 3;  // the lock's number in the keeper and the command
constexpr std::size_t kLines = 40;
constexpr std::streamoff kTail = 8192;

/// The lock, or -1 where somebody has it. Ends with the last process that has the descriptor.
int take_lock(const fs::path& folder) {
  const int lock = ::open((folder / "job.lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock < 0) {
    throw EnvironmentError(fmt::format("{}: cannot be written ({})", folder.string(), std::strerror(errno)));
  }
  if (::flock(lock, LOCK_EX | LOCK_NB) == 0) return lock;
  ::close(lock);
  return -1;
}

struct Job {
  int number = 0;
  std::vector<std::string> arguments;
  std::string begun, ended;
  int keeper = 0;
  std::optional<int> exit_code;
};

Value to_value(const Job& job) {
  Value arguments = Value::array();
  for (const auto& word : job.arguments) arguments.append(word);
  Value out = Value::object()
                  .set("schema", kSchema)
                  .set("schema_version", 1)
                  .set("number", job.number)
                  .set("arguments", arguments)
                  .set("begun", job.begun);
  if (job.keeper > 0) out.set("keeper", job.keeper);
  if (!job.ended.empty()) out.set("ended", job.ended);
  if (job.exit_code) out.set("exit_code", *job.exit_code);
  return out;
}

std::optional<Job> read_job(const fs::path& folder) {
  const fs::path file = folder / "job.json";
  std::error_code error;
  if (!fs::exists(file, error)) return std::nullopt;
  Fields f(read_json(file), file.string());
  f.expect_schema(kSchema, 1);
  Job job;
  job.number = f.integer("number");
  job.arguments = f.texts("arguments");
  job.begun = f.text("begun");
  job.ended = f.optional_text("ended").value_or("");
  job.keeper = f.optional_integer("keeper").value_or(0);
  job.exit_code = f.optional_integer("exit_code");
  f.finish();
  return job;
}

void write_job(const fs::path& folder, const Job& job) {
  write_atomically(folder / "job.json", to_json(to_value(job)));
}

/// This program with these words, in a session of its own or not; its standard output and error go to files there.
pid_t start_program(std::vector<std::string> words, const fs::path& folder, bool session, int lock) {
  words.insert(words.begin(), "fringecal");
  const std::vector<char*> argv = argument_vector(words);
  const std::string out = (folder / "output").string(), err = (folder / "errors").string();
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, out.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, err.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (lock >= 0) posix_spawn_file_actions_adddup2(&files, lock, kLock);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, static_cast<short>(POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                                           (session ? POSIX_SPAWN_SETSID : 0)));
  pid_t process = -1;
  const int failure = posix_spawn(&process, "/proc/self/exe", &files, &attributes, argv.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  if (failure != 0) throw EnvironmentError(fmt::format("serve: no process can be started: {}", std::strerror(failure)));
  return process;
}

/// The last lines of a file, whole ones.
Value last_lines(const fs::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  Value out = Value::array();
  if (!in) return out;
  const std::streamoff size = in.tellg();
  in.seekg(std::max<std::streamoff>(0, size - kTail));
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  if (size > kTail && !lines.empty()) lines.erase(lines.begin());
  for (std::size_t i = lines.size() > kLines ? lines.size() - kLines : 0; i < lines.size(); ++i) out.append(lines[i]);
  return out;
}

}  // namespace

Jobs::Jobs(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw EnvironmentError(fmt::format("{}: cannot be made ({})", folder_.string(), error.message()));
}

bool Jobs::running() const {
  const std::lock_guard hold(mutex_);
  const int lock = take_lock(folder_);
  if (lock >= 0) ::close(lock);
  return lock < 0;
}

bool Jobs::start(const std::vector<std::string>& arguments) {
  const std::lock_guard hold(mutex_);
  const int lock = take_lock(folder_);
  if (lock < 0) return false;
  try {
    const auto before = read_job(folder_);
    Job job{.number = before ? before->number + 1 : 1, .arguments = arguments, .begun = utc_now(), .ended = {}};
    for (const char* left : {"output", "errors", "progress.json"}) fs::remove(folder_ / left);
    write_job(folder_, job);
    const pid_t keeper = start_program({"keep-job", folder_.string()}, folder_, true, lock);
    // A keeper that this server outlives is waited for, or it stays in the table of processes.
    std::thread([keeper] { ::waitpid(keeper, nullptr, 0); }).detach();
  } catch (...) {
    ::close(lock);
    throw;
  }
  ::close(lock);
  return true;
}

bool Jobs::stop() {
  if (!running()) return false;
  const auto job = read_job(folder_);
  return job && job->keeper > 0 && ::kill(job->keeper, SIGTERM) == 0;
}

Value Jobs::state() const {
  const bool runs = running();
  const auto job = read_job(folder_);
  if (!job) return Value::object().set("state", "none");
  Value out = to_value(*job);
  out.set("state", runs ? "running" : job->exit_code ? "ended" : "broken").set("lines", last_lines(folder_ / "errors"));
  std::error_code error;
  if (runs && fs::exists(folder_ / "progress.json", error)) out.set("progress", read_json(folder_ / "progress.json"));
  return out;
}

void keep_job(const fs::path& folder) {
  auto job = read_job(folder);
  if (!job) throw InputError(fmt::format("{}: there is no job to keep", folder.string()));
  sigset_t set;
  sigemptyset(&set);
  for (const int s : {SIGTERM, SIGINT, SIGHUP, SIGCHLD}) sigaddset(&set, s);
  sigprocmask(SIG_BLOCK, &set, nullptr);
  job->keeper = getpid();
  write_job(folder, *job);
  setenv("FRINGECAL_PROGRESS_FILE", (folder / "progress.json").c_str(), 1);
  const pid_t command = start_program(job->arguments, folder, false, -1);
  int status = 0, asked = 0;
  while (::waitpid(command, &status, WNOHANG) == 0) {
    int signal = 0;
    sigwait(&set, &signal);
    if (signal != SIGCHLD) ::kill(command, ++asked > 1 ? SIGKILL : SIGINT);
  }
  job->exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  job->ended = utc_now();
  write_job(folder, *job);
}

}  // namespace fringecal::cli::serve

#include "core/file.h"

#include "core/error.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <system_error>
#include <vector>

namespace fringecal {
namespace fs = std::filesystem;
namespace {

std::string reason() { return std::strerror(errno); }

[[noreturn]] void fail_writing(const fs::path& file, const std::string& why) {
  throw EnvironmentError(
      fmt::format("{}: cannot be written ({}); free space or choose another folder", file.string(), why));
}

void sync_folder(const fs::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd >= 0) {
    ::fsync(fd);
    ::close(fd);
  }
}

void make_folder(const fs::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail_writing(folder, error.message());
}

}  // namespace

std::string read_bytes(const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) {
    if (error)
      throw InputError(fmt::format("{}: cannot be opened ({}); check its permissions", file.string(), error.message()));
    throw InputError(fmt::format("{}: there is no such file; check the path", file.string()));
  }
  if (fs::is_directory(file, error)) {
    throw InputError(fmt::format("{}: this is a folder; a file is needed here", file.string()));
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(fmt::format("{}: cannot be opened ({}); check its permissions", file.string(), reason()));
  std::string bytes;
  const auto size = fs::file_size(file, error);
  if (!error && size > 0) {
    bytes.resize(size);
    in.read(bytes.data(), static_cast<std::streamsize>(size));
    bytes.resize(static_cast<std::size_t>(in.gcount()));
  } else {
    bytes.assign(std::istreambuf_iterator<char>(in), {});
  }
  if (in.bad()) throw EnvironmentError(fmt::format("{}: reading failed ({}); check the disk", file.string(), reason()));
  return bytes;
}

void write_atomically(const fs::path& file, std::string_view bytes) {
  make_folder(file.parent_path());
  const fs::path temporary = file.string() + fmt::format(".{}.part", ::getpid());
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) fail_writing(file, reason());
  std::string failure;
  for (std::size_t done = 0; done < bytes.size() && failure.empty();) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n >= 0) {
      done += static_cast<std::size_t>(n);
    } else if (errno != EINTR) {
      failure = reason();
    }
  }
  if (failure.empty() && ::fsync(fd) != 0) failure = reason();
  if (::close(fd) != 0 && failure.empty()) failure = reason();
  if (failure.empty() && ::rename(temporary.c_str(), file.c_str()) != 0) failure = reason();
  if (!failure.empty()) {
    ::unlink(temporary.c_str());
    fail_writing(file, failure);
  }
  sync_folder(file.has_parent_path() ? file.parent_path() : fs::path("."));
}

std::string sha256_hex(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  require(EVP_Digest(bytes.data(), bytes.size(), digest.data(), &length, EVP_sha256(), nullptr) == 1,
          "SHA-256 is available");
  std::string out;
  for (unsigned int i = 0; i < length; ++i) out += fmt::format("{:02x}", digest[i]);
  return out;
}

std::string sha256_of_file(const fs::path& file) { return sha256_hex(read_bytes(file)); }

std::string utc_now() {
  std::time_t now = std::time(nullptr);
  if (const char* epoch = std::getenv("SOURCE_DATE_EPOCH")) now = static_cast<std::time_t>(std::atoll(epoch));
  std::tm parts{};
  gmtime_r(&now, &parts);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday,
                     parts.tm_hour, parts.tm_min, parts.tm_sec);
}

FolderTransaction::FolderTransaction(fs::path target) : target_(std::move(target)) {
  while (!target_.has_filename() && target_.has_parent_path() && target_ != target_.root_path()) {
    target_ = target_.parent_path();  // "out/" -> "out"
  }
  working_ = target_.string() + fmt::format(".{}.part", ::getpid());
  std::error_code error;
  fs::remove_all(working_, error);
  make_folder(working_);
}

FolderTransaction::~FolderTransaction() {
  if (!committed_) {
    std::error_code error;
    fs::remove_all(working_, error);
  }
}

void FolderTransaction::commit() {
  std::error_code error;
  const fs::path old = target_.string() + fmt::format(".{}.old", ::getpid());
  if (fs::exists(target_, error)) {
    fs::rename(target_, old, error);
    if (error) fail_writing(target_, error.message());
  }
  fs::rename(working_, target_, error);
  if (error) {
    const std::string why = error.message();
    fs::rename(old, target_, error);
    fail_writing(target_, why);
  }
  committed_ = true;
  fs::remove_all(old, error);
  sync_folder(target_.has_parent_path() ? target_.parent_path() : fs::path("."));
}

void remove_unfinished(const fs::path& folder) {
  const auto is_unfinished = [](const fs::path& name) {  // NAME.PID.part
    const std::string pid = name.stem().extension().string();
    return name.extension() == ".part" && pid.size() > 1 && pid.find_first_not_of("0123456789", 1) == std::string::npos;
  };
  std::error_code error;
  std::vector<fs::path> unfinished;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (!is_unfinished(entry->path().filename())) continue;
    unfinished.push_back(entry->path());
    if (entry->is_directory(error)) entry.disable_recursion_pending();
  }
  for (const fs::path& path : unfinished) fs::remove_all(path, error);
}

}  // namespace fringecal

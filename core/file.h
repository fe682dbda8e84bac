// Files: whole-file reading, and writing that leaves either the old file or the new one, never half of one.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace fringecal {

/// The bytes of a file. Throws InputError if it is missing, a folder, or unreadable.
std::string read_bytes(const std::filesystem::path& file);

/// Writes to a temporary name in the same folder, syncs, renames. Creates the folder. After a crash there is the old
/// file or the new one. Throws EnvironmentError (disk full, no permission, read-only) and removes the temporary file.
void write_atomically(const std::filesystem::path& file, std::string_view bytes);

/// Lower-case hexadecimal SHA-256 (FIPS 180-4).
std::string sha256_hex(std::string_view bytes);
std::string sha256_of_file(const std::filesystem::path& file);

/// RFC 3339 UTC, "2026-11-21T23:55:16Z". SOURCE_DATE_EPOCH, when set, replaces the clock.
std::string utc_now();

/// A folder that appears under its name only when complete: files are written into `working()`, commit() renames it.
/// Destroyed without commit(), everything in it is removed. An existing folder of that name is replaced by commit().
class FolderTransaction {
 public:
  explicit FolderTransaction(std::filesystem::path target);
  ~FolderTransaction();
  FolderTransaction(const FolderTransaction&) = delete;
  FolderTransaction& operator=(const FolderTransaction&) = delete;

  const std::filesystem::path& working() const { return working_; }
  void commit();

 private:
  std::filesystem::path target_, working_;
  bool committed_ = false;
};

/// Removes what a program that was killed while writing left unfinished in a folder and below it. Only for a folder in
/// which no other program writes.
void remove_unfinished(const std::filesystem::path& folder);

}  // namespace fringecal

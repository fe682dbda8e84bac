// The folder of one commissioning: what is finished is a file in it, so a second call continues where the first ended.
//
// commission.json (schema "fringecal.commission", version 1) holds the choices of the first call; a later call with
// other choices is refused. Every item of work writes its result atomically under its own name; has(name) is all that
// resuming asks. Frames are kept as Captures beside the results.
#pragma once

#include "core/value.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace fringecal::cli {

struct CommissionChoices {
  std::string sheet_sha256 =
      {};  // of a scanner of one's own (cli/instrument_sheet.h); the virtual one has the next two
  std::string preset = "chen2008";
  std::uint64_t seed = 1;
  std::optional<double> theta_mrad;  // fringe angle to start from; absent: the preset's
  int repeats = 10;
  bool linearisation = true, stack_correction = true;  // in the verification; false for comparison only
};

class CommissionSession {
 public:
  /// Opens or makes the folder. fresh: whatever an earlier commissioning left in it is removed first; a folder that is
  /// not a commissioning and not empty is refused.
  /// While the object lives no other commissioning can work in the folder. What a commissioning that was killed left
  /// unwritten in it is removed.
  CommissionSession(std::filesystem::path folder, const CommissionChoices& choices, bool fresh);
  ~CommissionSession();
  CommissionSession(const CommissionSession&) = delete;
  CommissionSession& operator=(const CommissionSession&) = delete;

  const CommissionChoices& choices() const { return choices_; }
  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path path(const std::string& name) const { return folder_ / name; }
  bool has(const std::string& name) const;
  void store(const std::string& name, const Value& value) const;
  Value load(const std::string& name) const;

  /// A capture that cannot be used, because of why: kept under another name, so that the next call takes it again.
  /// Throws InputError with that.
  [[noreturn]] void refuse_capture(const std::string& name, const std::string& why) const;

  /// A seed of its own for each stack of the virtual scanner, the same in every call.
  std::uint64_t stack_seed(const std::string& item) const;

 private:
  void lock();

  std::filesystem::path folder_;
  CommissionChoices choices_;
  int lock_ = -1;
};

}  // namespace fringecal::cli

#include "cli/commission_session.h"

#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "core/provenance.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace fringecal::cli {
namespace fs = std::filesystem;
namespace {

constexpr const char* kFile = "commission.json";
constexpr const char* kSchema = "fringecal.commission";

Value to_value(const CommissionChoices& c) {
  Value out = Value::object().set("schema", kSchema).set("schema_version", 1);
  if (c.sheet_sha256.empty()) {
    out.set("preset", c.preset).set("seed", std::to_string(c.seed));
  } else {
    out.set("sheet_sha256", c.sheet_sha256);
  }
  out.set("repeats", c.repeats)
      .set("linearisation", c.linearisation)
      .set("stack_correction", c.stack_correction)
      .set("program_version", kProgramVersion);
  if (c.theta_mrad) out.set("theta_mrad", *c.theta_mrad);
  return out;
}

void refuse_other_choices(const fs::path& file, const CommissionChoices& now) {
  Fields f(read_json(file), file.string());
  f.expect_schema(kSchema, 1);
  const std::string sheet = f.optional_text("sheet_sha256").value_or(""), version = f.text("program_version");
  const std::string preset = sheet.empty() ? f.text("preset") : "", seed = sheet.empty() ? f.text("seed") : "";
  const int repeats = f.integer("repeats");
  const bool linearisation = f.optional_boolean("linearisation").value_or(true);
  const bool stack_correction = f.optional_boolean("stack_correction").value_or(true);
  const auto theta = f.optional_number("theta_mrad");
  f.finish();
  const auto differs = [&](const std::string& what, const std::string& then, const std::string& today) {
    if (then == today) return;
    throw InputError(
        fmt::format("{}: this commissioning was begun with {} {}, not {}; repeat that choice, give another "
                    "--output, or start over with --fresh",
                    file.string(), what, then, today));
  };
  const auto word = [](const std::optional<double>& t) { return t ? fmt::format("{} mrad", *t) : "of the preset"; };
  const auto of = [](const std::string& hash) { return hash.empty() ? "no sheet (virtual)" : "SHA-256 " + hash; };
  differs("an instrument sheet of", of(sheet), of(now.sheet_sha256));
  if (sheet.empty()) {
    differs("preset", preset, now.preset);
    differs("seed", seed, std::to_string(now.seed));
  }
  differs("repeats", std::to_string(repeats), std::to_string(now.repeats));
  differs("theta", word(theta), word(now.theta_mrad));
  const auto on = [](bool is) { return is ? "on" : "off"; };
  differs("phase linearisation", on(linearisation), on(now.linearisation));
  differs("stack correction", on(stack_correction), on(now.stack_correction));
  differs("program version", version, kProgramVersion);
}

/// What a program leaves behind that was killed while it made the folder.
bool only_unfinished_in(const fs::path& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (!entry.path().filename().string().starts_with(kFile)) return false;
  }
  return true;
}

}  // namespace

CommissionSession::CommissionSession(fs::path folder, const CommissionChoices& choices, bool fresh)
    : folder_(std::move(folder)), choices_(choices) {
  const fs::path file = folder_ / kFile;
  std::error_code error;
  if (fs::exists(folder_, error) && !fs::is_directory(folder_, error)) {
    throw InputError(fmt::format("{}: this is a file; give a folder as --output", folder_.string()));
  }
  if (fs::is_directory(folder_, error)) {
    lock();
    if (only_unfinished_in(folder_) || fs::exists(file, error)) remove_unfinished(folder_);
  }
  const bool begun = fs::exists(file, error);
  if (!begun && fs::exists(folder_, error) && !fs::is_empty(folder_, error)) {
    throw InputError(fmt::format("{}: this folder is not empty and holds no commissioning; give another --output",
                                 folder_.string()));
  }
  if (begun && fresh) {
    for (const char* part : {"alignment", "linearisation", "linearisation.json", "calibration", "verification",
                             "report.html", "report.json", "scanner.json", "scanner.toml", "truth.json"}) {
      fs::remove_all(folder_ / part, error);
      if (error) {
        throw EnvironmentError(
            fmt::format("{}: cannot be removed ({}); remove it by hand", (folder_ / part).string(), error.message()));
      }
    }
  } else if (begun) {
    refuse_other_choices(file, choices_);
    return;
  }
  fs::create_directories(folder_, error);
  if (error) {
    throw EnvironmentError(
        fmt::format("{}: cannot be written ({}); give another --output", folder_.string(), error.message()));
  }
  lock();  // before the choices are written, lest a second program's overwrite those of the first
  write_atomically(file, to_json(to_value(choices_)));
}

CommissionSession::~CommissionSession() {
  if (lock_ >= 0) close(lock_);
}

void CommissionSession::refuse_capture(const std::string& name, const std::string& why) const {
  std::string aside;
  for (int k = 1; aside.empty() || has(aside); ++k) aside = fmt::format("{}-refused-{}", name, k);
  std::error_code error;
  fs::rename(path(name), path(aside), error);
  throw InputError(fmt::format("{}: {}; {}", path(name).string(), why,
                               error ? "remove that folder and run the same command again"
                                     : "kept as " + aside + ", the same command takes it again"));
}

/// The lock is the system's: it ends with the program, however that ends.
void CommissionSession::lock() {
  if (lock_ >= 0) return;
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock_ < 0 || flock(lock_, LOCK_EX | LOCK_NB) == 0) return;  // a disk without locks works without
  if (errno != EWOULDBLOCK) return;
  throw InputError(fmt::format("{}: another commissioning is at work there; wait for its end or give another --output",
                               folder_.string()));
}

bool CommissionSession::has(const std::string& name) const {
  std::error_code error;
  return fs::exists(path(name), error);
}

void CommissionSession::store(const std::string& name, const Value& value) const {
  write_atomically(path(name), to_json(value));
}

Value CommissionSession::load(const std::string& name) const { return read_json(path(name)); }

std::uint64_t CommissionSession::stack_seed(const std::string& item) const {
  const std::string hash = sha256_hex(fmt::format("{}/{}", choices_.seed, item));
  return std::stoull(hash.substr(0, 16), nullptr, 16);
}

}  // namespace fringecal::cli

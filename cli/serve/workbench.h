// The workbench's folder and what the pages show of it: the records that the commands left, put together and nothing
// more. FOLDER, as `./dev run` makes it:
//   commissioning/       of `fringecal commission`
//   verification*/       of `fringecal verify`, one each
//   history.db, clouds/  the chained record; point clouds (PLY)
//   .serve/              the job (jobs.h) and the sessions (gate.h)
// FOLDER may be a commissioning's own folder: then its parent is meant.
//
// A file that cannot be read becomes a sentence in "trouble", not an error: the other parts are shown.
#pragma once

#include "cli/serve/jobs.h"
#include "core/value.h"

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace fringecal::cli::serve {

/// Whether there is such a file or folder; not where that cannot be found out.
bool there(const std::filesystem::path& file);

class Workbench {
 public:
  explicit Workbench(const std::filesystem::path& folder);
  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path commissioning() const { return folder_ / commissioning_name_; }
  std::filesystem::path history() const { return folder_ / "history.db"; }
  std::filesystem::path serve_folder() const { return folder_ / ".serve"; }

  /// Everything that Home shows, and what is next.
  Value state(const Value& job) const;
  /// The alignment's record and the profiles of the report, as they stand.
  Value alignment() const;
  /// Residuals, parameters and the board's places; `so_far` where poses are still to come.
  Value calibration() const;
  /// What it is uncertain by over a plane of the volume, and where to hold the board next: {rms_mm, worst_mm, open,
  /// section?, next}; empty where there is no Scanner yet.
  Value calibration_map() const;
  /// The board as the camera saw it in a pose: the mean of its phase frames, which has no fringes. Throws InputError.
  Value calibration_picture(int pose) const;
  /// The record of one verification of the list, or its captures so far. Throws InputError.
  Value verification(const std::string& name) const;
  /// The same in space: {camera, code: outlines of the fields; positions: [{capture, artefacts: [{name, place, lines?}],
  /// fits?}]}, all lines as x, y, z of one point after the other, frame world, mm. A position with `fits` is done. Throws
  /// InputError.
  Value verification_space(const std::string& name) const;
  /// A residual cloud of it. Throws InputError.
  std::filesystem::path verification_cloud(const std::string& name, const std::string& cloud) const;
  Value plans() const;
  /// Entries and the quantities that have a chart.
  Value history_list() const;
  Value history_entry(std::int64_t number) const;
  Value history_chart(const std::string& symbol, const std::string& artefact) const;
  /// Documents of `fringecal certify` and `report` in the folder, and one of them. Throws InputError.
  Value certificates() const;
  std::filesystem::path certificate_file(const std::string& folder, const std::string& file) const;
  /// Captures that can become a cloud, and clouds.
  Value clouds() const;
  /// A cloud's file. Throws InputError.
  std::filesystem::path cloud_file(const std::string& name) const;

  /// The words of a command. Throws InputError where an option is not acceptable.
  std::vector<std::string> command(const Value& request) const;

 private:
  Value commissioning_state(Value& trouble) const;
  Value verifications(Value& trouble) const;
  /// scanner.json, or that of the poses so far; empty where neither is there.
  std::filesystem::path scanner_file() const;
  std::filesystem::path verification_folder(const std::string& name) const;
  /// Of a verification: from its record, or from the folder's name that this page gave it. Throws InputError.
  std::string plan_of(const std::string& name) const;
  std::vector<std::string> commission_command(const Value& request) const;
  std::vector<std::string> verify_command(const Value& request) const;
  std::vector<std::string> measure_command(const Value& request) const;
  /// Read once for every change of the file.
  Value cached(const std::filesystem::path& file) const;

  std::filesystem::path folder_;
  std::string commissioning_name_ = "commissioning";
  struct Kept {
    std::filesystem::file_time_type time;
    std::uintmax_t size = 0;
    Value value;
  };
  mutable std::mutex mutex_;
  mutable std::map<std::string, Kept> kept_;
};

}  // namespace fringecal::cli::serve

// fringecal check-fits [DIR]: the fits against data with known exact solutions, or against .ds/.fit pairs.
#include "fitting/check_fits.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/point_file.h"
#include "core/provenance.h"
#include "core/value.h"

#include <fmt/format.h>
#include <sys/utsname.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

namespace fringecal::cli {
namespace {

namespace fs = std::filesystem;

struct CheckArguments {
  std::string folder;
  int cases = 20;
  bool json = false;
};

std::string machine() {
  utsname name{};
  uname(&name);
  std::string cpu = "unknown processor";
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (!line.starts_with("model name")) continue;
    cpu = line.substr(line.find(':') + 2);
    break;
  }
  return fmt::format("{} {}, {}", name.sysname, name.machine, cpu);
}

void print(const Value& rows, const CheckArguments& arguments, const std::string& table) {
  if (!arguments.json) {
    fmt::print("fringecal {} on {}\n{}", kProgramVersion, machine(), table);
    return;
  }
  Value out = Value::object();
  out.set("version", kProgramVersion).set("machine", machine()).set("checks", rows);
  fmt::print("{}", to_json(out));
}

void check_generated(const CheckArguments& arguments) {
  Value rows = Value::array();
  std::string table = fmt::format("{:<10}{:<28}{:>6}{:>15}{:>16}{:>12}{:>14}\n", "shape", "condition", "cases",
                                  "position / mm", "direction / rad", "size / mm", "in roundings");
  int refused = 0;
  for (const auto& c : fitting::check_fits({.cases_per_class = arguments.cases})) {
    Value row = Value::object();
    row.set("shape", c.shape).set("condition", c.condition).set("cases", c.cases).set("refused", c.refused);
    row.set("max_position_mm", c.position_mm).set("max_direction_rad", c.direction_rad).set("max_size_mm", c.size_mm);
    row.set("max_in_roundings_of_coordinates", c.roundings);
    rows.append(row);
    table += fmt::format("{:<10}{:<28}{:>6}{:>15.1e}{:>16.1e}{:>12.1e}{:>14.1f}{}\n", c.shape, c.condition, c.cases,
                         c.position_mm, c.direction_rad, c.size_mm, c.roundings,
                         c.refused > 0 ? fmt::format("  {} without result", c.refused) : "");
    refused += c.refused;
  }
  table +=
      "Largest deviations from the exact solution, as for a radius (plane: half side) of 25 mm; in roundings: of the\n"
      "coordinates given, at the scale of the case.\n";
  print(rows, arguments, table);
  if (refused > 0)
    throw EnvironmentError(fmt::format("{} checks had no result; this build's fits must not be trusted", refused));
}

void check_pairs(const CheckArguments& arguments) {
  if (!fs::is_directory(arguments.folder))
    throw InputError(fmt::format("{} is not a folder; name one with .ds and .fit files", arguments.folder));
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(arguments.folder)) {
    if (entry.path().extension() == ".ds" && fs::exists(fs::path(entry.path()).replace_extension(".fit")))
      files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) throw InputError(fmt::format("{}: no pair of a .ds and a .fit file in it", arguments.folder));
  Value rows = Value::array();
  std::string table =
      fmt::format("{:<28}{:<10}{:>15}{:>16}{:>12}\n", "pair", "shape", "position / mm", "direction / rad", "size / mm");
  std::string failed;
  for (const fs::path& file : files) {
    std::ifstream in(fs::path(file).replace_extension(".fit"));
    std::vector<double> reference;
    for (double x = 0; in >> x;) reference.push_back(x);
    const auto pair =
        fitting::check_pair(fs::relative(file, arguments.folder).string(), read_points_mm(file), reference);
    Value row = Value::object();
    row.set("pair", pair.name).set("shape", pair.shape);
    row.set("position_mm", pair.position_mm).set("direction_rad", pair.direction_rad).set("size_mm", pair.size_mm);
    if (!pair.failure.empty()) row.set("failure", pair.failure);
    rows.append(row);
    table += pair.failure.empty() ? fmt::format("{:<28}{:<10}{:>15.1e}{:>16.1e}{:>12.1e}\n", pair.name, pair.shape,
                                                pair.position_mm, pair.direction_rad, pair.size_mm)
                                  : fmt::format("{:<28}{}\n", pair.name, pair.failure);
    if (!pair.failure.empty() && failed.empty()) failed = fmt::format("{}: {}", pair.name, pair.failure);
  }
  print(rows, arguments, table);
  if (!failed.empty()) throw InputError(failed);
}

}  // namespace

void add_check_fits(CLI::App& app) {
  auto arguments = std::make_shared<CheckArguments>();
  CLI::App* check =
      app.add_subcommand("check-fits", "Proves the fits on this machine: against exact solutions, or reference pairs");
  check->add_option(
      "folder", arguments->folder,
      "folder with pairs N.ds (points) and N.fit (reference); without it data with known exact solutions are made");
  check->add_option("--cases", arguments->cases, "cases per class of conditions (default 20)")
      ->check(CLI::Range(1, 100000));
  check->add_flag("--json", arguments->json, "print JSON with all digits instead of the table");
  check->footer("Example: fringecal check-fits --cases 100");
  check->callback([arguments] { arguments->folder.empty() ? check_generated(*arguments) : check_pairs(*arguments); });
}

}  // namespace fringecal::cli

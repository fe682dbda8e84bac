// The words of the commands that the pages may start: a fixed list, every option looked at here and again by the
// command itself.
#include "cli/serve/workbench.h"
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "metrology/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <regex>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

Fields fields_of(const Value& request) { return {request, "the page's request"}; }

/// Names of folders and files that a page may give: letters, digits, "._-", and no dot in front.
bool plain(const std::string& name) {
  static const std::regex kPlain("[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}");
  return std::regex_match(name, kPlain);
}

}  // namespace

std::vector<std::string> Workbench::command(const Value& request) const {
  const Value* name = request.find("command");
  if (!name || !name->if_text()) throw InputError("the page's request names no command");
  if (*name->if_text() == "commission") return commission_command(request);
  if (*name->if_text() == "verify") return verify_command(request);
  if (*name->if_text() == "measure") return measure_command(request);
  throw InputError(fmt::format("\"{}\" is not a command of the page", *name->if_text()));
}

/// What was begun is continued with the choices it was begun with, unless `fresh` gives new ones.
std::vector<std::string> Workbench::commission_command(const Value& request) const {
  Fields asked = fields_of(request);
  asked.ignore("command");
  const bool fresh = asked.optional_boolean("fresh").value_or(false);
  const bool in_process = asked.optional_boolean("in_process").value_or(false);
  std::string seed = fmt::format("{}", asked.optional_integer("seed").value_or(1)), preset = "chen2008";
  int repeats = asked.optional_integer("repeats").value_or(10);
  std::optional<double> theta_mrad = asked.optional_number("theta_mrad");
  asked.finish();
  const fs::path begun = commissioning() / "commission.json";
  std::vector<std::string> out = {"commission", "--virtual", "--output", commissioning().string()};
  if (there(begun) && !fresh) {
    Fields choices(read_json(begun), begun.string());
    if (choices.has("sheet_sha256")) {
      throw InputError(
          fmt::format("{}: an operator is asked for every step of this commissioning; continue it on the "
                      "command line",
                      commissioning().string()));
    }
    seed = choices.text("seed");
    preset = choices.text("preset");
    repeats = choices.integer("repeats");
    theta_mrad = choices.optional_number("theta_mrad");
    if (!choices.optional_boolean("linearisation").value_or(true)) out.emplace_back("--no-linearisation");
    if (!choices.optional_boolean("stack_correction").value_or(true)) out.emplace_back("--no-stack-correction");
  }
  out.insert(out.end(), {"--seed", seed, "--preset", preset, "--repeats", std::to_string(repeats)});
  if (theta_mrad) out.insert(out.end(), {"--theta", fmt::format("{}", *theta_mrad)});
  if (in_process) out.emplace_back("--in-process");
  if (fresh && there(begun)) out.emplace_back("--fresh");
  return out;
}

/// A verification of that plan that was begun and not finished is continued; otherwise a new one has a new folder.
std::vector<std::string> Workbench::verify_command(const Value& request) const {
  Fields asked = fields_of(request);
  asked.ignore("command");
  const std::string plan = asked.text("plan");
  asked.finish();
  const auto plans = metrology::shipped_plans();
  if (std::find(plans.begin(), plans.end(), plan) == plans.end()) {
    throw InputError(fmt::format("\"{}\" is not a plan of the page", plan));
  }
  std::string name, stamp = utc_now();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string folder = entry.path().filename().string();
    if (folder.starts_with("verification-" + plan + "-") && !there(entry.path() / "verification.json")) name = folder;
  }
  std::erase_if(stamp, [](char c) { return c == '-' || c == ':'; });
  if (name.empty()) name = fmt::format("verification-{}-{}", plan, stamp);
  for (int again = 2; there(folder_ / name / "verification.json"); ++again) {
    name = fmt::format("verification-{}-{}-{}", plan, stamp, again);
  }
  return {"verify",          "--virtual",
          "--plan",          plan,
          "--commissioning", commissioning().string(),
          "--output",        (folder_ / name).string(),
          "--history",       history().string()};
}

std::vector<std::string> Workbench::measure_command(const Value& request) const {
  Fields asked = fields_of(request);
  asked.ignore("command");
  const std::string capture = asked.text("capture");
  asked.finish();
  if (!plain(capture) || !there(commissioning() / "verification" / capture / "capture.json")) {
    throw InputError(fmt::format("there is no capture \"{}\"", capture));
  }
  std::error_code error;
  fs::create_directories(folder_ / "clouds", error);
  return {"measure",   (commissioning() / "verification" / capture).string(),
          "--scanner", (commissioning() / "scanner.json").string(),
          "--output",  (folder_ / "clouds" / (capture + ".ply")).string()};
}

Value Workbench::clouds() const {
  Value clouds = Value::array(), captures = Value::array();
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ / "clouds", error)) {
    const std::string name = entry.path().filename().string();
    if (entry.path().extension() == ".ply" && plain(name)) names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  for (const auto& name : names) {
    clouds.append(Value::object()
                      .set("name", name)
                      .set("bytes", static_cast<std::int64_t>(fs::file_size(folder_ / "clouds" / name, error))));
  }
  names.clear();
  for (const auto& entry : fs::directory_iterator(commissioning() / "verification", error)) {
    if (there(entry.path() / "capture.json")) names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  for (const auto& name : names) captures.append(name);
  return Value::object().set("clouds", clouds).set("captures", captures);
}

fs::path Workbench::cloud_file(const std::string& name) const {
  fs::path file = folder_ / "clouds" / name;
  std::error_code error;
  if (!plain(name) || file.extension() != ".ply" || !fs::is_regular_file(fs::symlink_status(file, error))) {
    throw InputError(fmt::format("there is no cloud \"{}\"", name));
  }
  return file;
}

}  // namespace fringecal::cli::serve

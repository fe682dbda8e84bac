#include "cli/serve/workbench.h"

#include "core/error.h"
#include "core/file.h"
#include "core/provenance.h"
#include "metrology/history_series.h"
#include "metrology/instrument_record.h"
#include "metrology/plan.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <initializer_list>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

/// When a file was written, RFC 3339 UTC.
std::string date_of(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return "";
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(status.st_mtime));
}

/// The value at a path of keys, or null.
Value at(const Value& tree, std::initializer_list<const char*> keys) {
  const Value* here = &tree;
  for (const char* key : keys) {
    here = here->find(key);
    if (!here) return {};
  }
  return *here;
}

void copy(const Value& from, Value& to, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    if (const Value* value = from.find(key)) to.set(key, *value);
  }
}

std::size_t files_in(const fs::path& folder, const std::string& ending) {
  std::error_code error;
  std::size_t count = 0;
  for (const auto& entry : fs::directory_iterator(folder, error)) count += entry.path().extension() == ending ? 1 : 0;
  return count;
}

std::size_t captures_in(const fs::path& folder) {
  std::error_code error;
  std::size_t count = 0;
  for (const auto& entry : fs::directory_iterator(folder, error)) count += there(entry.path() / "capture.json") ? 1 : 0;
  return count;
}

std::vector<std::string> names_in(const fs::path& folder) {
  std::error_code error;
  std::vector<std::string> out;
  for (const auto& entry : fs::directory_iterator(folder, error)) out.push_back(entry.path().filename().string());
  std::sort(out.begin(), out.end());
  return out;
}

/// Plan of a folder "verification-PLAN-DATE" that this page began.
std::string plan_in(const std::string& name) {
  for (const auto& plan : metrology::shipped_plans()) {
    if (name.starts_with("verification-" + plan + "-")) return plan;
  }
  return "";
}

int captures_of(const metrology::Plan& plan) {
  int out = 0;
  for (const auto& series : plan.series) out += series.captures;
  return out;
}

/// Items of a commissioning's verification: repeats of three scenes.
constexpr int kScenes = 3, kPoses = 15;

}  // namespace

bool there(const fs::path& file) {
  std::error_code error;
  return fs::exists(file, error);
}

Workbench::Workbench(const fs::path& folder) : folder_(fs::absolute(folder).lexically_normal()) {
  if (!folder_.has_filename()) folder_ = folder_.parent_path();
  if (there(folder_ / "commission.json")) {
    commissioning_name_ = folder_.filename().string();
    folder_ = folder_.parent_path();
  }
}

Value Workbench::cached(const fs::path& file) const {
  std::error_code error;
  const auto time = fs::last_write_time(file, error);
  const auto size = fs::file_size(file, error);
  if (error) return {};
  const std::lock_guard hold(mutex_);
  auto found = kept_.find(file.string());
  if (found == kept_.end() || found->second.time != time || found->second.size != size) {
    found = kept_.insert_or_assign(file.string(), Kept{time, size, read_json(file)}).first;
  }
  return found->second.value;
}

Value Workbench::commissioning_state(Value& trouble) const {
  const fs::path folder = commissioning();
  Value out = Value::object().set("name", commissioning_name_);
  if (!there(folder / "commission.json")) return out;
  const auto part = [&](const char* file, const auto& use) {
    if (!there(folder / file)) return;
    try {
      use(cached(folder / file));
    } catch (const InputError& e) {
      trouble.append(e.what());
    }
  };
  part("commission.json", [&](const Value& v) { out.set("choices", v); });
  part("alignment/record.json", [&](const Value& v) {
    const Value all = at(v, {"iterations"});
    if (!all.if_array() || all.if_array()->empty()) return;
    const Value& last = all.if_array()->back();
    Value aligned = Value::object()
                        .set("date", date_of(folder / "alignment/record.json"))
                        .set("iterations", all.if_array()->size());
    copy(at(last, {"step"}), aligned, {"decision", "sentence", "bit", "delta_um", "u_delta_um", "tolerance_um"});
    copy(at(last, {"measured"}), aligned, {"theta_mrad", "u_theta_mrad"});
    out.set("alignment", aligned);
  });
  out.set("poses", captures_in(folder / "calibration")).set("poses_planned", kPoses);
  out.set("seen", files_in(folder / "calibration", ".json"));  // the page asks again when one is added
  if (there(folder / "calibration/so-far.json")) out.set("so_far", date_of(folder / "calibration/so-far.json"));
  part("scanner.json", [&](const Value& v) {
    Value calibrated = Value::object().set("date", date_of(folder / "scanner.json"));
    copy(at(v, {"residuals"}), calibrated,
         {"poses", "camera_rms_px", "projector_rms", "projector_unit", "grid_rms_mm"});
    out.set("calibration", calibrated);
  });
  if (const Value repeats = at(out, {"choices", "repeats"}); repeats.if_integer()) {
    out.set("measured", files_in(folder / "verification", ".json"))
        .set("measured_planned", kScenes * *repeats.if_integer());
  }
  part("report.json", [&](const Value& v) {
    Value report = Value::object().set("date", date_of(folder / "report.json"));
    copy(v, report, {"verdict", "verdict_text"});
    out.set("report", report);
  });
  return out;
}

Value Workbench::verifications(Value& trouble) const {
  Value out = Value::array();
  for (const auto& name : names_in(folder_)) {
    if (!name.starts_with("verification")) continue;
    const fs::path file = folder_ / name / "verification.json";
    const std::string plan = plan_in(name);
    if (!there(file) && plan.empty()) continue;
    Value one =
        Value::object().set("name", name).set("plan", plan).set("done", files_in(folder_ / name / "captures", ".json"));
    if (!plan.empty()) one.set("planned", captures_of(metrology::read_plan(plan)));
    if (there(file)) {
      try {
        const auto v = metrology::verification_from(cached(file), file.string());
        const auto verdict = metrology::verdict_of(v);
        one.set("plan", v.plan).set("ended", v.ended).set("scanner", v.scanner).set("quantities", v.quantities.size());
        if (verdict) one.set("verdict", name_of(*verdict));
      } catch (const InputError& e) {
        trouble.append(e.what());
      }
    }
    out.append(one);
  }
  return out;
}

Value Workbench::state(const Value& job) const {
  Value trouble = Value::array();
  const Value commissioned = commissioning_state(trouble), verified = verifications(trouble);
  const auto ended = [](const Value& v) { return v.find("ended") != nullptr; };
  const auto& list = *verified.if_array();
  Value out = Value::object()
                  .set("program_version", kProgramVersion)
                  .set("folder", folder_.string())
                  .set("job", job)
                  .set("commissioning", commissioned)
                  .set("verifications", verified)
                  .set("history", there(history()) ? Value(date_of(history())) : Value());
  const bool running = at(job, {"state"}).if_text() && *at(job, {"state"}).if_text() == "running";
  out.set("next", running                                         ? "wait"
                  : !commissioned.find("choices")                 ? "commission"
                  : !commissioned.find("report")                  ? "continue"
                  : std::none_of(list.begin(), list.end(), ended) ? "verify"
                                                                  : "verify_again");
  if (there(commissioning() / "scanner.toml")) {
    try {
      const Value file = read_toml(commissioning() / "scanner.toml");
      out.set("devices",
              Value::object().set("camera", at(file, {"camera", "address"})).set("plc", at(file, {"plc", "address"})));
    } catch (const InputError& e) {
      trouble.append(e.what());
    }
  }
  return out.set("trouble", trouble);
}

Value Workbench::alignment() const {
  Value out = Value::object();
  if (there(commissioning() / "alignment/record.json")) {
    out.set("iterations", at(cached(commissioning() / "alignment/record.json"), {"iterations"}));
  }
  if (there(commissioning() / "report.json")) {
    const Value section = at(cached(commissioning() / "report.json"), {"alignment"});
    copy(section, out, {"before", "after"});
  }
  return out;
}

fs::path Workbench::verification_folder(const std::string& name) const {
  const auto names = names_in(folder_);
  if (!name.starts_with("verification") || std::find(names.begin(), names.end(), name) == names.end()) {
    throw InputError(fmt::format("there is no verification \"{}\"", name));
  }
  return folder_ / name;
}

std::string Workbench::plan_of(const std::string& name) const {
  const fs::path file = verification_folder(name) / "verification.json";
  std::string plan = plan_in(name);
  if (there(file)) plan = metrology::verification_from(cached(file), file.string()).plan;
  if (plan.empty()) throw InputError(fmt::format("the plan of \"{}\" is not known", name));
  return plan;
}

Value Workbench::verification(const std::string& name) const {
  verification_folder(name);
  Value captures = Value::array();
  for (const auto& capture : names_in(folder_ / name / "captures")) captures.append(fs::path(capture).stem().string());
  Value out = Value::object().set("name", name).set("captures", captures);
  if (there(folder_ / name / "verification.json")) out.set("record", cached(folder_ / name / "verification.json"));
  return out;
}

Value Workbench::plans() const {
  Value out = Value::array();
  for (const auto& name : metrology::shipped_plans()) {
    const auto plan = metrology::read_plan(name);
    Value series = Value::array();
    for (const auto& s : plan.series) {
      Value artefacts = Value::array();
      for (const auto& a : s.artefacts) artefacts.append(a);
      series.append(Value::object()
                        .set("scene", s.scene)
                        .set("artefacts", artefacts)
                        .set("captures", s.captures)
                        .set("repeats", s.repeats));
    }
    out.append(Value::object()
                   .set("name", name)
                   .set("title", plan.title)
                   .set("source", plan.source)
                   .set("captures", captures_of(plan))
                   .set("series", series));
  }
  return out;
}

Value Workbench::history_list() const {
  Value entries = Value::array(), quantities = Value::array();
  if (there(history())) {
    const metrology::History file(history(), metrology::History::Access::read);
    const auto all = file.entries();
    for (const auto& e : all) {
      Value entry = Value::object().set("number", e.number).set("date", e.date).set("kind", e.kind).set("hash", e.hash);
      if (e.kind == "verification") {
        const auto v = metrology::verification_of(e);
        const auto verdict = metrology::verdict_of(v);
        entry.set("plan", v.plan).set("scanner", v.scanner);
        if (verdict) entry.set("verdict", name_of(*verdict));
      }
      entries.append(entry);
    }
    for (const auto& key : metrology::quantities_of(file)) {
      quantities.append(Value::object().set("symbol", key.symbol).set("artefact", key.artefact));
    }
  }
  return Value::object().set("entries", entries).set("quantities", quantities);
}

Value Workbench::history_entry(std::int64_t number) const {
  const metrology::History file(history(), metrology::History::Access::read);
  const auto e = file.entry(number);
  return Value::object()
      .set("number", e.number)
      .set("date", e.date)
      .set("kind", e.kind)
      .set("hash", e.hash)
      .set("document", parse_json(e.document, fmt::format("entry {}", number)));
}

Value Workbench::certificates() const {
  Value out = Value::array();
  for (const auto& folder : names_in(folder_)) {
    if (!folder.starts_with("certificate") && !folder.starts_with("report")) continue;
    for (const auto& file : names_in(folder_ / folder)) {
      const std::string ending = fs::path(file).extension().string();
      if (ending == ".pdf" || ending == ".xml" || ending == ".p7s" || ending == ".csv") {
        out.append(Value::object().set("folder", folder).set("file", file));
      }
    }
  }
  return Value::object().set("certificates", out);
}

fs::path Workbench::certificate_file(const std::string& folder, const std::string& file) const {
  const Value all = at(certificates(), {"certificates"});
  for (const Value& one : *all.if_array()) {
    if (*at(one, {"folder"}).if_text() == folder && *at(one, {"file"}).if_text() == file)
      return folder_ / folder / file;
  }
  throw InputError(fmt::format("there is no certificate \"{}\" in \"{}\"", file, folder));
}

Value Workbench::history_chart(const std::string& symbol, const std::string& artefact) const {
  const metrology::History file(history(), metrology::History::Access::read);
  // Of the instrument itself the page shows how it was left; what was found stands in the entries.
  metrology::HistorySeries series;
  if (artefact == metrology::kScannerItself) series = metrology::series_of(file, {symbol, artefact, "as left"});
  if (series.values.empty()) series = metrology::series_of(file, {symbol, artefact, std::nullopt});
  Value points = Value::array();
  const auto chart = metrology::control_chart(series.values);
  for (std::size_t i = 0; i < series.values.size(); ++i) {
    Value point = Value::object()
                      .set("number", series.numbers[i])
                      .set("day", series.values[i].day)
                      .set("value", series.values[i].value);
    if (series.U[i]) point.set("U", *series.U[i]);
    if (chart) {
      Value signals = Value::array();
      for (const auto signal : chart->points[i].signals) signals.append(name_of(signal));
      point.set("ewma", chart->points[i].ewma).set("ewma_limit", chart->points[i].ewma_limit).set("signals", signals);
    }
    points.append(point);
  }
  Value out = Value::object().set("name", series.name).set("unit", series.unit).set("points", points);
  if (chart) {
    out.set("mean", chart->mean).set("s", chart->s).set("n_baseline", chart->n_baseline);
  } else {
    out.set("no_chart", chart.error().sentence);
  }
  if (!series.limits) return out;
  if (series.limits->lower) out.set("lower_limit", *series.limits->lower);
  if (series.limits->upper) out.set("upper_limit", *series.limits->upper);
  if (const auto forecast = metrology::forecast(series.values, *series.limits)) {
    out.set("slope_per_day", forecast->slope_per_day).set("u_slope_per_day", forecast->u_slope_per_day);
    if (forecast->earliest_day) out.set("earliest_in_days", *forecast->earliest_day - series.values.back().day);
  }
  return out;
}

}  // namespace fringecal::cli::serve

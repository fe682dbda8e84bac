// fringecal verify: a plan carried out, evaluated and judged; resumable. On the virtual scanner by itself, on a real one
// from the captures that the plan asks for.
#include "cli/commands.h"
#include "cli/daily_check.h"
#include "cli/progress.h"
#include "cli/records.h"
#include "cli/virtual_verification.h"
#include "core/capture.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/acceptance.h"
#include "metrology/history.h"
#include "metrology/multi_view.h"
#include "metrology/reconstruct.h"
#include "reports/number.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cmath>
#include <memory>

namespace fringecal::cli {
namespace {
namespace fs = std::filesystem;

constexpr const char* kDiagnosis = "captures/diagnosis.json";  // before the limits are looked at

struct Options {
  std::string plan = "paper", scanner, artefacts, captures, output = "verification", history, identification, rule,
              baseline, fault;
  std::string commissioning = "commissioning";
  double temperature_degC = 20, u_temperature_degC = 0.2;
  std::optional<int> run;
  bool on_virtual = false, accept_expired = false, json = false;
};

/// Where the captures of the plan come from.
struct Source {
  std::unique_ptr<VirtualVerification> instrument;  // absent: folders of `captures`
  fs::path captures, scanner_file;
  std::string identification;
  std::vector<metrology::Gauge> gauges;
  std::optional<metrology::Baseline> baseline;  // of a plan that diagnoses
  int run = 1;                                  // of the virtual scanner: which verification this is
};

Source open_source(const Options& o) {
  Source s;
  if (o.on_virtual) {
    s.instrument = std::make_unique<VirtualVerification>(o.commissioning);
    s.scanner_file = o.scanner.empty() ? s.instrument->scanner_file() : fs::path(o.scanner);
    s.identification = s.instrument->identification();
    s.gauges = o.artefacts.empty() ? s.instrument->gauges() : metrology::read_gauges(o.artefacts);
  } else {
    if (!o.fault.empty()) throw InputError("--fault is for the virtual scanner; add --virtual");
    if (o.run) throw InputError("--run is for the virtual scanner; add --virtual");
    if (o.captures.empty() || o.scanner.empty() || o.artefacts.empty()) {
      throw InputError("verify: give --captures, --scanner and --artefacts of a real scanner, or --virtual");
    }
    s.captures = o.captures;
    s.scanner_file = o.scanner;
    s.gauges = metrology::read_gauges(o.artefacts);
  }
  if (!o.identification.empty()) s.identification = o.identification;
  if (s.identification.empty()) s.identification = "not stated";
  return s;
}

void refuse_expired(const metrology::Plan& plan, const Source& source, const std::string& today, bool accepted) {
  for (const auto& series : plan.series) {
    for (const auto& name : series.artefacts) {
      const auto& gauge = metrology::gauge_named(source.gauges, name);
      if (!metrology::is_expired(gauge, today) || accepted) continue;
      throw InputError(
          fmt::format("the certificate {} of {} ran out on {}; have it recalibrated, or give "
                      "--accept-expired (which the report then states)",
                      gauge.certificate, name, gauge.valid_until));
    }
  }
}

/// "turned_bar 3.1", as the virtual scanner names the scene of a view; "probing 3" where a capture is one view.
std::string scene_of(const metrology::Series& series, int i, int view) {
  const int position = series.position_of(i);
  return series.views ? fmt::format("{} {}.{}", series.scene, position, view)
                      : fmt::format("{} {}", series.scene, position);
}

Capture capture_of(const metrology::Plan& plan, const metrology::Series& series, int i, int view,
                   const Source& source) {
  return source.instrument ? source.instrument->capture(plan.name, scene_of(series, i, view), source.run,
                                                        i % series.captures_per_position)
                           : read_capture(source.captures / metrology::view_name(series, i, view));
}

/// The folders of one capture that are not there.
std::vector<std::string> missing_of(const metrology::Series& series, int i, const Source& source) {
  std::vector<std::string> out;
  if (source.instrument) return out;
  for (int view = 0; view < series.views_of_a_capture(); ++view) {
    const std::string name = metrology::view_name(series, i, view);
    if (!fs::exists(source.captures / name / "capture.json")) out.push_back(name);
  }
  return out;
}

std::string cloud_name(const std::string& capture, std::size_t feature) {
  return fmt::format("clouds/{}-{}.ply", capture, feature + 1);
}

/// Each feature's residual cloud as a file, before the result that rests on it is.
void write_residuals(const fs::path& folder, const std::string& capture, metrology::CaptureResult& result) {
  for (std::size_t k = 0; k < result.features.size(); ++k) {
    write_atomically(folder / cloud_name(capture, k), metrology::to_ply(result.features[k].residuals));
    result.features[k].residuals = {};
  }
}

/// Where the features of a capture stood, with their clouds where these are there.
void append_features(metrology::Verification& v, const fs::path& folder, const std::string& capture,
                     const metrology::CaptureResult& result) {
  for (std::size_t k = 0; k < result.features.size(); ++k) {
    const auto& f = result.features[k];
    metrology::MeasuredFeature feature{.capture = capture, .artefact = f.artefact, .part = f.part};
    feature.place_mm = f.place_mm;
    if (const std::string cloud = cloud_name(capture, k); fs::exists(folder / cloud)) {
      const std::string bytes = read_bytes(folder / cloud);
      metrology::set_box(feature, metrology::residual_cloud_from(bytes, (folder / cloud).string()));
      feature.cloud = cloud;
      feature.cloud_sha256 = sha256_hex(bytes);
    }
    v.features.push_back(std::move(feature));
  }
}

/// The result of one capture: kept from an earlier call, or made now. Empty: the capture is not there.
std::optional<metrology::CaptureResult> result_of(const metrology::Plan& plan, const metrology::Series& series, int i,
                                                  const Source& source, const model::Scanner& scanner,
                                                  const fs::path& folder) {
  const std::string name = metrology::capture_name(series, i);
  const fs::path file = folder / "captures" / (name + ".json");
  if (fs::exists(file)) return metrology::capture_result_from(read_json(file), file.string());
  if (!missing_of(series, i, source).empty()) return std::nullopt;
  std::vector<metrology::PointCloud> clouds;
  std::optional<double> room;
  for (int view = 0; view < series.views_of_a_capture(); ++view) {
    const Capture capture = capture_of(plan, series, i, view, source);
    clouds.push_back(cloud_of(capture, scanner));
    room = room_of(capture);
  }
  auto result = series.views ? metrology::evaluate_views(plan, series, i, source.gauges, clouds, scanner)
                             : metrology::evaluate_capture(plan, series, i, source.gauges, clouds.front(), scanner);
  if (!result) throw InputError(fmt::format("{}: {}", name, result.error().sentence));
  if (plan.diagnose) {
    const metrology::Observation observation{clouds.front(), scanner, gauges_in(series, source.gauges), room};
    const auto symptoms = metrology::symptoms_of(observation, source.baseline);
    if (!symptoms) throw InputError(fmt::format("{}: {}", name, symptoms.error().sentence));
    write_atomically(folder / kDiagnosis, to_json(metrology::to_value(metrology::diagnose(*symptoms))));
    if (!source.baseline) {
      auto baseline = metrology::baseline_of(observation);
      if (baseline) {
        baseline->date = utc_now();
        baseline->scanner_file_sha256 = sha256_of_file(source.scanner_file);
        write_atomically(folder / "baseline.json", to_json(metrology::to_value(*baseline)));
      }
    }
  }
  write_residuals(folder, name, *result);
  write_atomically(file, to_json(metrology::to_value(*result)));
  return *result;
}

std::string plus_minus(const metrology::Quantity& q) {
  const auto rounded = reports::rounded(q.value, q.uncertainty.U);
  return fmt::format("{} ± {}", reports::with_sign(rounded.value), rounded.u);
}

std::string limits_of(const metrology::Quantity& q) {
  if (!q.limits) return "-";
  if (q.limits->lower && q.limits->upper) return fmt::format("{:+g} .. {:+g}", *q.limits->lower, *q.limits->upper);
  return q.limits->upper ? fmt::format("<= {:g}", *q.limits->upper) : fmt::format(">= {:g}", *q.limits->lower);
}

void print_table(const metrology::Verification& v) {
  fmt::print("{}: {}\n\n", v.plan, v.scanner);
  fmt::print("{:<16}{:<10}{:<22}{:>24}  {:<18}{}\n", "quantity", "artefact", "position", "value ± U / mm",
             "limits / mm", "verdict");
  for (const auto& q : v.quantities) {
    fmt::print("{:<16}{:<10}{:<22}{:>24}  {:<18}{}\n", q.symbol, q.artefact, q.position, plus_minus(q), limits_of(q),
               q.judgement ? name_of(q.judgement->verdict) : "-");
  }
  for (const auto& s : v.summaries) {
    fmt::print(
        "{} of {}: mean {:+.4f} mm, repeatability {:.4f} mm{}\n", s.symbol, s.artefact, s.mean_mm, s.repeatability_mm,
        s.repeats ? fmt::format(" ({} repeats)", s.captures)
                  : fmt::format(", reproducibility over {} readings {:.4f} mm", s.captures, s.reproducibility_mm));
  }
  if (const auto verdict = metrology::verdict_of(v)) {
    fmt::print("\nVerdict: {}. {}\n", name_of(*verdict), metrology::sentence_of(v.decision_rule));
  }
}

/// What the light and the room were when the scanner was in order.
void take_baseline(const Options& o, const metrology::Plan& plan, const model::Scanner& scanner, Source& source) {
  if (!plan.diagnose) return;
  const fs::path beside = fs::path(o.commissioning) / "baseline.json";
  if (!o.baseline.empty()) {
    source.baseline = metrology::read_baseline(o.baseline);
  } else if (source.instrument && fs::exists(beside)) {
    source.baseline = metrology::read_baseline(beside);
  } else if (source.instrument) {
    source.baseline = virtual_baseline(*source.instrument, plan, scanner);
    write_atomically(beside, to_json(metrology::to_value(*source.baseline)));
  }
}

/// Which verification of the virtual scanner the folder holds: kept there, so that a call that continues measures on.
int run_of(const Options& o, const metrology::Plan& plan, const Source& source) {
  const fs::path file = fs::path(o.output) / "run.json";
  if (fs::exists(file)) {
    Fields fields(read_json(file), file.string());
    fields.expect_schema("fringecal.virtual-run", 1);
    const int run = fields.integer("run");
    fields.finish();
    if (o.run && *o.run != run) {
      throw InputError(
          fmt::format("{}: the folder holds run {}; give another one for run {}", file.string(), run, *o.run));
    }
    return run;
  }
  const int run = o.run                                         ? *o.run
                  : fs::exists(fs::path(o.output) / "captures") ? 1
                                                                : source.instrument->take_run(plan.name);
  write_atomically(
      file, to_json(Value::object().set("schema", "fringecal.virtual-run").set("schema_version", 1).set("run", run)));
  return run;
}

/// How well the views of each capture fitted together: the worst of a series.
void print_joined(const metrology::Series& series, const std::vector<metrology::CaptureResult>& results) {
  const metrology::CaptureResult* worst = nullptr;
  for (const auto& r : results) {
    if (r.joined && (worst == nullptr || r.joined->rms_mm > worst->joined->rms_mm)) worst = &r;
  }
  if (worst == nullptr) return;
  fmt::print("{}: {} views a capture, joined by {} reference spheres that agree within {:.4f} mm rms or better ({})\n",
             series.scene, worst->joined->views, worst->joined->references, worst->joined->rms_mm,
             metrology::capture_name(series, worst->capture));
}

void print_diagnosis(const metrology::Diagnosis& d) {
  fmt::print("\n{}\n", d.sentence);
  fmt::print("  {:<34}{:>12}\n", "healthy", fmt::format("{:.3g}", d.probability_healthy));
  for (const auto& c : d.causes) {
    if (c.probability < 1e-3) continue;
    fmt::print("  {:<34}{:>12}", c.name, fmt::format("{:.3g}", c.probability));
    for (const auto& a : c.amplitudes) fmt::print("  {} {:+.3g} ± {:.2g} {}", a.name, a.value, 2 * a.u, a.unit);
    fmt::print("\n");
  }
  for (const auto& remark : d.remarks) fmt::print("  remark: {}\n", remark);
}

void verify(const Options& o) {
  metrology::Plan plan = metrology::read_plan(o.plan);
  if (!o.rule.empty()) plan.decision_rule = metrology::decision_rule_from(o.rule);
  Source source = open_source(o);
  metrology::Verification v{.plan = plan.name,
                            .plan_source = plan.source,
                            .plan_unchecked = plan.unchecked,
                            .scanner = source.identification,
                            .scanner_file_sha256 = sha256_of_file(source.scanner_file),
                            .begun = utc_now(),
                            .environment = {o.temperature_degC, o.u_temperature_degC, {}},
                            .decision_rule = plan.decision_rule,
                            .provenance = provenance_now()};
  refuse_expired(plan, source, v.begun, o.accept_expired);
  const auto scanner = model::read_scanner(source.scanner_file);
  const fs::path folder = o.output;
  if (source.instrument) source.run = run_of(o, plan, source);
  if (!o.json && fs::exists(folder / "verification.json")) {
    fmt::print("{}: finished before; its captures are evaluated again, nothing is measured\n", folder.string());
  }
  take_baseline(o, plan, scanner, source);
  if (!o.fault.empty()) {
    const Injection injection = injection_of(o.fault);
    source.instrument->befall(injection.faults, injection.room_degC);
    alter_certificate(injection, source.gauges);
  }
  // First: whoever watches draws the artefacts from it.
  if (source.instrument) write_atomically(folder / "artefacts.toml", metrology::to_toml(source.gauges));
  int views = 0;
  for (const auto& series : plan.series) views += series.captures * series.views_of_a_capture();
  Progress progress(views);
  std::vector<std::string> missing;
  std::vector<std::vector<metrology::CaptureResult>> results(plan.series.size());
  for (std::size_t s = 0; s < plan.series.size(); ++s) {
    const auto& series = plan.series[s];
    for (int i = 0; i < series.captures; ++i) {
      progress.start(fmt::format("verifying, {} {} of {}", series.scene, i + 1, series.captures));
      const auto result = result_of(plan, series, i, source, scanner, folder);
      if (result) results[s].push_back(*result);
      if (!result) {
        for (auto& name : missing_of(series, i, source)) missing.push_back(std::move(name));
      }
      progress.done(series.views_of_a_capture());
    }
    progress.finish_step(
        fmt::format("{}: {} of {} captures evaluated", series.scene, results[s].size(), series.captures));
  }
  if (!missing.empty()) {
    throw InputError(fmt::format(
        "{}: the plan {} asks for {}, of which {} missing: {}; what was evaluated is kept in {}, run the same "
        "command again when the rest is there",
        source.captures.string(), plan.name, views == 1 ? "1 capture" : fmt::format("{} captures", views),
        missing.size() == 1 ? "1 is" : fmt::format("{} are", missing.size()), fmt::join(missing, ", "),
        folder.string()));
  }
  std::vector<std::string> listed;
  for (std::size_t s = 0; s < plan.series.size(); ++s) {
    for (auto& q :
         metrology::evaluate_series(plan, plan.series[s], source.gauges, results[s], {.environment = v.environment})) {
      v.quantities.push_back(std::move(q));
    }
    for (auto& summary : metrology::summaries_of(plan.series[s], source.gauges, results[s], v.environment)) {
      v.summaries.push_back(std::move(summary));
    }
    for (const auto& name : plan.series[s].artefacts) {
      if (std::find(listed.begin(), listed.end(), name) != listed.end()) continue;
      listed.push_back(name);
      const auto& gauge = metrology::gauge_named(source.gauges, name);
      const bool expired = metrology::is_expired(gauge, v.begun);
      v.artefacts.push_back(metrology::used(gauge, expired));
      if (expired) {
        v.deviations.push_back(
            fmt::format("The certificate {} of {} had run out on {}; its use was accepted by the "
                        "operator.",
                        gauge.certificate, name, gauge.valid_until));
      }
    }
  }
  for (std::size_t s = 0; s < plan.series.size(); ++s) {
    for (const auto& result : results[s]) {
      append_features(v, folder, metrology::capture_name(plan.series[s], result.capture), result);
    }
  }
  v.ended = utc_now();
  if (plan.diagnose) {
    const bool violated = metrology::verdict_of(v) == metrology::Verdict::fail;
    v.diagnosis = metrology::with_limits(
        metrology::diagnosis_from(Fields(read_json(folder / kDiagnosis), (folder / kDiagnosis).string())), violated);
  }
  v.provenance.inputs.emplace_back("scanner", v.scanner_file_sha256);
  const Value record = metrology::to_value(v);
  write_atomically(folder / "verification.json", to_json(record));
  if (!o.history.empty()) {
    const auto entry = history_to_append(o.history).append("verification", record, v.ended);
    if (!o.json) fmt::print("history: entry {} of {}, hash {}\n\n", entry.number, o.history, entry.hash);
  }
  if (o.json) {
    fmt::print("{}", to_json(record));
  } else {
    print_table(v);
    for (std::size_t k = 0; k < plan.series.size(); ++k) print_joined(plan.series[k], results[k]);
    if (v.diagnosis) print_diagnosis(*v.diagnosis);
  }
}

}  // namespace

void add_verify(CLI::App& app) {
  auto o = std::make_shared<Options>();
  auto* command = app.add_subcommand("verify", "Carry out a verification plan: find the artefacts, evaluate, judge");
  command->add_option("--plan", o->plan, "paper, vdi2634-2, vdi2634-3, iso10360-13, plate-step, quick, or a plan file")
      ->capture_default_str();
  command->add_flag("--virtual", o->on_virtual, "Verify the virtual scanner of a finished commissioning");
  command->add_option("--commissioning", o->commissioning, "Its folder (with --virtual)")->capture_default_str();
  command->add_option("--captures", o->captures,
                      "Folder with the captures SERIES-00, SERIES-01, ... that the plan asks for");
  command->add_option("--scanner", o->scanner, "Scanner file (default with --virtual: of the commissioning)");
  command->add_option("--artefacts", o->artefacts, "artefacts.toml (default with --virtual: the virtual certificates)");
  command->add_option("-o,--output", o->output, "Folder of the verification; a second call continues in it")
      ->capture_default_str();
  command->add_option("--history", o->history, "History to append the record to (made if it is not there)");
  command->add_option("--identification", o->identification, "The scanner, as the record shall name it");
  command->add_option("--temperature", o->temperature_degC, "Of the artefacts, degC")->capture_default_str();
  command->add_option("--u-temperature", o->u_temperature_degC, "Its standard uncertainty, K")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--rule", o->rule,
                      "Decision rule instead of the plan's: iso_14253_1, simple, guarded, four_outcomes");
  command->add_option(
      "--baseline", o->baseline,
      "Plans that diagnose: baseline.json of a day when the scanner was in order (a check without one leaves "
      "it in its folder; with --virtual: of the commissioning)");
  command->add_option("--fault", o->fault,
                      "Virtual scanner: what befell it since; base_line, knocked_camera, dirty_projector, warm_room, "
                      "wrong_certificate");
  command
      ->add_option("--run", o->run,
                   "Virtual scanner: which verification of it this is; another number is another draw of noise and of "
                   "the hand that places the artefacts (default: the next one of its commissioning)")
      ->check(CLI::Range(1, 999999));
  command->add_flag("--accept-expired", o->accept_expired,
                    "Use an artefact whose certificate has run out; stated in the record");
  command->add_flag("--json", o->json, "Print verification.json instead of the table");
  command->footer("Example: fringecal verify --virtual --plan quick --output morning --history history.db");
  command->callback([o] { verify(*o); });
}

}  // namespace fringecal::cli

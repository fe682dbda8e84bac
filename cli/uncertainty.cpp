#include "cli/uncertainty.h"
#include "calib/halves.h"
#include "calib/next_pose.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "reports/uncertainty_page.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string scanner, page;
  metrology::MapOptions how;
  bool halves = false, next_pose = false, json = false;
};

template <class T>
T needed(Result<T> found, const std::string& file) {
  if (!found) throw InputError(fmt::format("{}: {}", file, found.error().sentence));
  return std::move(*found);
}

void print(const reports::UncertaintyPage& p) {
  const auto& m = p.map;
  fmt::print("calibration alone: {:.4f} mm rms over the volume, {:.4f} mm at most, at ({:.0f}, {:.0f}, {:.0f}) mm\n",
             m.rms_mm, m.worst_mm, m.worst_at_mm.x(), m.worst_at_mm.y(), m.worst_at_mm.z());
  for (const auto& c : m.combinations) {
    std::string words;
    for (const auto& s : c.shares) words += fmt::format(" {} {:+.2f}", s.parameter, s.in_u);
    fmt::print("  {:.4f} mm rms, {:.4f} mm at most:{}\n", c.rms_mm, c.worst_mm, words);
  }
  for (const auto& words : metrology::open_words(m)) fmt::print("  {}\n", words);
  for (const auto& w : p.whiteness) fmt::print("  {}\n", metrology::words_of(w));
  if (p.halves) fmt::print("  halves of the poses: {}\n", metrology::verdict_of(*p.halves));
  if (!p.without_halves.empty()) fmt::print("  halves of the poses cannot be compared: {}\n", p.without_halves);
  for (const auto& prior : p.priors) {
    fmt::print("  prior: {} = {} +- {:.3g}: {}\n", prior.parameter, prior.value, prior.u, prior.reason);
  }
}

reports::UncertaintyPage judged(const model::Scanner& s, const Options& o) {
  metrology::MapOptions how = o.how;
  if (o.page.empty()) how.section_steps = 0;
  reports::UncertaintyPage p{s.name, needed(metrology::uncertainty_map(s, how), o.scanner), {}, {}, s.priors};
  if (s.board) p.whiteness = needed(metrology::residual_whiteness(s), o.scanner);
  if (o.halves) {
    const auto halves = calib::solve_halves(s);
    if (halves) {
      p.halves = needed(metrology::compare_scanners(halves->first, halves->second, o.how.grid), o.scanner);
    } else {
      p.without_halves = halves.error().sentence;
    }
  }
  return p;
}

void run(const Options& o) {
  const model::Scanner s = model::read_scanner(o.scanner);
  const auto p = judged(s, o);
  if (!o.page.empty()) write_atomically(o.page, reports::uncertainty_page(p));
  if (!o.json) {
    print(p);
    if (!o.next_pose) return;
    const auto by = needed(metrology::derivatives(s, metrology::samples_of(s, o.how.grid)), o.scanner);
    const auto next = needed(calib::propose_next_pose(s, by, metrology::heights_of(s, o.how.grid)), o.scanner);
    for (const auto& pose : next.best) fmt::print("  next: {}\n", calib::words_of(pose, next.worst_now_mm));
    return;
  }
  Value out = metrology::to_value(p.map), whiteness = Value::array();
  for (const auto& w : p.whiteness) {
    whiteness.append(Value::object().set("over", w.over).set("q", w.q).set("limit", w.limit).set("white", w.white()));
  }
  out.set("whiteness", whiteness);
  if (p.halves) {
    out.set("halves", Value::object()
                          .set("verdict", metrology::verdict_of(*p.halves))
                          .set("rms_mm", p.halves->rms_mm)
                          .set("allowed_rms_mm", p.halves->allowed_rms_mm)
                          .set("ratio", p.halves->ratio)
                          .set("limit", p.halves->limit));
  }
  fmt::print("{}", to_json(out));
}

}  // namespace

void write_uncertainty_page(const model::Scanner& scanner, const std::string& page) {
  Options o;
  o.scanner = scanner.name;
  o.page = page;
  o.halves = scanner.observations.size() >= 6;
  write_atomically(page, reports::uncertainty_page(judged(scanner, o)));
}

void add_uncertainty(CLI::App& app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "uncertainty",
      "What a calibration is uncertain by in the volume, why, what it leaves open, and whether it holds");
  command->add_option("scanner", o->scanner, "Scanner file")->required();
  command->add_option("-o,--output", o->page, "HTML page to write: sections of the volume as pictures, and a table");
  command->add_flag("--halves", o->halves,
                    "Cross-validation: calibrate again on each half of the poses and compare over the volume");
  command->add_flag("--next-pose", o->next_pose,
                    "Propose where to hold the board next: the poses that lower the worst uncertainty most");
  command
      ->add_option("--u-phase-rad", o->how.u_phase_rad,
                   "Standard uncertainty of a pixel's phase, for the part of the noise")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--z-min", o->how.grid.z_min_mm, "Lowest height, mm (default: the calibration's volume)");
  command->add_option("--z-max", o->how.grid.z_max_mm, "Highest height, mm");
  command->add_flag("--json", o->json, "Print as JSON, with a table of points");
  command->footer("Example: fringecal uncertainty scanner.json --halves --next-pose -o uncertainty.html");
  command->callback([o] { run(*o); });
}

}  // namespace fringecal::cli

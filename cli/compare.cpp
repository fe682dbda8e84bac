#include "cli/commands.h"
#include "core/error.h"
#include "metrology/compare_scanners.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string a, b;
  metrology::CompareOptions how;
  bool points = false, json = false;
};

void print(const metrology::ComparedPoint& p) {
  fmt::print("  {:8.1f} {:8.1f} {:8.1f}   {:+8.4f} {:+8.4f} {:+8.4f}   {:7.4f} {:7.4f} {:7.4f}\n", p.point_mm.x(),
             p.point_mm.y(), p.point_mm.z(), p.difference_mm.x(), p.difference_mm.y(), p.difference_mm.z(), p.u_mm.x(),
             p.u_mm.y(), p.u_mm.z());
}

void run(const Options& options) {
  const auto compared =
      metrology::compare_scanners(model::read_scanner(options.a), model::read_scanner(options.b), options.how);
  if (!compared) throw InputError(fmt::format("{}, {}: {}", options.a, options.b, compared.error().sentence));
  if (options.json) {
    fmt::print("{}", to_json(metrology::to_value(*compared)));
    return;
  }
  fmt::print("{}\n", metrology::verdict_of(*compared));
  if (options.points) {
    fmt::print("  {:>8} {:>8} {:>8}   {:>8} {:>8} {:>8}   {:>7} {:>7} {:>7}\n", "X mm", "Y mm", "Z mm", "dX mm",
               "dY mm", "dZ mm", "u mm", "u mm", "u mm");
    for (const auto& p : compared->points) print(p);
    return;
  }
  fmt::print("  {:>8} {:>8} {:>8}   {}\n", "Z mm", "rms mm", "allowed",
             "largest difference: at X, Y mm; dX, dY, dZ mm; u mm");
  for (const auto& h : metrology::by_height(*compared)) {
    const auto& [at, d, u] = h.worst;
    fmt::print("  {:8.1f} {:8.4f} {:8.4f}   {:7.1f} {:7.1f}; {:+.4f} {:+.4f} {:+.4f}; {:.4f} {:.4f} {:.4f}\n", h.z_mm,
               h.rms_mm, h.allowed_rms_mm, at.x(), at.y(), d.x(), d.y(), d.z(), u.x(), u.y(), u.z());
  }
  fmt::print("--points prints all {} points\n", compared->points.size());
}

}  // namespace

void add_compare(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand(
      "compare", "What two calibrations of one scanner disagree about, beside what their uncertainties allow");
  command->add_option("a", options->a, "Scanner file; its world is the frame of the result")->required();
  command->add_option("b", options->b, "Scanner file of the other calibration")->required();
  command->add_option("--z-min", options->how.z_min_mm,
                      "Lowest height compared, mm (default: the calibration's volume)");
  command->add_option("--z-max", options->how.z_max_mm, "Highest height compared, mm");
  command->add_flag("--points", options->points, "Print every point compared, not one line per height");
  command->add_flag("--json", options->json, "Print the comparison as JSON");
  command->footer("Example: fringecal compare 2026-01.json 2026-07.json");
  command->callback([options] { run(*options); });
}

}  // namespace fringecal::cli

#include "calib/decode/corrections.h"
#include "cli/commands.h"
#include "core/capture.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/reconstruct.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <map>
#include <memory>

namespace fringecal::cli {
namespace {

struct Options {
  std::string capture, scanner, output, model = "full";
  metrology::ReconstructOptions reconstruct;
  bool json = false, no_linearisation = false, no_stack_correction = false;
};

const std::map<std::string, metrology::ReconstructionModel> kModels = {
    {"full", metrology::ReconstructionModel::full},
    {"chen2008", metrology::ReconstructionModel::chen2008},
    {"ideal", metrology::ReconstructionModel::ideal}};

Value to_value(const decode::MeasuringMap& map) {
  Value out = Value::object().set("linearised", map.linearised).set("stack_corrected", map.stack.has_value());
  if (map.stack) {
    const auto& e = map.stack->ellipse;
    out.set("one_cycle_mrad", 1e3 * std::abs(e.offset))
        .set("u_one_cycle_mrad", 1e3 * e.u_offset)
        .set("two_cycles_mrad", 1e3 * std::abs(e.conjugate))
        .set("u_two_cycles_mrad", 1e3 * e.u_conjugate);
  }
  Value remarks = Value::array();
  for (const auto& remark : map.remarks) remarks.append(remark);
  return out.set("remarks", remarks);
}

Value summary_of(const Options& o, const metrology::Reconstruction& result, const metrology::CloudSummary& summary,
                 const decode::MeasuringMap& map) {
  const auto pixels = decode::count_validity(map.map);
  Value invalid = Value::object();
  for (std::size_t i = 1; i < pixels.size(); ++i) {
    invalid.set(decode::name_of(static_cast<decode::Validity>(i)), pixels[i]);
  }
  return Value::object()
      .set("capture", o.capture)
      .set("scanner", o.scanner)
      .set("model", o.model)
      .set("cloud", o.output)
      .set("points", result.cloud.points.size())
      .set("corrections", to_value(map))
      .set("left_out", Value::object()
                           .set("invalid", invalid)
                           .set("edge", result.n_edge)
                           .set("no intersection", result.n_no_intersection)
                           .set("low modulation, beyond the decoding", result.n_low_modulation)
                           .set("isolated", result.n_isolated)
                           .set("grazing", result.n_grazing)
                           .set("noisy", result.n_noisy))
      .set("min_mm", Value::numbers(summary.min_mm))
      .set("max_mm", Value::numbers(summary.max_mm))
      .set("median_u_along_ray_mm", summary.median_u_along_ray_mm);
}

void measure(Options& o) {
  o.reconstruct.model = kModels.at(o.model);
  const model::Scanner scanner = model::read_scanner(o.scanner);
  const Capture capture = read_capture(o.capture);
  const CodeAxis axis = scanner.projector.main_axis();
  if (!capture.info.plan.code(axis)) {
    throw InputError(fmt::format("{}: no code along {}, the axis that {} was calibrated for", o.capture,
                                 axis == CodeAxis::x ? "x" : "y", o.scanner));
  }
  const auto map =
      decode::decode_for_measuring(capture, axis, scanner.linearisation ? &*scanner.linearisation : nullptr,
                                   {.linearisation = o.no_linearisation ? decode::Correct::no : decode::Correct::yes,
                                    .stack = o.no_stack_correction ? decode::Correct::no : decode::Correct::yes});
  const auto result = metrology::reconstruct(map.map, scanner, o.reconstruct);
  if (result.cloud.points.empty()) {
    throw InputError(
        fmt::format("{}: no pixel gives a point ({} without usable phase, {} at edges, {} with more than {} mm of "
                    "uncertainty along the "
                    "ray): check light and exposure, or allow more with --max-u-mm",
                    o.capture, result.n_invalid, result.n_edge, result.n_noisy, o.reconstruct.max_u_along_ray_mm));
  }
  metrology::write_ply(o.output, result.cloud);
  const auto summary = metrology::summary_of(result.cloud);
  const auto pixels = decode::count_validity(map.map);
  if (o.json) {
    fmt::print("{}", to_json(summary_of(o, result, summary, map)));
    return;
  }
  fmt::print("{} points by the {} model: {}\n", result.cloud.points.size(), o.model, o.output);
  fmt::print("  X {:.1f} .. {:.1f}  Y {:.1f} .. {:.1f}  Z {:.1f} .. {:.1f} mm, median u along the ray {:.4f} mm\n",
             summary.min_mm.x(), summary.max_mm.x(), summary.min_mm.y(), summary.max_mm.y(), summary.min_mm.z(),
             summary.max_mm.z(), summary.median_u_along_ray_mm);
  fmt::print("  {}\n", decode::words_for(map));
  fmt::print("  left out:");
  for (std::size_t i = 1; i < pixels.size(); ++i) {
    fmt::print(" {} {},", decode::name_of(static_cast<decode::Validity>(i)), pixels[i]);
  }
  if (o.reconstruct.min_modulation > 0) {
    fmt::print(" modulation below {:g} {},", o.reconstruct.min_modulation, result.n_low_modulation);
  }
  fmt::print(" edge {}, no intersection {}, isolated {}, grazing {}, noisy {}\n", result.n_edge,
             result.n_no_intersection, result.n_isolated, result.n_grazing, result.n_noisy);
}

}  // namespace

void add_measure(CLI::App& app) {
  auto* command = app.add_subcommand("measure", "From a capture and a Scanner file to a point cloud");
  auto o = std::make_shared<Options>();
  command->add_option("capture", o->capture, "Capture folder")->required();
  command->add_option("--scanner", o->scanner, "Scanner file of the instrument that took the capture")->required();
  command->add_option("-o,--output", o->output, "Point cloud to write (binary PLY, mm, frame world)")->required();
  command
      ->add_option("--model", o->model,
                   "full: rays through both lens models; chen2008: the paper's closed form with distortion; ideal: "
                   "without")
      ->check(CLI::IsMember({"full", "chen2008", "ideal"}))
      ->capture_default_str();
  command
      ->add_option("--max-u-mm", o->reconstruct.max_u_along_ray_mm,
                   "Leave out points with a larger standard uncertainty along the camera's ray, mm")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option(
          "--max-incidence", o->reconstruct.max_incidence_deg,
          "Leave out points that camera or light see at more than this angle from the normal, degrees (default: none)")
      ->check(CLI::Range(10.0, 89.0));
  command
      ->add_option("--min-modulation", o->reconstruct.min_modulation,
                   "Leave out points of less modulation, grey levels of the capture (the decoding leaves out less than "
                   "4 of 255)")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command
      ->add_option("--min-piece", o->reconstruct.min_piece,
                   "Leave out isolated points: connected pieces of fewer points than this")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command
      ->add_option("--edge-margin", o->reconstruct.edge_margin_px,
                   "Leave out pixels this near to a pixel without point or to a jump in depth")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command->add_flag("--no-linearisation", o->no_linearisation,
                    "Leave the Scanner's phase linearisation out, for comparison");
  command->add_flag("--no-stack-correction", o->no_stack_correction,
                    "Leave the errors of this stack's steps and lamp in, for comparison");
  command->add_flag("--json", o->json, "Print the summary as JSON");
  command->footer("Example:\n  fringecal measure captures/part --scanner scanner.json -o part.ply");
  command->callback([o] { measure(*o); });
}

}  // namespace fringecal::cli

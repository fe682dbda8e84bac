#include "calib/decode/decode.h"

#include "calib/decode/picture.h"
#include "cli/commands.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/parallel.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>

namespace fringecal::cli {
namespace fs = std::filesystem;
namespace {

struct Options {
  std::string capture, output;
  std::optional<std::string> axis;
  std::optional<double> min_modulation, sigma;
  bool plain = false, json = false;
};

void write_maps(const fs::path& folder, const decode::PhaseMap& map) {
  const std::vector<std::pair<const char*, std::function<std::string()>>> files = {
      {"phase.tiff", [&] { return encode_tiff(map.phase_rad); }},
      {"u_phase.tiff", [&] { return encode_tiff(map.u_phase_rad); }},
      {"modulation.tiff", [&] { return encode_tiff(map.modulation); }},
      {"phase.png", [&] { return encode_png(picture_of_phase(map)); }},
      {"validity.png", [&] { return encode_png(picture_of_validity(map)); }},
  };
  parallel_for(static_cast<int>(files.size()), [&](int i) {
    const auto& [name, encode] = files[static_cast<std::size_t>(i)];
    write_atomically(folder / name, encode());
  });
}

void print_text(const decode::PhaseMap& map, const decode::DecodeSummary& summary, const Options& options) {
  const auto total = static_cast<double>(map.validity.size());
  fmt::print("{} x {} pixels, code along {}, {} result\n", map.width(), map.height(),
             map.axis == CodeAxis::x ? "x" : "y", options.plain ? "plain" : "redundant");
  for (std::size_t k = 0; k < summary.counts.size(); ++k) {
    fmt::print("  {:<18}{:>10}  {:6.2f} %\n", decode::name_of(static_cast<decode::Validity>(k)), summary.counts[k],
               100.0 * static_cast<double>(summary.counts[k]) / total);
  }
  if (summary.median_u_phase_rad) {
    fmt::print("median u(phi)     {:.4g} rad ({:.3g} {} on the pattern)\n", *summary.median_u_phase_rad,
               *summary.median_u_pattern, map.code.unit);
    fmt::print("median modulation {:.4g} grey levels\n", *summary.median_modulation);
  }
  fmt::print("noise             sigma = {:.3g} grey levels at {:.3g}; {}\n", map.noise.sigma(summary.mean_level),
             summary.mean_level, map.noise.source);
  fmt::print("written: {}\n", options.output);
}

Value json_of(const decode::PhaseMap& map, const decode::DecodeSummary& summary, const Options& options) {
  Value pixels = Value::object();
  for (std::size_t k = 0; k < summary.counts.size(); ++k) {
    std::string key = decode::name_of(static_cast<decode::Validity>(k));
    std::replace(key.begin(), key.end(), ' ', '_');
    pixels.set(key, summary.counts[k]);
  }
  const auto or_null = [](const std::optional<double>& v) { return v ? Value(*v) : Value(); };
  return Value::object()
      .set("output", options.output)
      .set("axis", map.axis == CodeAxis::x ? "x" : "y")
      .set("edges", options.plain ? "plain" : "redundant")
      .set("width_px", map.width())
      .set("height_px", map.height())
      .set("pixels", pixels)
      .set("median_u_phase_rad", or_null(summary.median_u_phase_rad))
      .set("median_u_pattern_" + map.code.unit, or_null(summary.median_u_pattern))
      .set("median_modulation_gray_levels", or_null(summary.median_modulation))
      .set("noise", Value::object()
                        .set("read_variance", map.noise.read_variance)
                        .set("gain", map.noise.gain)
                        .set("source", map.noise.source));
}

void run(const Options& options) {
  const Capture capture = read_capture(options.capture);
  const PatternPlan& plan = capture.info.plan;
  decode::DecodeOptions decode_options;
  decode_options.edges = options.plain ? decode::EdgeRule::plain : decode::EdgeRule::redundant;
  if (options.min_modulation) decode_options.min_modulation_8bit = *options.min_modulation;
  decode_options.sigma_gray_levels = options.sigma;
  if (plan.x && plan.y && !options.axis) {
    throw InputError(fmt::format("{}: this capture codes x and y; say which one with --axis", options.capture));
  }
  const bool along_y = options.axis ? *options.axis == "y" : !plan.x;
  const decode::PhaseMap map = decode::decode_phase(capture, along_y ? CodeAxis::y : CodeAxis::x, decode_options);
  const decode::DecodeSummary summary = decode::summary_of(map);
  write_maps(options.output, map);
  if (options.json) {
    fmt::print("{}", to_json(json_of(map, summary, options)));
  } else {
    print_text(map, summary, options);
  }
}

}  // namespace

void add_decode(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("decode", "Turns a capture into maps of phase, modulation and uncertainty");
  command->add_option("capture", options->capture, "Capture folder (has a capture.json)")->required();
  command->add_option("-o,--output", options->output, "Folder for the maps")->required();
  command->add_option("--axis", options->axis, "Code axis: x or y (default: the one that the capture has)")
      ->check(CLI::IsMember({"x", "y"}));
  command->add_flag("--plain", options->plain,
                    "Fringe number straight from the Gray code, jumps at period edges left in (for alignment)");
  command
      ->add_option("--min-modulation", options->min_modulation,
                   "Least modulation of a pixel, 8-bit grey levels (default 4)")
      ->check(CLI::NonNegativeNumber);
  command
      ->add_option("--sigma", options->sigma, "Noise, grey levels of the capture (default: estimated from the frames)")
      ->check(CLI::PositiveNumber);
  command->add_flag("--json", options->json, "Print the summary as JSON");
  command->footer(
      "Writes phase.tiff (absolute phase, rad), u_phase.tiff (its standard uncertainty, rad), modulation.tiff (grey\n"
      "levels), all 32-bit float with NaN where there is no phase, and two pictures to look at: phase.png and "
      "validity.png\n"
      "(white valid, blue-black shadow, red saturated, orange low modulation, magenta inconsistent code).\n"
      "Example: fringecal decode captures/board_1 -o maps/board_1");
  command->callback([options] { run(*options); });
}

}  // namespace fringecal::cli

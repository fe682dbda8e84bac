#include "cli/commands.h"
#include "core/capture.h"
#include "core/file.h"
#include "core/import_plan.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <filesystem>
#include <memory>

namespace fringecal::cli {
namespace fs = std::filesystem;
namespace {

struct Options {
  std::string folder, plan, output;
  bool json = false;
};

void run(const Options& options) {
  if (fs::weakly_canonical(options.folder) == fs::weakly_canonical(options.output)) {
    throw InputError(fmt::format("{}: the capture cannot replace the folder it is made from; name another one with -o",
                                 options.output));
  }
  Capture capture = import_capture(options.folder, options.plan);
  write_capture(options.output, capture);
  const CaptureInfo& info = capture.info;
  if (options.json) {
    fmt::print("{}", to_json(Value::object()
                                 .set("capture", options.output)
                                 .set("frames", info.frames.size())
                                 .set("width_px", info.width_px)
                                 .set("height_px", info.height_px)
                                 .set("bits", info.bits)));
  } else {
    fmt::print("{}: {} frames of {} x {} pixels, {} bits\n", options.output, info.frames.size(), info.width_px,
               info.height_px, info.bits);
  }
}

}  // namespace

void add_import(CLI::App& app) {
  auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("import", "Makes a capture from a folder of images of any scanner");
  command->add_option("folder", options->folder, "Folder with the images (PNG, TIFF, BMP or PGM; grey, 8 to 16 bit)")
      ->required();
  command->add_option("--plan", options->plan, "TOML file that says which image shows which pattern")->required();
  command->add_option("-o,--output", options->output, "Capture folder to write")->required();
  command->add_flag("--json", options->json, "Print the summary as JSON");
  command->footer(
      "The plan names the code and the order of the images, for example\n"
      "  [codes.x]\n"
      "  gray_bits = 7\n"
      "  phase_steps = 4\n"
      "  stripes_per_period = 2   # 1 where every Gray stripe has its own period\n"
      "  period = 0.24\n"
      "  unit = \"mm\"              # on the grating; \"px\" on a display\n"
      "  [[sequence]]\n"
      "  files = \"frame_{:02}.png\"\n"
      "  patterns = [\"gray 0..6\", \"phase 0..3\"]\n"
      "Example: fringecal import photos/board_1 --plan plan.toml -o captures/board_1");
  command->callback([options] { run(*options); });
}

}  // namespace fringecal::cli

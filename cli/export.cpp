#include "calib/lens_files.h"
#include "calib/model/scanner.h"
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <filesystem>
#include <map>
#include <memory>

namespace fringecal::cli {
namespace {

struct ExportOptions {
  std::string scanner;
  std::filesystem::path output;
  calib::LensFormat format = calib::LensFormat::mrcal;
};

void run(const ExportOptions& o) {
  const model::Scanner s = model::read_scanner(o.scanner);
  const std::string from = fmt::format("fringecal export, Scanner '{}'; reference frame: cam\n", s.name);
  const auto write = [&](const char* name, const calib::PlacedCamera& placed, const std::string& comment) {
    const auto file = o.output / (std::string(name) + calib::ending_of(o.format));
    write_atomically(file, calib::lens_file(placed, o.format, comment));
    fmt::print("{}\n", file.string());
  };
  write("camera", {s.camera, {}}, from);
  std::string what = "the projector as a camera: 1 px is a stripe of the finest Gray bit\n";
  if (!s.projector.x || !s.projector.y) {
    what += fmt::format("coded along {} only: focal length and principal point of the other axis are not measured\n",
                        s.projector.x ? "x" : "y");
  }
  write("projector", {calib::camera_of(s.projector), s.proj_from_cam}, from + what);
}

struct ImportOptions {
  std::string scanner, camera, projector, output;
};

void run(const ImportOptions& o) {
  model::Scanner s = model::read_scanner(o.scanner);
  const calib::PlacedCamera camera = calib::read_lens_file(o.camera);
  if (camera.camera.width_px != s.camera.width_px || camera.camera.height_px != s.camera.height_px) {
    throw InputError(fmt::format("{}: a camera of {} x {} px, but {} has one of {} x {}", o.camera,
                                 camera.camera.width_px, camera.camera.height_px, o.scanner, s.camera.width_px,
                                 s.camera.height_px));
  }
  const auto pixel_mm = s.camera.pixel_mm;
  s.camera = camera.camera;
  s.camera.pixel_mm = pixel_mm;
  s.provenance = provenance_now();
  s.provenance.inputs = {{"scanner", sha256_of_file(o.scanner)}, {"camera", sha256_of_file(o.camera)}};
  if (!o.projector.empty()) {
    const calib::PlacedCamera projector = calib::read_lens_file(o.projector);
    s.projector = calib::projector_of(projector.camera, s.projector);
    s.proj_from_cam = projector.cam_from_reference * camera.cam_from_reference.inverse();
    s.provenance.inputs.emplace_back("projector", sha256_of_file(o.projector));
  }
  // What described the other lenses is not true of these.
  s.uncertainty = {};
  s.uncertainty.covariance.resize(0, 0);
  s.priors.clear();
  s.paper_model.reset();
  s.paper_ideal_model.reset();
  s.board.reset();
  s.board_corners_mm.clear();
  s.observations.clear();
  s.cam_from_board.clear();
  s.flats.clear();
  s.cam_from_flat.clear();
  s.residuals = {.projector_unit = s.residuals.projector_unit};
  s.method =
      fmt::format("lenses from {}{}{}; no covariance", o.camera, o.projector.empty() ? "" : " and ", o.projector);
  s.name = std::filesystem::path(o.output).stem().string();
  model::write_scanner(o.output, s);
  fmt::print("{}: {}\n", o.output, s.method);
}

}  // namespace

void add_export(CLI::App& app) {
  static const std::map<std::string, calib::LensFormat> kFormats = {{"mrcal", calib::LensFormat::mrcal},
                                                                    {"opencv", calib::LensFormat::opencv}};
  auto o = std::make_shared<ExportOptions>();
  CLI::App* command =
      app.add_subcommand("export", "Writes a scanner's camera and projector in another program's files");
  command->add_option("scanner", o->scanner, "Scanner file")->required();
  command
      ->add_option("--to", o->format,
                   "mrcal: camera.cameramodel and projector.cameramodel; opencv: camera.yml and projector.yml, the "
                   "projector's with R and T from the camera in mm")
      ->transform(CLI::CheckedTransformer(kFormats).description(""))
      ->required();
  command->add_option("-o,--output", o->output, "Folder to write into")->required();
  command->footer("Example: fringecal export scanner.json --to mrcal -o models");
  command->callback([o] { run(*o); });
}

void add_import_lenses(CLI::App& app) {
  auto o = std::make_shared<ImportOptions>();
  CLI::App* command = app.add_subcommand(
      "import-lenses", "A Scanner file with the camera (and projector) of mrcal's .cameramodel or OpenCV's YAML files");
  command->add_option("scanner", o->scanner, "Scanner file that has the codes, sizes and distance")->required();
  command->add_option("--camera", o->camera, "Camera: .cameramodel or YAML")->required();
  command->add_option("--projector", o->projector, "Projector, placed from the same reference (as `export` writes it)");
  command->add_option("-o,--output", o->output, "Scanner file to write; it has no covariance")->required();
  command->footer("Example: fringecal import-lenses scanner.json --camera models/camera.cameramodel -o other.json");
  command->callback([o] { run(*o); });
}

}  // namespace fringecal::cli

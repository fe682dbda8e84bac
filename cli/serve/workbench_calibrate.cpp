// What the calibration page shows, while poses are still to come and afterwards.
#include "calib/next_pose.h"
#include "cli/live_line.h"
#include "cli/serve/workbench.h"
#include "core/capture.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "metrology/residual_whiteness.h"
#include "metrology/uncertainty_map.h"

#include <fmt/format.h>

#include <algorithm>

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

constexpr int kPictureWidth = 696, kSectionSteps = 25;

void copy(const Value& from, Value& to, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    if (const Value* value = from.find(key)) to.set(key, *value);
  }
}

std::string pose_name(int pose) { return fmt::format("pose-{:02}", pose); }

Value to_value(const std::vector<metrology::CornerResidual>& residuals) {
  Value x = Value::array(), y = Value::array(), dx = Value::array(), dy = Value::array();
  for (const auto& r : residuals) {
    x.append(r.pixel_px.x());
    y.append(r.pixel_px.y());
    dx.append(r.residual_px.x());
    dy.append(r.residual_px.y());
  }
  return Value::object().set("pixel_x_px", x).set("pixel_y_px", y).set("residual_x_px", dx).set("residual_y_px", dy);
}

/// The part of the calibration, without the noise of a pixel's phase.
Value to_value(const metrology::Section& s) {
  Value values = Value::array();
  for (const auto& v : s.values) values.append(v ? Value(v->calibration_mm) : Value());
  return Value::object()
      .set("at_mm", s.at_mm)
      .set("first_x_mm", s.first_x_mm)
      .set("first_y_mm", s.first_y_mm)
      .set("step_mm", s.step_mm)
      .set("columns", s.columns)
      .set("rows", s.rows)
      .set("calibration_mm", values);
}

Value next_poses(const model::Scanner& scanner) {
  Value out = Value::array();
  const metrology::VolumeGrid grid;
  const auto by = metrology::derivatives(scanner, metrology::samples_of(scanner, grid));
  if (!by) return out;
  const auto next = calib::propose_next_pose(scanner, *by, metrology::heights_of(scanner, grid));
  if (!next) return out;
  const Rigid3 cam_from_world = scanner.world_from_cam().inverse();
  for (const auto& pose : next->best) {
    const Eigen::Vector3d in_cam = cam_from_world * pose.middle_in_world_mm;
    const auto pixel = scanner.camera.project(in_cam);
    if (!pixel) continue;
    out.append(Value::object()
                   .set("x_px", pixel->x())
                   .set("y_px", pixel->y())
                   .set("distance_mm", in_cam.z())
                   .set("about_x_deg", pose.about_x_deg)
                   .set("about_y_deg", pose.about_y_deg)
                   .set("worst_now_mm", next->worst_now_mm)
                   .set("worst_mm", pose.worst_mm));
  }
  return out;
}

}  // namespace

fs::path Workbench::scanner_file() const {
  for (const char* name : {"scanner.json", "calibration/so-far.json"}) {
    if (there(commissioning() / name)) return commissioning() / name;
  }
  return {};
}

Value Workbench::calibration() const {
  Value out = Value::object(), seen = Value::array();
  if (const fs::path file = scanner_file(); !file.empty()) {
    const Value document = cached(file);
    copy(document, out, {"camera", "projector", "residuals", "observations", "cam_from_board", "board", "method"});
    out.set("so_far", file.filename() != "scanner.json")
        .set("camera_residuals", to_value(metrology::corner_residuals(model::read_scanner(file))));
  }
  int poses = 0;
  for (; there(commissioning() / "calibration" / pose_name(poses) / "capture.json"); ++poses) {
    const fs::path corners = commissioning() / "calibration" / (pose_name(poses) + "-corners.json");
    seen.append(there(corners) ? cached(corners) : Value());
  }
  out.set("poses", poses).set("seen", seen);
  if (there(commissioning() / "report.json")) {
    const Value report = cached(commissioning() / "report.json");
    if (const Value* section = report.find("calibration")) copy(*section, out, {"parameters"});
  }
  return out;
}

Value Workbench::calibration_map() const {
  const fs::path file = scanner_file();
  if (file.empty()) return Value::object();
  const auto scanner = model::read_scanner(file);
  const auto map = metrology::uncertainty_map(scanner, {.section_steps = kSectionSteps});
  if (!map) throw InputError(fmt::format("{}: {}", file.string(), map.error().sentence));
  Value out = Value::object(), open = Value::array();
  for (const auto& words : metrology::open_words(*map)) open.append(words);
  out.set("rms_mm", map->rms_mm).set("worst_mm", map->worst_mm).set("open", open).set("next", next_poses(scanner));
  for (const auto& section : map->sections) {
    if (section.across == 'z') out.set("section", to_value(section));
  }
  return out;
}

Value Workbench::calibration_picture(int pose) const {
  const fs::path folder = commissioning() / "calibration" / pose_name(pose);
  const CaptureInfo info = read_capture_info(folder);
  Image<std::uint32_t> sum(info.width_px, info.height_px);
  std::uint32_t frames = 0;
  for (const auto& frame : info.frames) {
    if (frame.pattern.kind != PatternKind::phase) continue;
    const GrayImage image = read_gray_image(folder / frame.file);
    if (width_of(image) != info.width_px || height_of(image) != info.height_px) {
      throw InputError(fmt::format("{}: its size is not that of its capture", (folder / frame.file).string()));
    }
    std::visit(
        [&](const auto& i) {
          std::transform(i.values().begin(), i.values().end(), sum.values().begin(), sum.values().begin(),
                         [](auto v, std::uint32_t s) { return s + v; });
        },
        image);
    ++frames;
  }
  if (frames == 0) throw InputError(fmt::format("{} has no phase frames", folder.string()));
  Image16 mean(info.width_px, info.height_px);
  std::transform(sum.values().begin(), sum.values().end(), mean.values().begin(),
                 [&](std::uint32_t s) { return static_cast<std::uint16_t>(s / frames); });
  Value out = Value::object().set("image_width_px", info.width_px).set("image_height_px", info.height_px);
  add_picture(out, mean, (1 << info.bits) - 1, kPictureWidth);
  return out;
}

}  // namespace fringecal::cli::serve

// Presets for tests: the built-in one with some keys changed, written to a temporary file.
#pragma once

#include "core/file.h"
#include "hw/virtual/preset.h"
#include "hw/virtual/virtual_scanner.h"

#include <unistd.h>

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fringecal::virt {

using Changes = std::vector<std::pair<std::string, std::string>>;  // key, new value; the first key of that name

/// A file with the built-in preset, changed; removed again with the object.
class ChangedPreset {
 public:
  explicit ChangedPreset(const Changes& changes) {
    std::string text = built_in_preset_text();
    for (const auto& [key, value] : changes) {
      const auto at = text.find("\n" + key + " = ");
      if (at == std::string::npos) throw std::logic_error("the preset has no key " + key);
      const auto start = at + key.size() + 4;
      text.replace(start, text.find('\n', start) - start, value);
    }
    static int count = 0;
    file_ = std::filesystem::temp_directory_path() /
            ("fringecal_preset_" + std::to_string(::getpid()) + "_" + std::to_string(count++) + ".toml");
    write_atomically(file_, text);
  }
  ~ChangedPreset() { std::filesystem::remove(file_); }
  ChangedPreset(const ChangedPreset&) = delete;
  ChangedPreset& operator=(const ChangedPreset&) = delete;
  std::string file() const { return file_.string(); }

 private:
  std::filesystem::path file_;
};

/// A sixteenth of the pixels, each four times as large: the same field.
inline Changes few_pixels() { return {{"width_px", "348"}, {"height_px", "260"}, {"pixel_mm", "0.0258"}}; }

/// No random error of any kind, 12 bits, and a sensor of `rows` rows only.
inline Changes without_errors(int rows, Changes more = {}) {
  Changes out{{"height_px", std::to_string(rows)},
              {"bits", "12"},
              {"noise_rms", "0.0"},
              {"fixed_pattern_gain", "0.0"},
              {"lithography_mm", "0.0"},
              {"across_mm", "0.0"},
              {"along_mm", "0.0"},
              {"straightness_mm", "0.0"},
              {"flicker", "0.0"},
              {"theta_mrad", "0.0"}};
  out.insert(out.end(), more.begin(), more.end());
  return out;
}

/// Grey level of 255, whatever the bits.
inline double level(const Capture& capture, std::size_t frame, int x, int y) {
  const double value =
      std::visit([&](const auto& image) { return static_cast<double>(image(x, y)); }, capture.frames[frame]);
  return value * 255.0 / capture.saturation_level();
}

inline double level(const Capture& capture, const Pattern& pattern, int x, int y) {
  return level(capture, capture.info.plan.find(pattern).value(), x, y);
}

/// A white board at height z, parallel to R.
inline Scene flat_at(double z_mm) {
  SceneObject board;
  board.name = "board";
  board.shape = FlatBoard{800, 700};
  board.world_from_part.translation_mm = {0, 0, z_mm};
  return {{board}};
}

/// u that lights a pixel on the plane Z = z_mm of the preset's world: the model's own formulas, no renderer.
inline double u_of_plane_pixel(const VirtualScanner& scanner, int x, int y, double z_mm) {
  const auto truth = scanner.true_scanner({});
  const Rigid3 preset_from_cam = scanner.preset_from_cam({});
  const Eigen::Vector3d ray = preset_from_cam.rotation * truth.camera.ray({x, y}).value();
  const double t = (z_mm - preset_from_cam.translation_mm.z()) / ray.z();
  const Eigen::Vector3d in_cam = preset_from_cam.inverse() * (preset_from_cam.translation_mm + t * ray);
  return truth.projector.project(CodeAxis::x, truth.proj_from_cam * in_cam).value();
}

}  // namespace fringecal::virt

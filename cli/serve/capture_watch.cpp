#include "cli/serve/capture_watch.h"

#include "cli/live_line.h"
#include "core/error.h"
#include "core/image_file.h"
#include "hw/partial_capture.h"

namespace fringecal::cli::serve {
namespace fs = std::filesystem;
namespace {

constexpr const char* kPartial = ".partial";

/// Frames are named in the order of their patterns; there is one unfinished capture at a time.
fs::path newest_frame(const fs::path& folder) {
  fs::path capture, frame;
  fs::file_time_type time;
  std::error_code error;
  for (const char* step : {"alignment", "linearisation", "calibration", "verification"}) {
    for (const auto& entry : fs::directory_iterator(folder / step, error)) {
      if (entry.path().extension() != kPartial) continue;
      const auto written = entry.last_write_time(error);
      if (error || (!capture.empty() && written < time)) continue;
      capture = entry.path();
      time = written;
    }
  }
  if (capture.empty()) return {};
  for (const auto& entry : fs::directory_iterator(capture, error)) {
    if (entry.path().extension() == ".png" && entry.path() > frame) frame = entry.path();
  }
  return frame;
}

}  // namespace

std::optional<std::string> CaptureWatch::next(int picture_px) {
  const fs::path file = newest_frame(folder_);
  if (file.empty() || file == last_) return std::nullopt;
  const fs::path capture = file.parent_path();
  GrayImage frame;
  int saturation = 0;
  try {
    frame = read_gray_image(file);
    saturation = (1 << hw::bits_of_partial_capture(capture)) - 1;
  } catch (const InputError&) {  // the capture is finished, and has another name by now
    return std::nullopt;
  }
  last_ = file;
  Value line = to_value(hw::live_figures(frame, saturation));
  line.set("capture", (capture.parent_path().filename() / capture.stem()).string()).set("frame", file.stem().string());
  add_picture(line, frame, saturation, picture_px);
  return to_json(line);
}

}  // namespace fringecal::cli::serve

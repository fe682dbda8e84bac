#include "calib/board_detection.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

#include <algorithm>

namespace fringecal::calib {
namespace {

std::string words_of(const std::optional<FringeCode>& code) {
  return code ? to_json(fringecal::to_value(*code)) : "none";
}

/// The folder's own name, or the whole path where two folders share it.
std::vector<std::string> names_of(std::span<const std::filesystem::path> folders) {
  std::vector<std::string> names;
  for (const auto& folder : folders) {
    auto path = folder.lexically_normal();
    if (!path.has_filename()) path = path.parent_path();
    names.push_back(path.filename().string());
  }
  std::vector<std::string> sorted = names;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    for (std::size_t i = 0; i < names.size(); ++i) names[i] = folders[i].string();
  }
  return names;
}

}  // namespace

BoardViews observe_captures(std::span<const std::filesystem::path> folders, const model::Board& board,
                            const model::PhaseLinearisation* table) {
  BoardViews out;
  const std::vector<std::string> names = names_of(folders);
  for (std::size_t i = 0; i < folders.size(); ++i) {
    const Capture capture = read_capture(folders[i]);
    const CaptureInfo& info = capture.info;
    if (i == 0) {
      out.width_px = info.width_px;
      out.height_px = info.height_px;
      out.plan = info.plan;
    }
    if (info.width_px != out.width_px || info.height_px != out.height_px) {
      throw InputError(fmt::format(
          "{}: images of {} x {} pixels, {} has {} x {}; calibrate with captures of one camera setting",
          folders[i].string(), info.width_px, info.height_px, folders[0].string(), out.width_px, out.height_px));
    }
    if (words_of(info.plan.x) != words_of(out.plan.x) || words_of(info.plan.y) != words_of(out.plan.y)) {
      throw InputError(fmt::format("{}: another fringe code than in {}; calibrate with captures of one pattern plan",
                                   folders[i].string(), folders[0].string()));
    }
    out.inputs.emplace_back(names[i], sha256_of_file(folders[i] / "capture.json"));
    auto observation = observe_board(capture, board, names[i], table);
    if (observation) {
      out.observations.push_back(std::move(*observation));
    } else {
      out.dropped.push_back({names[i], observation.error().sentence});
    }
  }
  return out;
}

}  // namespace fringecal::calib

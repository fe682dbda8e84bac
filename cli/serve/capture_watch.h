// What a running job captures, seen from its folder: the frame that was saved last of a capture that is not finished
// (hw/partial_capture.h). Reading costs the job no camera time; a frame takes some 20 ms of one processor, so whoever
// asks keeps to kPeriod between two.
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>

namespace fringecal::cli::serve {

class CaptureWatch {
 public:
  static constexpr std::chrono::milliseconds kPeriod{500};

  /// folder: of the commissioning.
  explicit CaptureWatch(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// As `fringecal live --json --picture` prints it, with `capture` and `frame`; nothing where there is nothing new.
  std::optional<std::string> next(int picture_px);

 private:
  std::filesystem::path folder_, last_;
};

}  // namespace fringecal::cli::serve

// PartialCapture: a capture that is not finished, in the folder NAME.partial beside the capture's own: every frame is
// on disk, under the name it will have in the capture, as soon as it is taken; partial.json says of which capture they
// are (schema "fringecal.partial_capture", version 1). A run that ends early is continued from there: a frame whose
// image is there and whole (size, depth, the image file's own check sums) is never captured again.
//
// Encoding and writing one frame runs beside the capture of the next; save() waits for the frame before. At most one
// frame is therefore in memory only.
#pragma once

#include "core/capture.h"

#include <filesystem>
#include <future>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::hw {

class PartialCapture {
 public:
  /// What is to be captured. `info.frames` is not used; `info.exposure_ms` is left out; exposures_ms: empty where they
  /// are still to be found. Temperatures and devices are those of the run that began: a run that continues it finds
  /// them in partial.json, so that an interrupted capture ends as the same bytes.
  struct Job {
    CaptureInfo info;
    std::size_t exposures = 1;  // number of exposures of every pattern
    std::vector<double> exposures_ms;
  };

  /// Takes up what is there, or starts anew. Throws InputError where the folder holds frames of another capture
  /// (another plan, camera, source or exposure), or where `folder` is something else of the user's.
  PartialCapture(std::filesystem::path folder, Job job);

  /// The exposures of the frames that are there; empty where none were written yet.
  const std::vector<double>& exposures_ms() const { return job_.exposures_ms; }
  void set_exposures_ms(std::vector<double> exposures_ms);

  bool has(std::size_t pattern, std::size_t exposure) const { return frames_[index(pattern, exposure)].has_value(); }
  int frames_there() const;
  int frames_wanted() const { return static_cast<int>(frames_.size()); }
  const std::filesystem::path& folder() const { return partial_; }

  /// Throws EnvironmentError where the frame *before* could not be written.
  void save(std::size_t pattern, std::size_t exposure, GrayImage image);
  /// Waits until every frame is on disk. Throws EnvironmentError.
  void settle();
  /// All frames are there: makes the capture of them, under its own name.
  void finish();

 private:
  struct Saved {
    std::string file, sha256;
  };
  std::size_t index(std::size_t pattern, std::size_t exposure) const { return pattern * job_.exposures + exposure; }
  std::string file_name(std::size_t pattern, std::size_t exposure) const;
  void take_up();
  void find_frames();
  void write_state() const;
  void merge(CaptureInfo& info) const;

  std::filesystem::path folder_, partial_;
  Job job_;
  std::vector<std::optional<Saved>> frames_;  // index()
  std::future<Saved> writing_;
  std::size_t writing_index_ = 0;
};

/// Removes what is left of an interrupted capture whose folder is complete, if anything is.
void discard_partial_capture(const std::filesystem::path& folder);

/// Significant bits of the frames in a folder NAME.partial. Throws InputError where its partial.json cannot be read.
int bits_of_partial_capture(const std::filesystem::path& partial);

}  // namespace fringecal::hw

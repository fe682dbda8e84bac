// Capture: the file contract between the hardware half and the measuring half of the program.
//
// A folder with the frames as lossless images in pattern order, and one capture.json (schema "fringecal.capture",
// version 1): the pattern plan, exposure, pixel format, times, temperatures, device identities and the SHA-256 of each
// frame. Everything measured starts from this folder; nothing else is known about how it was captured.
#pragma once

#include "core/image.h"
#include "core/pattern_plan.h"

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace fringecal {

struct CaptureFrame {
  std::string file;  // name inside the folder
  Pattern pattern;
  std::string sha256;  // of the image file
  std::string time;    // RFC 3339 UTC; empty where unknown
};

struct CaptureInfo {
  PatternPlan plan;  // patterns in the order of `frames`
  std::vector<CaptureFrame> frames;
  int width_px = 0, height_px = 0;
  int bits = 8;  // significant bits per pixel: 8 .. 16; saturation is 2^bits - 1
  std::optional<double> exposure_ms;
  std::map<std::string, double> temperatures_degC;  // by sensor name
  std::map<std::string, std::string> devices;       // role -> identity ("camera" -> "Basler A102k 20711234")
  std::string source;                               // "virtual chen2008 seed 7", "import of ...", ...
};

struct Capture {
  std::filesystem::path folder;  // empty for a capture that was never on disk
  CaptureInfo info;
  std::vector<GrayImage> frames;  // as info.frames

  int saturation_level() const { return (1 << info.bits) - 1; }
};

/// Reads and checks everything: schema, plan (defect_of), presence, size, depth and hash of every frame.
/// Throws InputError with the file, the number and what to do.
Capture read_capture(const std::filesystem::path& folder);
/// capture.json alone, without touching the frames.
CaptureInfo read_capture_info(const std::filesystem::path& folder);

/// The keys that a capture.json and an import plan share: exposure_ms, temperatures_degC, devices.
void read_notes(Fields& fields, CaptureInfo& info);

/// Empty, or what is wrong with a frame that should have this size and this number of significant bits, as the rest of
/// a sentence that begins with the frame.
std::string defect_of_frame(const GrayImage& image, int width_px, int height_px, int bits);

/// The name of frame k's image in a capture folder: "03_gray_3.png".
std::string frame_file_name(std::size_t k, const Pattern& pattern);
/// Writes capture.json alone, for a folder whose frames are already there under the names and hashes that it states.
void write_capture_info(const std::filesystem::path& folder, const CaptureInfo& info);
/// A capture may replace a capture; throws InputError where anything else of the user's stands under that name.
void refuse_foreign_folder(const std::filesystem::path& folder);

/// Writes the frames (PNG, fast lossless compression) and capture.json into a folder that appears only when complete.
/// Fills in the frames' file names and hashes. Throws EnvironmentError; nothing half-written stays. A capture that is
/// already there is replaced; any other folder that is not empty is refused (InputError).
void write_capture(const std::filesystem::path& folder, Capture& capture);

}  // namespace fringecal

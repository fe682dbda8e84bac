// The import plan: how a folder of images from any scanner becomes a Capture (`fringecal import DIR --plan plan.toml`).
//
//   bits = 12                # significant bits; needed for 16-bit images (8-bit images have 8)
//   left_aligned = false     # true where the camera puts the bits at the upper end of the 16
//   exposure_ms = 20.0       # optional, as are `source`, [devices] (role = "identity") and [temperatures_degC]
//   [codes.x]                # the code along the projector's x, and/or [codes.y] (core/pattern_plan.h)
//   gray_bits = 7
//   phase_steps = 4
//   stripes_per_period = 2
//   period = 0.24
//   unit = "mm"
//   [[sequence]]             # files in the order of their numbers ...
//   files = "frame_{:02}.png"
//   first = 0                # number of the first file, default 0
//   patterns = ["gray 0..6", "phase 0..3"]
//   [[frames]]               # ... or one by one; both may stand in one plan, in this order
//   file = "white.png"
//   kind = "white"           # "gray" with bit and inverted, "phase" with step, "white", "black"; axis = "x" | "y"
//
// files: "{}" stands for the number, "{:03}" for the number with leading zeros; or one "*" that matches any text, the
// matching files then stand in the order of their names, numbers in them compared as numbers.
// patterns: "gray 3", "gray 3 inverted", "phase 0", "white", "black"; ranges "gray 0..9", "gray 9..0"; "gray 0..9 with
// inverses" is each bit followed by its inverse; "x " or "y " before it names the axis (default: the axis that is
// coded; x where both are). Bit 0 is the coarsest; a pixel is bright where the Gray code of its stripe has a 1.
//
// Every mismatch is an InputError of one sentence: a key that is not known, a pattern that is missing or twice, a file
// that is not there, another size or depth than the first frame's, grey levels above the stated bits.
#pragma once

#include "core/capture.h"

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace fringecal {

struct ImportPlan {
  struct Entry {
    std::string file;  // inside the folder
    Pattern pattern;
  };
  std::vector<Entry> entries;
  CaptureInfo info;  // codes, exposure, temperatures, devices, source; frames and sizes are still open
  std::optional<int> bits;
  bool left_aligned = false;
};

/// The patterns that one text of a plan means ("y gray 0..9 with inverses"). Throws InputError, beginning with `place`.
std::vector<Pattern> patterns_from(const std::string& words, CodeAxis default_axis, const std::string& place);

/// Reads a plan; the folder is needed for "*" only.
ImportPlan read_import_plan(const std::filesystem::path& plan_file, const std::filesystem::path& folder);

/// The folder's images as a Capture in memory (`folder` empty until it is written).
Capture import_capture(const std::filesystem::path& folder, const std::filesystem::path& plan_file);

}  // namespace fringecal

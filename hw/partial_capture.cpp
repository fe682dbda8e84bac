#include "hw/partial_capture.h"

#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "hw/exposure.h"

#include <fmt/format.h>

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <numeric>
#include <system_error>

namespace fringecal::hw {
namespace fs = std::filesystem;
namespace {

constexpr const char* kSchema = "fringecal.partial_capture";
constexpr int kVersion = 1;
constexpr const char* kStateFile = "partial.json";

fs::path partial_folder(const fs::path& folder) { return folder.string() + ".partial"; }

Value to_value(const std::map<std::string, double>& temperatures_degC) {
  Value out = Value::object();
  for (const auto& [name, degC] : temperatures_degC) out.set(name, degC);
  return out;
}

Value to_value(const std::map<std::string, std::string>& devices) {
  Value out = Value::object();
  for (const auto& [role, identity] : devices) out.set(role, identity);
  return out;
}

/// What two runs must have in common to share frames, as text to compare and to store.
Value identity_of(const CaptureInfo& info, std::size_t exposures) {
  Value codes = Value::object(), patterns = Value::array();
  if (info.plan.x) codes.set("x", to_value(*info.plan.x));
  if (info.plan.y) codes.set("y", to_value(*info.plan.y));
  for (const Pattern& p : info.plan.patterns) patterns.append(to_value(p));
  const auto camera = info.devices.find("camera");
  Value out = Value::object();
  out.set("source", info.source).set("camera", camera == info.devices.end() ? "" : camera->second);
  out.set("width_px", info.width_px).set("height_px", info.height_px).set("bits", info.bits);
  return out.set("exposures", exposures).set("codes", std::move(codes)).set("patterns", std::move(patterns));
}

/// When a frame was written; the clock of utc_now() where that is set from outside.
std::string time_of(const fs::path& file) {
  struct stat info {};
  std::tm parts{};
  if (std::getenv("SOURCE_DATE_EPOCH") || ::stat(file.c_str(), &info) != 0 || !::gmtime_r(&info.st_mtime, &parts)) {
    return utc_now();
  }
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday,
                     parts.tm_hour, parts.tm_min, parts.tm_sec);
}

/// "out/" and "out" are the same folder.
fs::path without_slash(fs::path folder) {
  while (!folder.has_filename() && folder.has_parent_path() && folder != folder.root_path()) {
    folder = folder.parent_path();
  }
  return folder;
}

}  // namespace

PartialCapture::PartialCapture(fs::path folder, Job job)
    : folder_(without_slash(std::move(folder))),
      partial_(partial_folder(folder_)),
      job_(std::move(job)),
      frames_(job_.info.plan.patterns.size() * job_.exposures) {
  require(job_.exposures >= 1 && (job_.exposures_ms.empty() || job_.exposures_ms.size() == job_.exposures),
          "a capture has one exposure time per exposure");
  refuse_foreign_folder(folder_);
  std::error_code error;
  if (fs::exists(partial_ / kStateFile, error)) {
    take_up();
  } else if (fs::exists(partial_, error) && !fs::is_empty(partial_, error)) {
    throw InputError(fmt::format("{}: there is no {} in it, so it is not the rest of a capture; move it away",
                                 partial_.string(), kStateFile));
  } else {
    write_state();
  }
}

std::string PartialCapture::file_name(std::size_t pattern, std::size_t exposure) const {
  std::string name = frame_file_name(pattern, job_.info.plan.patterns[pattern]);
  if (job_.exposures == 1) return name;
  return fmt::format("{}.exposure_{}.png", fs::path(name).stem().string(), exposure);
}

void PartialCapture::take_up() {
  const fs::path file = partial_ / kStateFile;
  Fields fields(read_json(file), file.string());
  fields.expect_schema(kSchema, kVersion);
  const std::string there = to_json(fields.raw("capture"));
  if (there != to_json(identity_of(job_.info, job_.exposures))) {
    throw InputError(fmt::format(
        "{}: it holds frames of a capture with another plan, camera, source or number of exposures; finish that one "
        "with its own settings, or remove the folder",
        partial_.string()));
  }
  const std::vector<double> exposures_ms = fields.numbers("exposures_ms");
  if (!job_.exposures_ms.empty() && !exposures_ms.empty() && exposures_ms != job_.exposures_ms) {
    throw InputError(
        fmt::format("{}: its frames were exposed for {} ms, now {} ms are asked for; finish it with its own exposure, "
                    "or remove the folder",
                    partial_.string(), fmt::join(exposures_ms, " and "), fmt::join(job_.exposures_ms, " and ")));
  }
  if (!exposures_ms.empty()) job_.exposures_ms = exposures_ms;
  read_notes(fields, job_.info);
  fields.finish();
  find_frames();
}

void PartialCapture::find_frames() {
  const CaptureInfo& info = job_.info;
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    const std::string file = file_name(k / job_.exposures, k % job_.exposures);
    std::error_code error;
    if (!fs::is_regular_file(partial_ / file, error)) continue;
    const std::string bytes = read_bytes(partial_ / file);
    try {
      const GrayImage image = decode_gray_image(bytes, file);
      if (defect_of_frame(image, info.width_px, info.height_px, info.bits).empty())
        frames_[k] = {file, sha256_hex(bytes)};
    } catch (const InputError&) {
      frames_[k].reset();  // damaged: to be captured again
    }
  }
}

void PartialCapture::write_state() const {
  Value out = Value::object();
  out.set("schema", kSchema).set("schema_version", kVersion);
  out.set("capture", identity_of(job_.info, job_.exposures)).set("exposures_ms", Value::numbers(job_.exposures_ms));
  out.set("temperatures_degC", to_value(job_.info.temperatures_degC)).set("devices", to_value(job_.info.devices));
  write_atomically(partial_ / kStateFile, to_json(out));
}

void PartialCapture::set_exposures_ms(std::vector<double> exposures_ms) {
  require(exposures_ms.size() == job_.exposures, "a capture has one exposure time per exposure");
  job_.exposures_ms = std::move(exposures_ms);
  write_state();
}

int PartialCapture::frames_there() const {
  return static_cast<int>(std::count_if(frames_.begin(), frames_.end(), [](const auto& f) { return f.has_value(); }));
}

void PartialCapture::save(std::size_t pattern, std::size_t exposure, GrayImage image) {
  settle();
  writing_index_ = index(pattern, exposure);
  writing_ = std::async(std::launch::async,
                        [folder = partial_, file = file_name(pattern, exposure), frame = std::move(image)] {
                          const std::string bytes = encode_png(frame);
                          write_atomically(folder / file, bytes);
                          return Saved{file, sha256_hex(bytes)};
                        });
}

void PartialCapture::settle() {
  if (writing_.valid()) frames_[writing_index_] = writing_.get();
}

void PartialCapture::merge(CaptureInfo& info) const {
  // Shortest exposure first.
  std::vector<std::size_t> order(job_.exposures);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return job_.exposures_ms[a] < job_.exposures_ms[b]; });
  std::vector<std::vector<GrayImage>> stacks(job_.exposures);
  for (std::size_t e = 0; e < job_.exposures; ++e) {
    for (std::size_t k = 0; k < info.plan.patterns.size(); ++k) {
      stacks[e].push_back(read_gray_image(partial_ / frames_[index(k, order[e])]->file));
    }
  }
  Capture capture{.folder = {}, .info = info, .frames = merge_exposures(info.plan, stacks, (1 << info.bits) - 1)};
  write_capture(folder_, capture);
  discard_partial_capture(folder_);
}

void PartialCapture::finish() {
  settle();
  require(frames_there() == frames_wanted(), "a capture is finished when all its frames are there");
  CaptureInfo info = job_.info;
  info.exposure_ms = *std::min_element(job_.exposures_ms.begin(), job_.exposures_ms.end());
  info.frames.clear();
  for (std::size_t k = 0; k < info.plan.patterns.size(); ++k) {
    const Saved& saved = *frames_[index(k, 0)];
    info.frames.push_back({.file = saved.file,
                           .pattern = info.plan.patterns[k],
                           .sha256 = saved.sha256,
                           .time = time_of(partial_ / saved.file)});
  }
  if (job_.exposures > 1) return merge(info);
  // Hard links: the frames stay in the partial folder until the capture stands under its name, so an interruption here
  // loses nothing and repeats nothing.
  FolderTransaction transaction(folder_);
  for (const CaptureFrame& frame : info.frames) {
    std::error_code error;
    fs::create_hard_link(partial_ / frame.file, transaction.working() / frame.file, error);
    if (error) fs::copy_file(partial_ / frame.file, transaction.working() / frame.file, error);
    if (error) {
      throw EnvironmentError(
          fmt::format("{}: cannot be copied into the capture ({}); free space and repeat the command",
                      (partial_ / frame.file).string(), error.message()));
    }
  }
  write_capture_info(transaction.working(), info);
  transaction.commit();
  discard_partial_capture(folder_);
}

void discard_partial_capture(const fs::path& folder) {
  const fs::path partial = partial_folder(without_slash(folder));
  std::error_code ignored;
  // partial.json last: while it is there, what is left can be continued or removed.
  std::vector<fs::path> frames;
  for (const auto& entry : fs::directory_iterator(partial, ignored)) {
    if (entry.path().filename() != kStateFile) frames.push_back(entry.path());
  }
  for (const fs::path& frame : frames) fs::remove_all(frame, ignored);
  fs::remove_all(partial, ignored);
}

int bits_of_partial_capture(const fs::path& partial) {
  const fs::path file = partial / kStateFile;
  const Value state = read_json(file);
  const Value* identity = state.find("capture");
  const Value* bits = identity ? identity->find("bits") : nullptr;
  if (!bits || !bits->if_integer() || *bits->if_integer() < 1 || *bits->if_integer() > 16) {
    throw InputError(fmt::format("{}: capture.bits is missing or not 1 to 16", file.string()));
  }
  return static_cast<int>(*bits->if_integer());
}

}  // namespace fringecal::hw

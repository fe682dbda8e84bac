#include "core/capture.h"

#include "core/file.h"
#include "core/image_file.h"
#include "core/parallel.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>

namespace fringecal {
namespace fs = std::filesystem;
namespace {

constexpr const char* kSchema = "fringecal.capture";
constexpr int kVersion = 1;
constexpr const char* kFileName = "capture.json";

/// A table of free keys with one kind of value each.
template <class Map, class Read>
Map free_table(Fields& fields, const char* key, const Read& read) {
  Map out;
  auto table = fields.optional_table(key);
  if (!table) return out;
  const Value content = fields.raw(key);
  for (const auto& [name, value] : *content.if_object()) out[name] = read(*table, name);
  table->finish();
  return out;
}

CaptureFrame frame_from(Fields fields) {
  CaptureFrame frame;
  frame.file = fields.text("file");
  if (frame.file.empty() || fs::path(frame.file).filename() != frame.file || frame.file == "." || frame.file == "..") {
    fields.complain(
        fmt::format("'file' is '{}'; it must be the name of an image in the capture's own folder", frame.file));
  }
  frame.pattern = pattern_from(fields.table("pattern"));
  frame.sha256 = fields.text("sha256");
  frame.time = fields.optional_text("time").value_or("");
  fields.finish();
  return frame;
}

Value to_value(const CaptureInfo& info) {
  Value codes = Value::object(), frames = Value::array(), temperatures = Value::object(), devices = Value::object();
  if (info.plan.x) codes.set("x", to_value(*info.plan.x));
  if (info.plan.y) codes.set("y", to_value(*info.plan.y));
  for (const CaptureFrame& frame : info.frames) {
    Value v = Value::object();
    v.set("file", frame.file).set("pattern", to_value(frame.pattern)).set("sha256", frame.sha256);
    if (!frame.time.empty()) v.set("time", frame.time);
    frames.append(std::move(v));
  }
  for (const auto& [name, degC] : info.temperatures_degC) temperatures.set(name, degC);
  for (const auto& [role, identity] : info.devices) devices.set(role, identity);
  Value out = Value::object();
  out.set("schema", kSchema).set("schema_version", kVersion).set("source", info.source);
  out.set("width_px", info.width_px).set("height_px", info.height_px).set("bits", info.bits);
  if (info.exposure_ms) out.set("exposure_ms", *info.exposure_ms);
  out.set("temperatures_degC", std::move(temperatures)).set("devices", std::move(devices));
  return out.set("codes", std::move(codes)).set("frames", std::move(frames));
}

/// Reads one frame and checks it against what capture.json says.
GrayImage read_frame(const fs::path& folder, const CaptureInfo& info, std::size_t k) {
  const CaptureFrame& frame = info.frames[k];
  const fs::path file = folder / frame.file;
  std::error_code error;
  if (!fs::exists(file, error)) {
    throw InputError(fmt::format("{}: frame {} ('{}') of the capture is missing; copy it back or capture again",
                                 file.string(), k, describe(frame.pattern)));
  }
  const std::string bytes = read_bytes(file);
  GrayImage image = decode_gray_image(bytes, file.string());
  const std::string defect = defect_of_frame(image, info.width_px, info.height_px, info.bits);
  if (!defect.empty()) {
    throw InputError(fmt::format("{}: frame {} ('{}') {}; capture again, all frames in one format", file.string(), k,
                                 describe(frame.pattern), defect));
  }
  if (sha256_hex(bytes) != frame.sha256) {
    throw InputError(
        fmt::format("{}: frame {} ('{}') is not the one that was captured (its SHA-256 differs from {}); "
                    "copy the original back",
                    file.string(), k, describe(frame.pattern), kFileName));
  }
  return image;
}

/// Calls work(k) for every frame in parallel; of several failures the first frame's is thrown, whatever the threads
/// did.
template <class Work>
void for_each_frame(std::size_t count, const Work& work) {
  std::vector<std::exception_ptr> failures(count);
  parallel_for(static_cast<int>(count), [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    try {
      work(k);
    } catch (...) {
      failures[k] = std::current_exception();
    }
  });
  for (const auto& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
}

}  // namespace

std::string defect_of_frame(const GrayImage& image, int width_px, int height_px, int bits) {
  if (width_of(image) != width_px || height_of(image) != height_px) {
    return fmt::format("has {} x {} pixels where {} x {} are expected", width_of(image), height_of(image), width_px,
                       height_px);
  }
  const bool wide = std::holds_alternative<Image16>(image);
  if (wide != (bits > 8)) {
    return fmt::format("is a {}-bit image where {} bits are expected", wide ? 16 : 8, bits);
  }
  if (wide && bits < 16) {
    const auto& values = std::get<Image16>(image).values();
    const int top = *std::max_element(values.begin(), values.end());
    if (top >= 1 << bits)
      return fmt::format("has a grey level of {}, above the {} of {} bits", top, (1 << bits) - 1, bits);
  }
  return "";
}

void read_notes(Fields& fields, CaptureInfo& info) {
  info.exposure_ms = fields.optional_number("exposure_ms");
  info.temperatures_degC = free_table<std::map<std::string, double>>(
      fields, "temperatures_degC", [](Fields& t, const std::string& key) { return t.number(key); });
  info.devices = free_table<std::map<std::string, std::string>>(
      fields, "devices", [](Fields& t, const std::string& key) { return t.text(key); });
}

CaptureInfo read_capture_info(const fs::path& folder) {
  const fs::path file = folder / kFileName;
  std::error_code error;
  if (!fs::exists(file, error) && !error) {
    throw InputError(
        fmt::format("{}: no capture here ({} is missing); give a capture folder, or make one from a folder "
                    "of images with 'fringecal import'",
                    folder.string(), kFileName));
  }
  Fields fields(read_json(file), file.string());
  fields.expect_schema(kSchema, kVersion);
  CaptureInfo info;
  info.source = fields.text("source");
  info.width_px = fields.integer("width_px");
  info.height_px = fields.integer("height_px");
  info.bits = fields.integer("bits");
  read_notes(fields, info);
  Fields codes = fields.table("codes");
  if (auto x = codes.optional_table("x")) info.plan.x = fringe_code_from(*x);
  if (auto y = codes.optional_table("y")) info.plan.y = fringe_code_from(*y);
  codes.finish();
  for (Fields& frame : fields.tables("frames")) {
    info.frames.push_back(frame_from(std::move(frame)));
    info.plan.patterns.push_back(info.frames.back().pattern);
  }
  fields.finish();
  if (info.width_px < 1 || info.height_px < 1) {
    fields.complain(
        fmt::format("the frames have {} x {} pixels; both must be positive", info.width_px, info.height_px));
  }
  if (info.bits < 8 || info.bits > 16) fields.complain(fmt::format("'bits' is {}; 8 to 16 can be read", info.bits));
  if (info.frames.empty()) fields.complain("the capture has no frames; capture again");
  if (const std::string defect = defect_of(info.plan); !defect.empty()) fields.complain(defect);
  return info;
}

Capture read_capture(const fs::path& folder) {
  Capture capture{.folder = folder, .info = read_capture_info(folder), .frames = {}};
  capture.frames.resize(capture.info.frames.size());
  for_each_frame(capture.frames.size(),
                 [&](std::size_t k) { capture.frames[k] = read_frame(folder, capture.info, k); });
  return capture;
}

void refuse_foreign_folder(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return;
  if (!fs::is_directory(folder, error)) {
    throw InputError(fmt::format("{}: this is a file; name a folder for the capture", folder.string()));
  }
  if (!fs::is_empty(folder, error) && !fs::exists(folder / kFileName, error)) {
    throw InputError(
        fmt::format("{}: this folder holds something that is not a capture; name a new folder", folder.string()));
  }
}

std::string frame_file_name(std::size_t k, const Pattern& pattern) {
  std::string name = describe(pattern);
  std::replace(name.begin(), name.end(), ' ', '_');
  return fmt::format("{:02}_{}.png", k, name);
}

void write_capture_info(const fs::path& folder, const CaptureInfo& info) {
  write_atomically(folder / kFileName, to_json(to_value(info)));
}

void write_capture(const fs::path& folder, Capture& capture) {
  CaptureInfo& info = capture.info;
  require(!capture.frames.empty() && capture.frames.size() == info.frames.size() &&
              info.plan.patterns.size() == info.frames.size(),
          "a capture has one pattern and one description per frame");
  refuse_foreign_folder(folder);
  FolderTransaction transaction(folder);
  for_each_frame(capture.frames.size(), [&](std::size_t k) {
    CaptureFrame& frame = info.frames[k];
    require(frame.pattern == info.plan.patterns[k], "the frames stand in the order of the plan");
    require(defect_of_frame(capture.frames[k], info.width_px, info.height_px, info.bits).empty(),
            "the frames have the size and depth that the capture states");
    frame.file = frame_file_name(k, frame.pattern);
    const std::string bytes = encode_png(capture.frames[k]);
    frame.sha256 = sha256_hex(bytes);
    write_atomically(transaction.working() / frame.file, bytes);
  });
  write_capture_info(transaction.working(), info);
  transaction.commit();
  capture.folder = folder;
}

}  // namespace fringecal

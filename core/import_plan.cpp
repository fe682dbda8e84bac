#include "core/import_plan.h"

#include "core/file.h"
#include "core/image_file.h"
#include "core/parallel.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <sstream>

namespace fringecal {
namespace fs = std::filesystem;
namespace {

/// "3" or "0..9" (or "9..0").
std::optional<std::vector<int>> indices_from(const std::string& text) {
  const auto number = [](const std::string& digits) -> std::optional<int> {
    if (digits.empty() || digits.size() > 4 ||
        !std::all_of(digits.begin(), digits.end(), [](unsigned char c) { return std::isdigit(c) != 0; })) {
      return std::nullopt;
    }
    return std::stoi(digits);
  };
  const std::size_t dots = text.find("..");
  const auto first = number(text.substr(0, dots));
  const auto last = dots == std::string::npos ? first : number(text.substr(dots + 2));
  if (!first || !last) return std::nullopt;
  std::vector<int> out;
  const int step = *last < *first ? -1 : 1;
  for (int i = *first; i != *last + step; i += step) out.push_back(i);
  return out;
}

/// Order of names in which "frame_2" comes before "frame_10".
bool natural_less(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      while (i < a.size() && a[i] == '0') ++i;
      while (j < b.size() && b[j] == '0') ++j;
      std::size_t i_end = i, j_end = j;
      while (i_end < a.size() && is_digit(a[i_end])) ++i_end;
      while (j_end < b.size() && is_digit(b[j_end])) ++j_end;
      if (i_end - i != j_end - j) return i_end - i < j_end - j;
      const int order = a.compare(i, i_end - i, b, j, j_end - j);
      if (order != 0) return order < 0;
      i = i_end;
      j = j_end;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;
}

std::vector<std::string> matching_files(const fs::path& folder, const std::string& wanted) {
  const std::size_t star = wanted.find('*');
  const std::string head = wanted.substr(0, star), tail = wanted.substr(star + 1);
  std::vector<std::string> out;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.size() >= head.size() + tail.size() && name.starts_with(head) && name.ends_with(tail)) out.push_back(name);
  }
  std::sort(out.begin(), out.end(), natural_less);
  return out;
}

/// The numbered names of a template with "{}" or "{:0W}".
std::vector<std::string> numbered_files(Fields& fields, const std::string& wanted, int first, std::size_t count) {
  const std::size_t open = wanted.find('{'), close = wanted.find('}', open);
  if (open == std::string::npos || close == std::string::npos || wanted.find('{', open + 1) != std::string::npos) {
    fields.complain(
        fmt::format("'files' is '{}'; it needs one place for the number, \"{{}}\" or \"{{:02}}\", or one "
                    "\"*\"",
                    wanted));
  }
  const std::string format = wanted.substr(open + 1, close - open - 1);
  int digits = 0;
  if (format.size() == 3 && format.starts_with(":0") && std::isdigit(static_cast<unsigned char>(format[2]))) {
    digits = format[2] - '0';
  } else if (!format.empty()) {
    fields.complain(
        fmt::format("'files' has '{{{}}}'; write {{}} for the plain number or {{:03}} for three digits", format));
  }
  std::vector<std::string> out;
  for (std::size_t i = 0; i < count; ++i) {
    out.push_back(fmt::format("{}{:0{}}{}", wanted.substr(0, open), first + static_cast<int>(i), digits,
                              wanted.substr(close + 1)));
  }
  return out;
}

void add_sequence(Fields fields, CodeAxis default_axis, const fs::path& folder, ImportPlan& plan) {
  std::vector<Pattern> patterns;
  for (const std::string& words : fields.texts("patterns")) {
    const auto some = patterns_from(words, default_axis, fields.file());
    patterns.insert(patterns.end(), some.begin(), some.end());
  }
  const std::string wanted = fields.text("files");
  const auto first = fields.optional_integer("first");
  fields.finish();
  std::vector<std::string> files;
  if (wanted.find('*') != std::string::npos) {
    if (first) fields.complain("'first' has no meaning where 'files' has a \"*\"; remove one of them");
    files = matching_files(folder, wanted);
    if (files.size() != patterns.size()) {
      fields.complain(fmt::format("{} files in {} match '{}' and the plan lists {} patterns; make the two agree",
                                  files.size(), folder.string(), wanted, patterns.size()));
    }
  } else {
    files = numbered_files(fields, wanted, first.value_or(0), patterns.size());
  }
  for (std::size_t i = 0; i < patterns.size(); ++i) plan.entries.push_back({files[i], patterns[i]});
}

void add_frame(Fields fields, CodeAxis default_axis, ImportPlan& plan) {
  ImportPlan::Entry entry;
  entry.file = fields.text("file");
  Value rest = Value::object();
  for (const char* key : {"kind", "axis", "bit", "step", "inverted"}) {
    const Value value = fields.raw(key);
    if (!value.is_null()) rest.set(key, value);
  }
  fields.finish();
  const auto* kind = rest.find("kind") ? rest.find("kind")->if_text() : nullptr;
  if (!rest.find("axis") && kind && (*kind == "gray" || *kind == "phase")) {
    rest.set("axis", default_axis == CodeAxis::x ? "x" : "y");
  }
  entry.pattern = pattern_from(Fields(std::move(rest), fields.file(), fmt::format("frame '{}'", entry.file)));
  plan.entries.push_back(std::move(entry));
}

/// Bits at the upper end of 16 moved to the lower; the file must have nothing below them.
void align_right(GrayImage& image, int bits, const std::string& file) {
  auto* wide = std::get_if<Image16>(&image);
  if (!wide) return;
  const int shift = 16 - bits;
  for (std::uint16_t& v : wide->values()) {
    if ((v & ((1 << shift) - 1)) != 0) {
      throw InputError(
          fmt::format("{}: a grey level of {} is no multiple of {}, so the {} bits are not left-aligned; "
                      "remove 'left_aligned' from the plan or correct 'bits'",
                      file, v, 1 << shift, bits));
    }
    v = static_cast<std::uint16_t>(v >> shift);
  }
}

int stated_bits(const ImportPlan& plan, const GrayImage& first, const std::string& file, const std::string& plan_file) {
  const bool wide = std::holds_alternative<Image16>(first);
  if (!plan.bits && !wide) return 8;
  if (!plan.bits) {
    throw InputError(
        fmt::format("{}: '{}' is a 16-bit image; say in the plan how many bits the camera delivers (bits = "
                    "12), so that saturation can be seen",
                    plan_file, file));
  }
  if (!wide && *plan.bits > 8) {
    throw InputError(
        fmt::format("{}: bits is {} but '{}' is an 8-bit image; correct 'bits'", plan_file, *plan.bits, file));
  }
  return *plan.bits;
}

}  // namespace

std::vector<Pattern> patterns_from(const std::string& words, CodeAxis default_axis, const std::string& place) {
  const auto fail = [&] {
    throw InputError(
        fmt::format("{}: the pattern '{}' is not understood; write \"gray 0..6\", \"gray 3 inverted\", "
                    "\"gray 0..9 with inverses\", \"phase 0..3\", \"white\" or \"black\", with \"y \" before "
                    "it for the y axis",
                    place, words));
  };
  std::istringstream in(words);
  std::vector<std::string> word;
  for (std::string w; in >> w;) word.push_back(w);
  if (word.size() == 1 && (word[0] == "white" || word[0] == "black")) {
    return {{.kind = word[0] == "white" ? PatternKind::white : PatternKind::black}};
  }
  CodeAxis axis = default_axis;
  if (!word.empty() && (word[0] == "x" || word[0] == "y")) {
    axis = word[0] == "x" ? CodeAxis::x : CodeAxis::y;
    word.erase(word.begin());
  }
  if (word.size() < 2 || (word[0] != "gray" && word[0] != "phase")) fail();
  const auto indices = indices_from(word[1]);
  const bool gray = word[0] == "gray";
  const bool inverted = gray && word.size() == 3 && word[2] == "inverted";
  const bool with_inverses =
      gray && word.size() == 4 && word[2] == "with" && (word[3] == "inverses" || word[3] == "inverse");
  if (!indices || (word.size() > 2 && !inverted && !with_inverses)) fail();
  std::vector<Pattern> out;
  for (const int index : *indices) {
    out.push_back({gray ? PatternKind::gray : PatternKind::phase, axis, index, inverted});
    if (with_inverses) out.push_back({PatternKind::gray, axis, index, true});
  }
  return out;
}

ImportPlan read_import_plan(const fs::path& plan_file, const fs::path& folder) {
  Fields fields(read_toml(plan_file), plan_file.string());
  ImportPlan plan;
  Fields codes = fields.table("codes");
  if (auto x = codes.optional_table("x")) plan.info.plan.x = fringe_code_from(*x);
  if (auto y = codes.optional_table("y")) plan.info.plan.y = fringe_code_from(*y);
  codes.finish();
  const CodeAxis default_axis = plan.info.plan.x || !plan.info.plan.y ? CodeAxis::x : CodeAxis::y;
  plan.bits = fields.optional_integer("bits");
  if (plan.bits && (*plan.bits < 8 || *plan.bits > 16))
    fields.complain(fmt::format("'bits' is {}; 8 to 16 can be read", *plan.bits));
  plan.left_aligned = fields.optional_boolean("left_aligned").value_or(false);
  if (plan.left_aligned && !plan.bits)
    fields.complain("'left_aligned' needs 'bits'; say how many bits the camera delivers");
  read_notes(fields, plan.info);
  plan.info.source = fields.optional_text("source").value_or("import of " + folder.string());
  for (Fields& sequence : fields.tables("sequence")) add_sequence(std::move(sequence), default_axis, folder, plan);
  for (Fields& frame : fields.tables("frames")) add_frame(std::move(frame), default_axis, plan);
  fields.finish();
  if (plan.entries.empty()) fields.complain("the plan lists no frames; add [[sequence]] or [[frames]]");
  for (const auto& entry : plan.entries) plan.info.plan.patterns.push_back(entry.pattern);
  if (const std::string defect = defect_of(plan.info.plan); !defect.empty()) fields.complain(defect);
  return plan;
}

Capture import_capture(const fs::path& folder, const fs::path& plan_file) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw InputError(
        fmt::format("{}: there is no such folder; give the folder that holds the images", folder.string()));
  }
  const ImportPlan plan = read_import_plan(plan_file, folder);
  const auto pattern_of = [&](std::size_t k) { return describe(plan.entries[k].pattern); };
  for (std::size_t k = 0; k < plan.entries.size(); ++k) {
    const fs::path file = folder / plan.entries[k].file;
    if (!fs::exists(file, error)) {
      throw InputError(fmt::format("{}: the image for '{}' is missing; copy it there or correct the plan {}",
                                   file.string(), pattern_of(k), plan_file.string()));
    }
  }
  Capture capture{.folder = {}, .info = plan.info, .frames = {}};
  capture.frames.resize(plan.entries.size());
  std::vector<std::exception_ptr> failures(
      plan.entries.size());  // the first frame's is thrown, whatever the threads did
  parallel_for(static_cast<int>(plan.entries.size()), [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    try {
      capture.frames[k] = read_gray_image(folder / plan.entries[k].file);
      if (plan.left_aligned) align_right(capture.frames[k], *plan.bits, (folder / plan.entries[k].file).string());
    } catch (...) {
      failures[k] = std::current_exception();
    }
  });
  for (const auto& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
  CaptureInfo& info = capture.info;
  info.width_px = width_of(capture.frames[0]);
  info.height_px = height_of(capture.frames[0]);
  info.bits = stated_bits(plan, capture.frames[0], plan.entries[0].file, plan_file.string());
  for (std::size_t k = 0; k < plan.entries.size(); ++k) {
    const std::string defect = defect_of_frame(capture.frames[k], info.width_px, info.height_px, info.bits);
    if (!defect.empty()) {
      throw InputError(
          fmt::format("{}: the image for '{}' {}; all frames of a capture have the size of the first ({}) and "
                      "the plan's bits, so correct the image or the plan",
                      (folder / plan.entries[k].file).string(), pattern_of(k), defect, plan.entries[0].file));
    }
    info.frames.push_back({.file = "", .pattern = plan.entries[k].pattern, .sha256 = "", .time = ""});
  }
  return capture;
}

}  // namespace fringecal

#include "core/point_file.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

namespace fringecal {
namespace {

using Points = std::vector<Eigen::Vector3d>;

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }
bool is_separator(char c) { return is_blank(c) || c == ','; }

/// A text cut into lines, counted from 1 as editors do.
class Lines {
 public:
  explicit Lines(std::string_view text) : text_(text) {
    if (text_.starts_with("\xEF\xBB\xBF")) text_.remove_prefix(3);
  }
  bool next(std::string_view& line) {
    if (at_ >= text_.size()) return false;
    const std::size_t end = std::min(text_.find('\n', at_), text_.size());
    line = text_.substr(at_, end - at_);
    at_ = end + 1;
    ++number_;
    return true;
  }
  std::size_t number() const { return number_; }
  std::string_view rest() const { return text_.substr(std::min(at_, text_.size())); }

 private:
  std::string_view text_;
  std::size_t at_ = 0, number_ = 0;
};

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && is_blank(s.front())) s.remove_prefix(1);
  while (!s.empty() && is_blank(s.back())) s.remove_suffix(1);
  return s;
}

/// The start of a line as it can stand in a message: short, printable.
std::string shown(std::string_view line) {
  std::string out(trimmed(line).substr(0, 40));
  std::replace_if(
      out.begin(), out.end(), [](char c) { return c < 32 || c > 126; }, '?');
  return out.size() == 40 ? out + "..." : out;
}

[[noreturn]] void complain(const std::string& where, const std::string& sentence) {
  throw InputError(fmt::format("{}: {}", where, sentence));
}

std::string at_line(const std::string& file, const Lines& lines) { return fmt::format("{}:{}", file, lines.number()); }

/// Reads the next number of a line. Returns false at the end of the line; complains about what is no finite number.
bool next_number(const char*& at, const char* end, double& value, const std::string& file, const Lines& lines,
                 std::string_view line) {
  while (at != end && is_separator(*at)) ++at;
  if (at == end) return false;
  const char* from = *at == '+' && at + 1 != end && at[1] != '-' ? at + 1 : at;  // from_chars takes no plus sign
  const auto [after, error] = std::from_chars(from, end, value);
  if (error == std::errc::result_out_of_range) {
    complain(at_line(file, lines),
             fmt::format("a number is too large or too small for a double in \"{}\"; correct it", shown(line)));
  }
  if (error != std::errc() || (after != end && !is_separator(*after))) {
    complain(at_line(file, lines), fmt::format("expected numbers and found \"{}\"; each point is one line x y z "
                                               "(white space or comma between, decimal point)",
                                               shown(line)));
  }
  if (!std::isfinite(value)) {
    complain(at_line(file, lines),
             fmt::format("\"{}\" is not a finite point; remove invalid points before fitting", shown(line)));
  }
  at = after;
  return true;
}

Eigen::Vector3d point_of_line(std::string_view line, const std::string& file, const Lines& lines) {
  Eigen::Vector3d p;
  const char* at = line.data();
  const char* const end = line.data() + line.size();
  int found = 0;
  double value = 0;
  while (next_number(at, end, value, file, lines, line)) {
    if (found < 3) p[found] = value;
    ++found;
  }
  if (found != 3) {
    complain(at_line(file, lines),
             fmt::format("a point needs exactly 3 numbers (x y z) and this line has {}: \"{}\"; keep x y z only", found,
                         shown(line)));
  }
  return p;
}

Points read_lines(Lines& lines, const std::string& file, std::size_t expected) {
  Points points;
  points.reserve(std::min(expected, lines.rest().size() / 6 + 1));
  for (std::string_view line; lines.next(line);) {
    if (!trimmed(line).empty()) points.push_back(point_of_line(line, file, lines));
  }
  return points;
}

Points read_xyz(std::string_view text, const std::string& file) {
  Lines lines(text);
  return read_lines(lines, file, text.size() / 24);
}

/// NIST's data sets: the first line is the number of points.
Points read_ds(std::string_view text, const std::string& file) {
  Lines lines(text);
  std::string_view line;
  do {
    if (!lines.next(line)) complain(file, "the file is empty; a .ds file starts with the number of points");
  } while (trimmed(line).empty());
  const std::string_view field = trimmed(line);
  std::size_t count = 0;
  const auto [after, error] = std::from_chars(field.data(), field.data() + field.size(), count);
  if (error != std::errc() || after != field.data() + field.size()) {
    complain(at_line(file, lines),
             fmt::format("the first line of a .ds file is the number of points and this one is \"{}\"; for a file "
                         "without that line use the ending .xyz",
                         shown(line)));
  }
  Points points = read_lines(lines, file, count);
  if (points.size() != count) {
    complain(file, fmt::format("the first line announces {} points and {} follow; the file is truncated or its first "
                               "line is wrong",
                               count, points.size()));
  }
  return points;
}

// --- PLY, as G. Turk's specification of 1994 and every scanner program write it ---------------------------------

enum class Kind { i8, u8, i16, u16, i32, u32, f32, f64 };
constexpr std::array<std::size_t, 8> kSize{1, 1, 2, 2, 4, 4, 4, 8};
constexpr std::array<std::pair<std::string_view, Kind>, 16> kKinds{{{"char", Kind::i8},
                                                                    {"int8", Kind::i8},
                                                                    {"uchar", Kind::u8},
                                                                    {"uint8", Kind::u8},
                                                                    {"short", Kind::i16},
                                                                    {"int16", Kind::i16},
                                                                    {"ushort", Kind::u16},
                                                                    {"uint16", Kind::u16},
                                                                    {"int", Kind::i32},
                                                                    {"int32", Kind::i32},
                                                                    {"uint", Kind::u32},
                                                                    {"uint32", Kind::u32},
                                                                    {"float", Kind::f32},
                                                                    {"float32", Kind::f32},
                                                                    {"double", Kind::f64},
                                                                    {"float64", Kind::f64}}};

struct Property {
  std::string name;
  Kind kind = Kind::f32;
  bool is_list = false;
};
struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
  bool has_list() const {
    return std::any_of(properties.begin(), properties.end(), [](const Property& p) { return p.is_list; });
  }
  std::size_t row_bytes() const {
    std::size_t sum = 0;
    for (const Property& p : properties) sum += kSize[static_cast<std::size_t>(p.kind)];
    return sum;
  }
};
enum class Format { ascii, little_endian, big_endian };
struct Header {
  Format format = Format::ascii;
  std::vector<Element> elements;
};

std::vector<std::string> words_of(std::string_view line) {
  std::vector<std::string> words;
  for (std::size_t at = 0; at < line.size();) {
    while (at < line.size() && is_blank(line[at])) ++at;
    std::size_t end = at;
    while (end < line.size() && !is_blank(line[end])) ++end;
    if (end > at) words.emplace_back(line.substr(at, end - at));
    at = end;
  }
  return words;
}

Kind kind_of(const std::string& word, const std::string& file, const Lines& lines) {
  for (const auto& [name, kind] : kKinds) {
    if (name == word) return kind;
  }
  complain(at_line(file, lines),
           fmt::format("unknown PLY property type \"{}\"; write x, y, z as float or double", shown(word)));
}

Header read_header(Lines& lines, const std::string& file) {
  Header header;
  std::string_view line;
  if (!lines.next(line) || trimmed(line) != "ply") complain(file, "not a PLY file: its first line is not \"ply\"");
  bool has_format = false;
  while (lines.next(line)) {
    const std::vector<std::string> words = words_of(line);
    if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
    if (words[0] == "end_header") {
      if (!has_format) complain(file, "the PLY header has no format line; export the file again");
      return header;
    }
    if (words[0] == "format" && words.size() == 3) {
      if (words[1] == "ascii") {
        header.format = Format::ascii;
      } else if (words[1] == "binary_little_endian") {
        header.format = Format::little_endian;
      } else if (words[1] == "binary_big_endian") {
        header.format = Format::big_endian;
      } else {
        complain(at_line(file, lines),
                 fmt::format("unknown PLY format \"{}\"; use ascii or binary_little_endian", shown(words[1])));
      }
      has_format = true;
    } else if (words[0] == "element" && words.size() == 3) {
      Element element{words[1], 0, {}};
      const auto [after, error] = std::from_chars(words[2].data(), words[2].data() + words[2].size(), element.count);
      if (error != std::errc() || *after != '\0') {
        complain(at_line(file, lines),
                 fmt::format("\"{}\" is not a number of elements; export the file again", shown(words[2])));
      }
      header.elements.push_back(std::move(element));
    } else if (words[0] == "property" && !header.elements.empty() && words.size() == 3) {
      header.elements.back().properties.push_back({words[2], kind_of(words[1], file, lines), false});
    } else if (words[0] == "property" && !header.elements.empty() && words.size() == 5 && words[1] == "list") {
      kind_of(words[2], file, lines);
      header.elements.back().properties.push_back({words[4], kind_of(words[3], file, lines), true});
    } else {
      complain(at_line(file, lines),
               fmt::format("not a line of a PLY header: \"{}\"; export the file again", shown(line)));
    }
  }
  complain(file, "the PLY header has no end_header; the file is truncated");
}

template <class T>
double number_at(const char* bytes, bool swap) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if (swap) std::reverse(raw.begin(), raw.end());
  return static_cast<double>(std::bit_cast<T>(raw));
}

double number_at(const char* bytes, Kind kind, bool swap) {
  switch (kind) {
    case Kind::i8:
      return number_at<std::int8_t>(bytes, swap);
    case Kind::u8:
      return number_at<std::uint8_t>(bytes, swap);
    case Kind::i16:
      return number_at<std::int16_t>(bytes, swap);
    case Kind::u16:
      return number_at<std::uint16_t>(bytes, swap);
    case Kind::i32:
      return number_at<std::int32_t>(bytes, swap);
    case Kind::u32:
      return number_at<std::uint32_t>(bytes, swap);
    case Kind::f32:
      return number_at<float>(bytes, swap);
    case Kind::f64:
      return number_at<double>(bytes, swap);
  }
  throw std::logic_error("broken contract: a PLY number has one of eight types");
}

/// Which property of a vertex is x, y and z.
std::array<std::size_t, 3> coordinates_of(const Element& vertex, const std::string& file) {
  std::array<std::size_t, 3> index{};
  const std::array<std::string_view, 3> names{"x", "y", "z"};
  for (std::size_t c = 0; c < 3; ++c) {
    const auto found = std::find_if(vertex.properties.begin(), vertex.properties.end(),
                                    [&](const Property& p) { return p.name == names[c]; });
    if (found == vertex.properties.end())
      complain(file, fmt::format("the PLY vertices have no property {}; export x, y, z", names[c]));
    index[c] = static_cast<std::size_t>(found - vertex.properties.begin());
  }
  return index;
}

Points read_ascii_vertices(Lines& lines, const Header& header, const Element& vertex, const std::string& file) {
  const std::array<std::size_t, 3> index = coordinates_of(vertex, file);
  std::string_view line;
  const auto next_row = [&] {
    while (lines.next(line)) {
      if (!trimmed(line).empty()) return true;
    }
    return false;
  };
  for (const Element* before = header.elements.data(); before != &vertex; ++before) {
    for (std::size_t k = 0; k < before->count && next_row(); ++k) continue;
  }
  Points points;
  points.reserve(std::min(vertex.count, lines.rest().size() / 6 + 1));
  std::vector<double> row(vertex.properties.size());
  while (points.size() < vertex.count) {
    if (!next_row()) {
      complain(file, fmt::format("the PLY header announces {} vertices and the file ends after {}; it is truncated",
                                 vertex.count, points.size()));
    }
    const char* at = line.data();
    const char* const end = line.data() + line.size();
    for (std::size_t k = 0; k < row.size(); ++k) {
      // Only a coordinate must be finite: quality properties of scanner programs may hold nan.
      const bool wanted = k == index[0] || k == index[1] || k == index[2];
      bool there = false;
      if (wanted) {
        there = next_number(at, end, row[k], file, lines, line);
      } else {
        while (at != end && is_separator(*at)) ++at;
        there = at != end;
        while (at != end && !is_separator(*at)) ++at;
      }
      if (!there) {
        complain(at_line(file, lines),
                 fmt::format("a vertex needs {} numbers and this line has {}: \"{}\"; export the file again",
                             row.size(), k, shown(line)));
      }
    }
    points.emplace_back(row[index[0]], row[index[1]], row[index[2]]);
  }
  return points;
}

Points read_binary_vertices(std::string_view body, const Header& header, const Element& vertex,
                            const std::string& file) {
  const std::array<std::size_t, 3> index = coordinates_of(vertex, file);
  const bool swap = (header.format == Format::big_endian) == (std::endian::native == std::endian::little);
  const auto take = [&](const Element& element) {  // divides, because count times bytes could overflow
    if (element.row_bytes() != 0 && body.size() / element.row_bytes() < element.count) {
      complain(file,
               fmt::format("the PLY header announces {} elements \"{}\" of {} bytes and the body has room for {}; "
                           "the file is truncated",
                           element.count, shown(element.name), element.row_bytes(), body.size() / element.row_bytes()));
    }
    const std::string_view rows = body.substr(0, element.count * element.row_bytes());
    body.remove_prefix(rows.size());
    return rows;
  };
  for (const Element* before = header.elements.data(); before != &vertex; ++before) {
    if (before->has_list()) {
      complain(file,
               fmt::format("the PLY element \"{}\" with a list stands before the vertices; export the vertices first",
                           shown(before->name)));
    }
    take(*before);
  }
  const char* at = take(vertex).data();
  std::array<std::size_t, 3> offset{};
  std::array<Kind, 3> kind{};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t k = 0; k < index[c]; ++k) offset[c] += kSize[static_cast<std::size_t>(vertex.properties[k].kind)];
    kind[c] = vertex.properties[index[c]].kind;
  }
  Points points(vertex.count);
  for (std::size_t i = 0; i < points.size(); ++i, at += vertex.row_bytes()) {
    for (std::size_t c = 0; c < 3; ++c) points[i][static_cast<int>(c)] = number_at(at + offset[c], kind[c], swap);
    if (!points[i].allFinite()) {
      complain(
          file,
          fmt::format("vertex {} (counted from 1) is not a finite point; remove invalid points before fitting", i + 1));
    }
  }
  return points;
}

Points read_ply(std::string_view text, const std::string& file) {
  Lines lines(text);
  const Header header = read_header(lines, file);
  const auto vertex =
      std::find_if(header.elements.begin(), header.elements.end(), [](const Element& e) { return e.name == "vertex"; });
  if (vertex == header.elements.end())
    complain(file, "the PLY file has no element \"vertex\", so no points; export the points");
  if (vertex->has_list()) complain(file, "the PLY vertices have a list property, which is not read; export without it");
  if (header.format == Format::ascii) return read_ascii_vertices(lines, header, *vertex, file);
  return read_binary_vertices(lines.rest(), header, *vertex, file);
}

}  // namespace

std::vector<Eigen::Vector3d> read_points_mm(const std::filesystem::path& file, LengthUnit unit) {
  const std::string bytes = read_bytes(file);
  const std::string name = file.string();
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return std::tolower(c); });
  Points points;
  if (ending == ".xyz") {
    points = read_xyz(bytes, name);
  } else if (ending == ".ds") {
    points = read_ds(bytes, name);
  } else if (ending == ".ply") {
    points = read_ply(bytes, name);
  } else {
    complain(name, fmt::format("the ending \"{}\" is no point file's; use .xyz (x y z per line), .ds or .ply",
                               shown(ending)));
  }
  if (points.empty()) complain(name, "the file has no points; check the export");
  if (unit == LengthUnit::m) {
    for (Eigen::Vector3d& p : points) p *= 1000.0;
  }
  return points;
}

}  // namespace fringecal

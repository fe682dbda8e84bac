#include "calib/corner_files.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <sstream>

namespace fringecal::calib {
namespace {

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& sentence) {
  throw InputError(fmt::format("{}: {}", file.string(), sentence));
}

std::optional<double> number_in(const std::string& word) {
  double value = 0;
  const char* const end = word.data() + word.size();
  const auto [stop, error] = std::from_chars(word.data(), end, value);
  if (error != std::errc() || stop != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::vector<Eigen::Vector2d> pairs_of(const std::filesystem::path& file) {
  std::istringstream lines(read_bytes(file));
  std::string line, word;
  std::vector<double> numbers;
  for (int n = 1; std::getline(lines, line); ++n) {
    std::istringstream words(line.substr(0, line.find('#')));
    while (words >> word) {
      const auto value = number_in(word);
      if (!value) refuse(file, fmt::format("line {}: '{}' is not a number", n, word));
      numbers.push_back(*value);
    }
  }
  if (numbers.empty() || numbers.size() % 2 != 0) {
    refuse(file, fmt::format("{} numbers; x and y of each corner make an even number of them", numbers.size()));
  }
  std::vector<Eigen::Vector2d> out;
  for (std::size_t i = 0; i < numbers.size(); i += 2) out.emplace_back(numbers[i], numbers[i + 1]);
  return out;
}

/// Where the legend of a .vnl has each column.
struct Legend {
  std::size_t filename = 0, x = 1, y = 2;
};

Legend legend_of(const std::filesystem::path& file, const std::string& line) {
  std::istringstream words(line.substr(1));
  std::map<std::string, std::size_t> at;
  std::string word;
  for (std::size_t i = 0; words >> word; ++i) at.emplace(word, i);
  if (!at.contains("filename") || !at.contains("x") || !at.contains("y")) {
    refuse(file, "its legend '# filename x y ..' does not have these three columns");
  }
  return {at["filename"], at["x"], at["y"]};
}

struct Seen {
  std::string name;
  int line = 0;
  std::vector<std::optional<Eigen::Vector2d>> corners;
};

std::vector<Seen> read_vnl(const std::filesystem::path& file) {
  std::istringstream lines(read_bytes(file));
  std::string line;
  std::optional<Legend> legend;
  std::vector<Seen> out;
  for (int n = 1; std::getline(lines, line); ++n) {
    if (line.starts_with("##") || line.starts_with("#!") || line.find_first_not_of(" \t\r") == std::string::npos) {
      continue;
    }
    if (line.front() == '#') {
      if (!legend) legend = legend_of(file, line);
      continue;
    }
    if (!legend) refuse(file, fmt::format("line {}: a legend '# filename x y level' must come first", n));
    std::istringstream in(line.substr(0, line.find('#')));
    std::vector<std::string> words{std::istream_iterator<std::string>(in), std::istream_iterator<std::string>()};
    if (words.size() <= std::max({legend->filename, legend->x, legend->y})) {
      refuse(file, fmt::format("line {}: {} columns, fewer than the legend has", n, words.size()));
    }
    const std::string &name = words[legend->filename], &x = words[legend->x], &y = words[legend->y];
    if (out.empty() || out.back().name != name) out.push_back({name, n, {}});
    if (x == "-" || y == "-") {
      out.back().corners.emplace_back();
      continue;
    }
    const auto px = number_in(x), py = number_in(y);
    if (!px || !py) refuse(file, fmt::format("line {}: '{} {}' are not two numbers", n, x, y));
    out.back().corners.emplace_back(Eigen::Vector2d(*px, *py));
  }
  if (out.empty()) refuse(file, "no corners in it");
  return out;
}

}  // namespace

std::vector<Eigen::Vector2d> places_of(const model::Board& board) {
  std::vector<Eigen::Vector2d> out;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) out.push_back(board.corner_mm(column, row).head<2>());
  }
  return out;
}

std::vector<Eigen::Vector2d> read_places(const std::filesystem::path& file, double unit_mm) {
  auto out = pairs_of(file);
  for (auto& p : out) p *= unit_mm;
  return out;
}

std::vector<NamedView> read_corners(std::span<const std::filesystem::path> files,
                                    std::span<const Eigen::Vector2d> places_mm) {
  std::vector<NamedView> out;
  const auto add = [&](const std::filesystem::path& file, const Seen& seen) {
    if (seen.corners.size() == 1 && !seen.corners.front()) return;  // no board in this image
    if (seen.corners.size() != places_mm.size()) {
      refuse(file, fmt::format("line {}: {} corners of '{}', but the board has {}", seen.line, seen.corners.size(),
                               seen.name, places_mm.size()));
    }
    NamedView named{seen.name, {}};
    for (std::size_t i = 0; i < places_mm.size(); ++i) {
      if (!seen.corners[i]) continue;
      named.view.board_mm.push_back(places_mm[i]);
      named.view.pixels.push_back(*seen.corners[i]);
    }
    if (named.view.pixels.size() >= 4) out.push_back(std::move(named));
  };
  for (const auto& file : files) {
    if (file.extension() == ".vnl") {
      for (const Seen& seen : read_vnl(file)) add(file, seen);
    } else {
      const auto pairs = pairs_of(file);
      add(file, {file.filename().string(), 1, {pairs.begin(), pairs.end()}});
    }
  }
  return out;
}

}  // namespace fringecal::calib

// The rooms and who may include whom, read from the #include lines of the tree; file sizes; third-party types at the
// door.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
const fs::path kRoot = FRINGECAL_SOURCE_DIR;

// Longest prefix first: calib/model is a room of its own inside calib.
const std::vector<std::string> kRooms = {"calib/decode", "calib/model", "hw/virtual", "calib",     "cli",
                                         "core",         "fitting",     "hw",         "metrology", "reports"};

const std::map<std::string, std::set<std::string>> kMayInclude = {
    {"core", {"core"}},
    {"fitting", {"fitting", "core"}},
    {"calib/model", {"calib/model", "core"}},
    {"calib/decode", {"calib/decode", "calib/model", "core"}},
    {"calib", {"calib", "calib/model", "calib/decode", "fitting", "core"}},
    {"hw", {"hw", "core"}},
    {"hw/virtual", {"hw/virtual", "hw", "calib/model", "core"}},
    {"metrology", {"metrology", "calib/model", "calib/decode", "fitting", "core"}},
    {"reports", {"reports", "metrology", "calib", "calib/model", "calib/decode", "fitting", "core"}},
    {"cli",
     {"cli", "reports", "metrology", "calib", "calib/model", "calib/decode", "hw", "hw/virtual", "fitting", "core"}},
};

std::string room_of(const std::string& path) {
  for (const auto& room : kRooms) {
    if (path.starts_with(room + "/")) return room;
  }
  return "";
}

struct Include {
  std::string file, target;
  bool quoted;
};

std::vector<fs::path> sources() {
  std::vector<fs::path> out;
  for (const auto* room : {"core", "fitting", "calib", "hw", "metrology", "reports", "cli"}) {
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / room)) {
      const auto ending = entry.path().extension();
      if (ending == ".h" || ending == ".cpp") out.push_back(entry.path());
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

std::vector<Include> includes() {
  static const std::regex pattern(R"re(^\s*#\s*include\s*([<"])([^>"]+)[>"])re");
  std::vector<Include> out;
  for (const auto& file : sources()) {
    std::ifstream in(file);
    std::string line;
    std::smatch match;
    while (std::getline(in, line)) {
      if (std::regex_search(line, match, pattern)) {
        out.push_back({fs::relative(file, kRoot).string(), match[2], match[1] == "\""});
      }
    }
  }
  return out;
}

TEST(Architecture, EveryRoomIncludesOnlyWhatItMay) {
  const auto all = includes();
  ASSERT_GT(all.size(), 50u);  // the tree was found
  for (const auto& include : all) {
    if (!include.quoted) continue;
    const std::string from = room_of(include.file), to = room_of(include.target);
    EXPECT_FALSE(to.empty()) << include.file << " includes \"" << include.target << "\", which is not root-relative";
    if (to.empty()) continue;
    EXPECT_TRUE(kMayInclude.at(from).contains(to)) << include.file << " (" << from << ") includes " << include.target;
  }
}

TEST(Architecture, ThirdPartyTypesStayInSourceFiles) {
  static const std::regex foreign(
      R"(^(opencv2|ceres|CGAL|arv|modbus|nlohmann|toml\+\+|httplib|libxml|xmlsec|qpdf|lcms2|mrcal|openssl|png|tiff|CLI|spdlog)\b)");
  for (const auto& include : includes()) {
    if (include.quoted || !include.file.ends_with(".h")) continue;
    EXPECT_FALSE(std::regex_search(include.target, foreign)) << include.file << " includes <" << include.target << ">";
  }
}

TEST(Architecture, SolversAndOpenCvStayInTheirRooms) {
  static const std::regex heavy(R"(^(opencv2|ceres|mrcal)\b)");
  for (const auto& include : includes()) {
    if (include.quoted || !std::regex_search(include.target, heavy)) continue;
    EXPECT_EQ(room_of(include.file), "calib") << include.file << " includes <" << include.target << ">";
  }
}

TEST(Architecture, TheWebsLibraryStaysWithItsServerAndItsClient) {
  // Its header is large; everything else sees cli/serve/http.h and reports/http_post.h.
  for (const auto& include : includes()) {
    if (include.target != "httplib.h") continue;
    EXPECT_TRUE(include.file == "cli/serve/http.cpp" || include.file == "reports/http_post.cpp") << include.file;
  }
}

TEST(Architecture, NoFileIsOver600Lines) {
  for (const auto& file : sources()) {
    std::ifstream in(file);
    const auto lines = std::count(std::istreambuf_iterator<char>(in), {}, '\n');
    EXPECT_LE(lines, 600) << fs::relative(file, kRoot);
  }
}

TEST(Architecture, EveryFileSaysWhatItIsFor) {
  for (const auto& file : sources()) {
    if (file.extension() != ".h") continue;
    std::ifstream in(file);
    std::string first;
    std::getline(in, first);
    EXPECT_TRUE(first.starts_with("// ")) << fs::relative(file, kRoot) << " does not start with its purpose";
  }
}

}  // namespace

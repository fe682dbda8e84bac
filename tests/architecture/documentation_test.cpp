// README and docs: every relative link leads somewhere, and every command and option that a code block shows exists.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
const fs::path kRoot = FRINGECAL_SOURCE_DIR;

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<fs::path> pages() {
  std::vector<fs::path> out;
  for (const auto* folder : {"", "docs", "hw", "reports", "tests"}) {
    for (const auto& entry : fs::directory_iterator(kRoot / folder)) {
      if (entry.path().extension() == ".md") out.push_back(entry.path());
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Calls of the program in code blocks (indented or fenced) and in `...`; a line that ends in \ goes on in the next.
std::vector<std::string> calls_in(const fs::path& page) {
  static const std::regex in_block(R"re(^(?:    \s*|\$ )(?:\S*/)?(fringecal [a-z].*)$)re"),
      in_line(R"re(`(fringecal [a-z][^`]*)`)re");
  std::vector<std::string> out;
  std::istringstream lines(text_of(page));
  std::string line, next;
  while (std::getline(lines, line)) {
    while (line.ends_with('\\') && std::getline(lines, next)) line.replace(line.size() - 1, 1, next);
    std::smatch match;
    if (std::regex_match(line, match, in_block)) out.push_back(match[1]);
    for (std::sregex_iterator i(line.begin(), line.end(), in_line), end; i != end; ++i) out.push_back((*i)[1]);
  }
  return out;
}

/// Source text of the file that defines a command, by the command's name; subcommands of commands as well.
std::map<std::string, std::string> commands() {
  static const std::regex definition(R"re(add_subcommand\(\s*"([a-z-]+)")re");
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(kRoot / "cli")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = text_of(entry.path());
    for (std::sregex_iterator i(text.begin(), text.end(), definition), end; i != end; ++i) out[(*i)[1]] += text;
  }
  return out;
}

TEST(Documentation, EveryRelativeLinkResolves) {
  static const std::regex link(R"re(\]\(([^)#\s]+)(?:#[^)]*)?\))re");
  int links = 0;
  for (const auto& page : pages()) {
    const std::string text = text_of(page);
    for (std::sregex_iterator i(text.begin(), text.end(), link), end; i != end; ++i) {
      const std::string target = (*i)[1];
      if (target.find("://") != std::string::npos) continue;
      ++links;
      EXPECT_TRUE(fs::exists(page.parent_path() / target)) << fs::relative(page, kRoot) << " links to " << target;
    }
  }
  EXPECT_GT(links, 50);  // the pages were found
}

TEST(Documentation, EveryCommandAndOptionShownExists) {
  static const std::regex word(R"re(^fringecal ([a-z-]+))re"), option(R"re(\s(--[a-z][a-z0-9-]*))re");
  const auto known = commands();
  int calls = 0;
  for (const auto& page : pages()) {
    for (const auto& call : calls_in(page)) {
      ++calls;
      std::smatch match;
      ASSERT_TRUE(std::regex_search(call, match, word)) << call;
      const auto command = known.find(match[1]);
      if (command == known.end()) {
        ADD_FAILURE() << fs::relative(page, kRoot) << ": no such command: " << call;
        continue;
      }
      for (std::sregex_iterator i(call.begin(), call.end(), option), end; i != end; ++i) {
        const std::string name = (*i)[1];
        const std::regex defined("[\",!]" + name + "[\",{]");
        EXPECT_TRUE(name == "--help" || std::regex_search(command->second, defined))
            << fs::relative(page, kRoot) << ": " << match[1] << " has no option " << name << ": " << call;
      }
    }
  }
  EXPECT_GT(calls, 30);
}

}  // namespace

// What a newcomer leans on: the help of every command, the manual page, the completion of the shell.
#include "tests/support/other_programs.h"
#include "tests/support/program.h"
#include "tests/support/sanitizers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace fringecal::test {
namespace {

using testing::HasSubstr;

/// Names in the list of commands that `fringecal [WORDS] --help` prints.
std::vector<std::string> commands_below(const std::vector<std::string>& words) {
  auto arguments = words;
  arguments.push_back("--help");
  std::istringstream help(run_fringecal(arguments).output);
  std::vector<std::string> out;
  bool listed = false;
  for (std::string line; std::getline(help, line);) {
    if (line.starts_with("Subcommands:") || line.starts_with("SUBCOMMANDS:")) {
      listed = true;
    } else if (listed) {
      std::smatch name;
      if (std::regex_search(line, name, std::regex("^  ([a-z-]+)"))) out.push_back(name[1]);
    }
  }
  return out;
}

TEST(Help, OfEveryCommandHasACallThatTheProgramCanParse) {
  const auto commands = commands_below({});
  ASSERT_GE(commands.size(), 20U);
  for (const auto& command : commands) {
    const ProgramResult help = run_fringecal({command, "--help"});
    EXPECT_EQ(help.exit_code, 0) << command;
    EXPECT_THAT(help.errors, testing::IsEmpty()) << command;
    if (!commands_below({command}).empty()) continue;  // the example stands with the commands below
    std::smatch call;
    ASSERT_TRUE(std::regex_search(help.output, call, std::regex("Examples?:\\s+fringecal ([a-z-]+)([^\n]*)")))
        << command << " has no example:\n"
        << help.output;
    EXPECT_EQ(call[1], command);
    // Every option of the example is one that the help lists.
    const std::string rest = call[2];
    const std::regex option("(^| )(--?[a-z][a-z-]*)");
    for (auto o = std::sregex_iterator(rest.begin(), rest.end(), option); o != std::sregex_iterator(); ++o) {
      const std::string tail = rest.substr(0, static_cast<std::size_t>(o->position()));
      if (tail.find('|') != std::string::npos) break;  // another program's
      EXPECT_THAT(help.output, HasSubstr((*o)[2].str())) << command << ": " << (*o)[2].str();
    }
  }
}

TEST(Help, StartsWithinFiftyMilliseconds) {
  if (test::kSanitized) GTEST_SKIP() << "a sanitizer slows the program down";
  // Of the processor's time: how long others keep it from us is not ours. The least of nine.
  const auto used_ms = [] {
    rusage r{};
    ::getrusage(RUSAGE_CHILDREN, &r);
    return 1e3 * static_cast<double>(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
           1e-3 * static_cast<double>(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
  };
  double best_ms = 1e9;
  for (int i = 0; i < 9; ++i) {
    const double before = used_ms();
    ASSERT_EQ(run_fringecal({"--help"}).exit_code, 0);
    best_ms = std::min(best_ms, used_ms() - before);
  }
  EXPECT_LT(best_ms, 50.0);
}

TEST(Manual, NamesEveryCommandAndIsCleanTroff) {
  const ProgramResult page = run_fringecal({"man"});
  ASSERT_EQ(page.exit_code, 0);
  for (const auto& command : commands_below({})) {
    EXPECT_THAT(page.output, HasSubstr("\n.SS \"fringecal " + std::regex_replace(command, std::regex("-"), "\\-")))
        << command;
  }
  if (!installed("groff")) GTEST_SKIP() << "groff is not installed: the page is not set";
  TemporaryFolder folder;
  std::ofstream(folder.path() / "fringecal.1") << page.output;
  const auto set = run_in_shell("groff -man -Tutf8 -ww " + (folder.path() / "fringecal.1").string() + " >/dev/null");
  EXPECT_EQ(set.status, 0);
  EXPECT_THAT(set.output, testing::IsEmpty());
}

TEST(Completion, IsAcceptedByBashAndOffersCommandsAndOptions) {
  const ProgramResult script = run_fringecal({"completion", "bash"});
  ASSERT_EQ(script.exit_code, 0);
  TemporaryFolder folder;
  std::ofstream(folder.path() / "fringecal") << script.output;
  const auto offered = [&](const std::string& line, int word) {
    return run_in_shell("bash -c 'source " + (folder.path() / "fringecal").string() + "; COMP_WORDS=(" + line +
                        "); COMP_CWORD=" + std::to_string(word) +
                        "; _fringecal; printf \"%s\\n\" \"${COMPREPLY[@]}\"'");
  };
  EXPECT_THAT(offered("fringecal certi", 1).output, HasSubstr("certify\n"));
  EXPECT_THAT(offered("fringecal certify --out", 2).output, HasSubstr("--output\n"));
  EXPECT_THAT(offered("fringecal dcc re", 2).output, HasSubstr("read\n"));
}

TEST(Completion, RefusesAnUnknownShell) {
  const ProgramResult result = run_fringecal({"completion", "fish"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.errors, HasSubstr("bash"));
}

TEST(Root, IsToldThatNoCommandNeedsIt) {
  if (geteuid() != 0) GTEST_SKIP() << "not run as root";
  const std::string program = FRINGECAL_PROGRAM;
  EXPECT_THAT(run_in_shell("env -u FRINGECAL_ROOT_IS_MEANT " + program + " plan").output, HasSubstr("running as root"));
  EXPECT_THAT(run_in_shell("env -u FRINGECAL_ROOT_IS_MEANT " + program + " --help").output,
              testing::Not(HasSubstr("running as root")));
}

TEST(Files, ThatAreWrittenAreNotForEverybodyToWrite) {
  TemporaryFolder folder;
  run_in_shell("umask 0; cd " + folder.path().string() + "; " + FRINGECAL_PROGRAM +
               " render --scene \"plane 0\" -o capture");
  int seen = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path())) {
    EXPECT_EQ(entry.status().permissions() & std::filesystem::perms::others_write, std::filesystem::perms::none)
        << entry.path();
    ++seen;
  }
  EXPECT_GT(seen, 5);
}

}  // namespace
}  // namespace fringecal::test

// Programs that are not ours, through the shell: the independent clients of the protocols.
#pragma once

#include <array>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace fringecal::test {

inline bool installed(const std::string& program) {
  return std::system(("command -v " + program + " >/dev/null").c_str()) == 0;
}

struct ShellOutcome {
  int status = -1;
  std::string output;  // of both kinds
};

inline ShellOutcome run_in_shell(const std::string& command) {
  ShellOutcome outcome;
  std::FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  if (!pipe) return outcome;
  std::array<char, 512> part{};
  while (std::fgets(part.data(), part.size(), pipe)) outcome.output += part.data();
  outcome.status = ::pclose(pipe);
  return outcome;
}

}  // namespace fringecal::test

// Tests of this very program again in a network namespace with loopback alone.
#pragma once

#include "tests/support/other_programs.h"
#include "tests/support/program.h"

#include <filesystem>
#include <string>

namespace fringecal::test {

/// Whether this machine permits it; a test without it skips by name.
inline bool network_namespaces() {
  return installed("unshare") && installed("ip") && run_in_shell("unshare -rn ip link set lo up").status == 0;
}

/// Output of the tests that the filter names, and then of a shell command in the same namespace; the tests' exit code.
inline auto run_in_loopback_only(const std::string& filter, const std::string& then = "true") {
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  const ScratchFolder folder;
  const auto script = folder.write("run", "ip link set lo up\n'" + self + "' --gtest_filter='" + filter +
                                              "' 2>&1\nended=$?\n" + then + "\nexit $ended\n");
  return run_in_shell("unshare -rn sh '" + script.string() + "'");
}

}  // namespace fringecal::test

// Runs another program as a filter: arguments as a list (no shell), text in, text out, with a time limit.
#pragma once

#include <chrono>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal::reports {

struct FilterOutput {
  int status = 0;  // exit status; 128 + signal where it was killed by one
  std::string output, errors;
};

/// arguments[0] is looked up in PATH. The program gets LC_ALL=C.UTF-8 and PATH and no other environment.
/// Throws EnvironmentError: not found (the sentence ends with `advice`), cannot be started, longer than `limit` (then
/// it is killed).
FilterOutput run_filter(const std::vector<std::string>& arguments, std::string_view input, std::chrono::seconds limit,
                        const std::string& advice);

}  // namespace fringecal::reports

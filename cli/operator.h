// The person at the machine: is told what to do, and says when it is done.
//
// What to do goes to stderr as one line, ">> Put the flat board ...: Enter when done", the answer is a line of standard
// input. Nobody there (end of input) or Ctrl-C: hw::CaptureStopped; the same command asks again.
#pragma once

#include <stop_token>
#include <string>

namespace fringecal::cli {

class Operator {
 public:
  explicit Operator(std::stop_token stop) : stop_(std::move(stop)) {}
  /// Returns when the operator has answered.
  void ask(const std::string& what) const;

 private:
  std::stop_token stop_;
};

}  // namespace fringecal::cli

// The exceptions of the program and their exit codes. Caught once, in cli/main.cpp.
#pragma once

#include <stdexcept>
#include <string>

namespace fringecal {

/// What the user handed over cannot be used (a missing, damaged or contradictory file; a wrong option).
/// The sentence names the file, the number and what to do. Exit code 2.
struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The machine failed (disk full, no permission to write, a program or device that is not there). Exit code 3.
struct EnvironmentError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A broken contract between two pieces of this program; checked in every build.
inline void require(bool holds, const char* contract) {
  if (!holds) throw std::logic_error(std::string("broken contract: ") + contract);
}

}  // namespace fringecal

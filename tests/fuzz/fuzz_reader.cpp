// One reader under libFuzzer: coverage-guided bytes, address and undefined-behaviour sanitizers. Run by ./dev fuzz.
//   FRINGECAL_READER=NAME [FRINGECAL_SECONDS=N] fuzz_reader CORPUS... [libFuzzer's options]
//                                      NAME: of tests/fuzz/readers.cpp, in the environment because libFuzzer starts itself
//                                      again with arguments of its own; N: of processor time, or of the clock for readers
//                                      that wait for a device; then it says what it has spent and ends
//   fuzz_reader --list                 the names, one per line
//   fuzz_reader --examples FOLDER      writes the reader's sound examples into the folder
#include "tests/fuzz/readers.h"

#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <string>

namespace {

using fringecal::test::Reader;
using Clock = std::chrono::steady_clock;

std::string setting(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

/// Folder and readers live until the program ends: libFuzzer calls back.
const std::filesystem::path& folder() {
  static const fringecal::test::TemporaryFolder temporary(fringecal::test::memory_folder());
  return temporary.path();
}
const std::vector<Reader>& all() {
  static const std::vector<Reader> readers = fringecal::test::readers(folder());
  return readers;
}

const Reader& chosen() {
  const std::string name = setting("FRINGECAL_READER");
  const auto found = std::find_if(all().begin(), all().end(), [&](const Reader& one) { return one.name == name; });
  if (found == all().end()) {
    fmt::print(stderr, "fuzz_reader: FRINGECAL_READER is '{}', no reader; --list names them\n", name);
    std::exit(2);
  }
  return *found;
}

/// Ends the program when its time is over; quietly, as libFuzzer takes an exit for a finding.
void end_in_time(bool is_device) {
  static const double limit_s = std::strtod(setting("FRINGECAL_SECONDS").c_str(), nullptr);
  static const Clock::time_point begin = Clock::now();
  static std::uint64_t executions = 0;
  ++executions;
  if (!(limit_s > 0)) return;
  const double cpu_s = static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
  const double wall_s = std::chrono::duration<double>(Clock::now() - begin).count();
  if ((is_device ? wall_s : cpu_s) < limit_s) return;
  fmt::print(stderr, "\nspent {:.0f} s of processor time, {:.0f} s by the clock, {} inputs\n", cpu_s, wall_s,
             executions);
  std::error_code ignored;
  std::filesystem::remove_all(folder(), ignored);
  std::_Exit(0);
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* count, char*** words) {
  const std::string first = *count > 1 ? (*words)[1] : "";
  if (first == "--list") {
    for (const Reader& one : all()) fmt::print("{}\n", one.name);
    std::exit(0);
  }
  const Reader& reader = chosen();
  if (first == "--examples" && *count == 3) {
    for (std::size_t k = 0; k < reader.examples.size(); ++k) {
      fringecal::write_atomically(std::filesystem::path((*words)[2]) / fmt::format("example-{}", k),
                                  reader.examples[k]);
    }
    std::exit(0);
  }
  return 0;
}

/// A finding is whatever comes out of read(): an exception that is no answer to bad input ends the program.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const Reader& reader = chosen();
  reader.read(std::string_view(reinterpret_cast<const char*>(bytes), size));
  end_in_time(reader.is_device);
  return 0;
}

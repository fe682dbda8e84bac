// One reader under libFuzzer: coverage-guided bytes, address and undefined-behaviour sanitizers. Run by ./dev fuzz.
//   fuzz_reader READER CORPUS... [libFuzzer's options]     READER: a name of tests/fuzz/readers.cpp
//   fuzz_reader --list                                     the names, one per line
//   fuzz_reader --examples READER FOLDER                   writes the reader's sound examples into the folder
#include "tests/fuzz/readers.h"

#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>

namespace {

using fringecal::test::Reader;

/// Lives until the program ends: libFuzzer calls back.
const Reader* reader = nullptr;

const Reader& reader_named(const std::string& name) {
  static const fringecal::test::TemporaryFolder folder(fringecal::test::memory_folder());
  static const std::vector<Reader> all = fringecal::test::readers(folder.path());
  if (name == "--list") {
    for (const Reader& one : all) fmt::print("{}\n", one.name);
    std::exit(0);
  }
  const auto found = std::find_if(all.begin(), all.end(), [&](const Reader& one) { return one.name == name; });
  if (found == all.end()) {
    fmt::print(stderr, "fuzz_reader: there is no reader '{}'; --list names them\n", name);
    std::exit(2);
  }
  return *found;
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* count, char*** words) {
  const std::string first = *count > 1 ? (*words)[1] : "";
  if (first == "--examples" && *count == 4) {
    const Reader& one = reader_named((*words)[2]);
    for (std::size_t k = 0; k < one.examples.size(); ++k) {
      fringecal::write_atomically(std::filesystem::path((*words)[3]) / fmt::format("example-{}", k), one.examples[k]);
    }
    std::exit(0);
  }
  reader = &reader_named(first);
  std::copy(*words + 2, *words + *count, *words + 1);  // libFuzzer sees the rest
  --*count;
  return 0;
}

/// A finding is whatever comes out of read(): an exception that is no answer to bad input ends the program.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  reader->read(std::string_view(reinterpret_cast<const char*>(bytes), size));
  return 0;
}

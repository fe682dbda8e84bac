// Damaged bytes into every reader: each is read or refused with an InputError, soon; nothing else comes out. Under
// ./dev asan no byte outside of them is touched either. FRINGECAL_LONG=1: 200 000 pieces per reader instead of 400.
#include "tests/fuzz/readers.h"

#include "calib/align_record.h"
#include "core/file.h"
#include "metrology/symptoms.h"
#include "tests/support/long_tests.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <ctime>
#include <set>

namespace fringecal::test {
namespace {

std::string shown(std::string_view bytes) {
  std::string out;
  for (const char c : bytes.substr(0, 600)) out += c >= ' ' && c < 127 ? std::string(1, c) : c == '\n' ? "\\n" : "?";
  return out;
}

/// Those two stand beside solvers, which ./dev fuzz does not compile.
std::vector<Reader> all_readers(const std::filesystem::path& folder) {
  std::vector<Reader> out = readers(folder);
  calib::AlignmentIteration iteration;
  iteration.capture = "first";
  iteration.measured.theta_rad = {0.001, 1e-5};
  out.push_back(of_file(folder / "alignment.json", {to_json(calib::record_of(std::vector{iteration}))},
                        [](const std::filesystem::path& file) { calib::read_record(file); }));
  const metrology::Baseline baseline{
      .modulation = 90, .scatter_mm = 0.03, .temperature_degC = 20.5, .date = "2026-01-01"};
  out.push_back(of_file(folder / "baseline.json", {to_json(metrology::to_value(baseline))},
                        [](const std::filesystem::path& file) { metrology::read_baseline(file); }));
  return out;
}

TEST(Readers, TakeTheirSoundExamples) {
  const TemporaryFolder folder(memory_folder());
  for (const Reader& reader : all_readers(folder.path())) {
    for (const std::string& example : reader.examples) {
      EXPECT_NO_THROW(reader.read_sound(example)) << reader.name << ": " << shown(example);
    }
  }
}

/// A file of a few kilobytes is read in a millisecond; a second of processor time is a hang on any machine.
constexpr double kMostSeconds = 1.0;

void expect_read_or_refused(const Reader& reader, std::string_view bytes, const std::string& piece) {
  const std::clock_t before = std::clock();
  try {
    reader.read(bytes);
  } catch (const std::exception& e) {
    ADD_FAILURE() << reader.name << ", " << piece << ": " << e.what() << "\n" << shown(bytes);
  }
  const double seconds = static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC;
  EXPECT_LT(seconds, kMostSeconds) << reader.name << ", " << piece << "\n" << shown(bytes);
}

// tests/fuzz/corpus/READER: what libFuzzer found worth keeping, and the inputs of mended defects under names of their own.
TEST(Readers, ReadOrRefuseTheKeptCorpus) {
  const TemporaryFolder folder(memory_folder());
  const std::filesystem::path corpus = std::filesystem::path(FRINGECAL_SOURCE_DIR) / "tests/fuzz/corpus";
  std::set<std::string> kept;
  for (const auto& entry : std::filesystem::directory_iterator(corpus)) kept.insert(entry.path().filename());
  for (const Reader& reader : all_readers(folder.path())) {
    if (kept.erase(reader.name) == 0) continue;
    std::set<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(corpus / reader.name)) files.insert(entry.path());
    for (const auto& file : files) expect_read_or_refused(reader, read_bytes(file), file.filename());
  }
  EXPECT_TRUE(kept.empty()) << "a corpus without a reader: " << *kept.begin();
}

TEST(Readers, ReadOrRefuseWhateverIsDamaged) {
  const TemporaryFolder folder(memory_folder());
  for (const Reader& reader : all_readers(folder.path())) {
    const std::uint64_t pieces = (long_tests() ? 200'000 : 400) / (reader.is_device ? 10 : 1);
    for (std::uint64_t number = 0; number < pieces; ++number) {
      const std::string bytes = damaged(reader.examples[number % reader.examples.size()], number);
      expect_read_or_refused(reader, bytes, "piece " + std::to_string(number));
    }
  }
}

}  // namespace
}  // namespace fringecal::test

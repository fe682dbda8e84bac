// The register map as the document has it and as the program has it.
#include "hw/plc_map.h"

#include "core/file.h"
#include "hw/plc.h"
#include "hw/virtual/plc_core.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace fringecal::hw {
namespace {

using Row = std::vector<std::string>;

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(' '), last = text.find_last_not_of(' ');
  return first == std::string::npos ? "" : text.substr(first, last - first + 1);
}

/// The rows of all tables whose first column has this heading.
std::vector<Row> rows_of_tables(const std::string& heading) {
  std::istringstream in(read_bytes(std::filesystem::path(FRINGECAL_SOURCE_DIR) / "hw" / "plc_map.md"));
  std::vector<Row> rows;
  std::string line;
  bool inside = false;
  while (std::getline(in, line)) {
    if (!line.starts_with("|")) {
      inside = false;
      continue;
    }
    Row cells;
    std::istringstream cut(line.substr(1));
    for (std::string cell; std::getline(cut, cell, '|');) cells.push_back(trimmed(cell));
    if (cells[0] == heading) {
      inside = true;
    } else if (inside && !cells[0].starts_with("---")) {
      rows.push_back(cells);
    }
  }
  return rows;
}

TEST(PlcMap, TheDocumentAndTheProgramHaveTheSameRegisters) {
  const auto rows = rows_of_tables("register");
  ASSERT_EQ(rows.size(), kPlcRegisters.size());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const PlcRegister& r = kPlcRegisters[k];
    ASSERT_EQ(rows[k].size(), 6u) << rows[k][0];
    EXPECT_EQ(rows[k][0], "DT" + std::to_string(r.address));
    EXPECT_EQ(rows[k][1], r.name);
    EXPECT_EQ(rows[k][2], r.type);
    EXPECT_EQ(rows[k][3], r.unit);
    EXPECT_EQ(rows[k][4], r.access);
    EXPECT_FALSE(rows[k][5].empty()) << r.name;
  }
}

TEST(PlcMap, TheDocumentAndTheProgramHaveTheSameFaultCodes) {
  const auto rows = rows_of_tables("code");
  ASSERT_EQ(rows.size(), kFaultWords.size());
  for (std::size_t k = 0; k < rows.size(); ++k) {
    EXPECT_EQ(rows[k][0], std::to_string(k));
    EXPECT_EQ(rows[k][1], kFaultWords[k]);
  }
  EXPECT_NE(fault_words(99).find("does not list"), std::string_view::npos);
}

TEST(PlcMap, NoTwoRegistersShareAWordAndTheStatusIsOneBlock) {
  std::set<int> used;
  for (const PlcRegister& r : kPlcRegisters) {
    for (int k = 0; k < r.words(); ++k) {
      EXPECT_TRUE(used.insert(r.address + k).second) << r.name;
      EXPECT_LT(r.address + k, dt::kEnd);
    }
  }
  for (int k = 0; k < dt::kStatusWords; ++k) EXPECT_TRUE(used.contains(k)) << k;
}

TEST(PlcMap, EveryReadableRegisterExistsInTheVirtualPlcAndOnlyTheWritableOnesCanBeWritten) {
  virt::PlcCore core;
  for (const PlcRegister& r : kPlcRegisters) {
    std::vector<std::uint16_t> words(static_cast<std::size_t>(r.words()));
    EXPECT_TRUE(core.read(r.address, words)) << r.name;
    EXPECT_EQ(core.write(r.address, words), r.writable()) << r.name;
  }
  std::vector<std::uint16_t> two(2);
  EXPECT_FALSE(core.read(dt::kEnd - 1, two));
  EXPECT_FALSE(core.write(dt::kWatchdog, two)) << "DT26 is not in the map";
}

TEST(PlcMap, A32BitValueHasItsLowWordFirstAndKeepsItsSign) {
  EXPECT_EQ(low_word(0x00012345), 0x2345);
  EXPECT_EQ(high_word(0x00012345), 0x0001);
  for (const std::int32_t v : {0, 1, -1, 65536, -65537, 2147483647, -2147483647}) {
    EXPECT_EQ(int32_from(low_word(v), high_word(v)), v);
  }
}

}  // namespace
}  // namespace fringecal::hw

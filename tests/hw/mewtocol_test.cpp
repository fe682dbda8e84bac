// MEWTOCOL-COM frames against published examples, and what is refused.
#include "hw/mewtocol.h"

#include "hw/virtual/mewtocol_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

namespace fringecal::hw::mewtocol {
namespace {

using testing::HasSubstr;

// Reference: the manufacturer's examples of RD, RCS, WCS and WD with their block check characters.
TEST(Mewtocol, FramesAreThoseOfTheProtocolDescription) {
  EXPECT_EQ(encode({1, FrameKind::command, read_registers(1105, 3)}), "%01#RDD011050110757\r");
  EXPECT_EQ(encode({1, FrameKind::command, read_contact("X000A")}), "%01#RCSX000A6C\r");
  EXPECT_EQ(encode({1, FrameKind::command, write_contact("Y000A", true)}), "%01#WCSY000A159\r");
  const std::array<std::uint16_t, 2> words = {100, 0};
  EXPECT_EQ(encode({1, FrameKind::command, write_registers(400, words)}), "%01#WDD00400004016400000053\r");
}

TEST(Mewtocol, WordsGoLowByteFirst) {
  const std::array<std::uint16_t, 3> words = {0x0064, 0x1234, 0xFFFE};
  EXPECT_EQ(words_to_hex(words), "64003412FEFF");
  EXPECT_THAT(words_from_hex("64003412FEFF"), testing::ElementsAreArray(words));
}

TEST(Mewtocol, DecodeIsTheInverseOfEncode) {
  const Frame frame = decode(encode({7, FrameKind::answer, "RD63004433"}));
  EXPECT_EQ(frame.station, 7);
  EXPECT_EQ(frame.kind, FrameKind::answer);
  EXPECT_EQ(frame.text, "RD63004433");
  EXPECT_EQ(decode("%01#RCSX000A**\r").text, "RCSX000A") << "without a block check";
}

TEST(Mewtocol, ADamagedFrameIsRefusedWhateverCharacterWasHit) {
  const std::string whole = "%01#RDD011050110757\r";
  for (std::size_t k = 0; k + 1 < whole.size(); ++k) {
    std::string damaged = whole;
    damaged[k] = static_cast<char>(damaged[k] ^ 0x01);  // one bit on the line
    EXPECT_THROW(decode(damaged), MewtocolError) << damaged;
  }
}

TEST(Mewtocol, AFrameHasAtMost118Characters) {
  const std::vector<std::uint16_t> most(kMostWordsWritten, 0x5A5A);
  EXPECT_LE(encode({1, FrameKind::command, write_registers(0, most)}).size(), kMostCharacters);
  EXPECT_LE(encode({1, FrameKind::answer, "RD" + std::string(4 * kMostWordsRead, '0')}).size(), kMostCharacters);
  EXPECT_THROW(write_registers(0, std::vector<std::uint16_t>(kMostWordsWritten + 1)), std::logic_error);
  EXPECT_THROW(read_registers(0, static_cast<int>(kMostWordsRead) + 1), std::logic_error);
  EXPECT_THROW(decode("%01$RD" + std::string(120, '0') + "00\r"), MewtocolError);
}

TEST(Mewtocol, RefusalsAreSaidInWords) {
  EXPECT_THAT(refusal_words("40"), HasSubstr("BCC"));
  EXPECT_THAT(refusal_words("53"), HasSubstr("busy"));
  EXPECT_THAT(refusal_words("99"), HasSubstr("does not list"));
}

TEST(VirtualMewtocolStation, AnswersAndRefusesWithTheProtocolsCodes) {
  virt::PlcCore core;
  EXPECT_EQ(virt::answer_mewtocol(core, "RDD0000000000"), "$RD0100");
  EXPECT_EQ(virt::answer_mewtocol(core, "WDD00024000242C01"), "$WD");
  EXPECT_EQ(virt::answer_mewtocol(core, "RDD0002400024"), "$RD2C01");
  EXPECT_EQ(virt::answer_mewtocol(core, "RCSX0000"), "$RC1");
  EXPECT_EQ(virt::answer_mewtocol(core, "WCSY00001"), "$WC");
  EXPECT_EQ(virt::answer_mewtocol(core, "RCSY0000"), "$RC1");
  EXPECT_EQ(virt::answer_mewtocol(core, "WCSX00001"), "!60") << "an input";
  EXPECT_EQ(virt::answer_mewtocol(core, "XX"), "!42");
  EXPECT_EQ(virt::answer_mewtocol(core, "RDL0000000000"), "!60");
  EXPECT_EQ(virt::answer_mewtocol(core, "RDD000000000Z"), "!61");
  EXPECT_EQ(virt::answer_mewtocol(core, "RDD0000100000"), "!61") << "last before first";
  EXPECT_EQ(virt::answer_mewtocol(core, "RDD0000000099"), "!61") << "more than a frame carries";
  EXPECT_EQ(virt::answer_mewtocol(core, "WDD0000000000FFFF"), "!61") << "not to be written";
  EXPECT_EQ(virt::answer_mewtocol(core, "WDD0002400024ZZ00"), "!61");
}

}  // namespace
}  // namespace fringecal::hw::mewtocol

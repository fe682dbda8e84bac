// Value, Fields and the atomic file: what every document of the program stands on.
#include "core/error.h"
#include "core/fields.h"
#include "core/file.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace fringecal {
namespace {

using test::entries_in;
using test::message_of;
using test::TemporaryFolder;
using testing::AllOf;
using testing::HasSubstr;

Fields fields_of(const std::string& toml) { return Fields(parse_toml(toml, "plan.toml"), "plan.toml"); }

TEST(Value, NumbersReadBackToTheSameDouble) {
  for (const double x : {0.1, 1.0 / 3.0, 6.02214076e23, -1e-300, 5e-324, std::numeric_limits<double>::max(), 12.0}) {
    const Value back = parse_json(to_json(Value::object().set("x", x)), "a");
    ASSERT_NE(back.find("x")->if_real(), nullptr) << x;  // 12.0 stays a real, not the integer 12
    EXPECT_EQ(*back.find("x")->if_real(), x);
  }
}

TEST(Value, KeysKeepTheirOrderAndTextItsCharacters) {
  const std::string json = to_json(Value::object().set("z", 1).set("a", "line\n\"quoted\" \\ µ").set("m", true));
  const Value back = parse_json(json, "a");
  EXPECT_EQ((*back.if_object())[0].first, "z");
  EXPECT_EQ(*back.find("a")->if_text(), "line\n\"quoted\" \\ µ");
  EXPECT_EQ(to_json(back), json);
}

TEST(Value, ANumberBeyondDoubleIsRefused) {
  EXPECT_THROW(parse_json("{\"a\": 1e999}", "a.json"), InputError);
  EXPECT_THROW(parse_json("[-0.1e400]", "a.json"), InputError);
}

TEST(Value, NanHasNoJson) {
  EXPECT_THROW(to_json(Value(std::nan(""))), std::logic_error);
  EXPECT_THROW(to_json(Value(HUGE_VAL)), std::logic_error);
}

TEST(Value, ABrokenDocumentIsNamedWithItsLine) {
  EXPECT_THAT(message_of<InputError>([] { parse_json("{\n\"a\": 1,\n}", "scan.json"); }),
              AllOf(HasSubstr("scan.json"), HasSubstr("line 3")));
  EXPECT_THAT(message_of<InputError>([] { parse_toml("a = 1\nb = \n", "plan.toml"); }),
              AllOf(HasSubstr("plan.toml"), HasSubstr("line 2")));
}

TEST(Value, ADocumentNestedWithoutEndIsRefused) {
  // The readers recurse: two million levels were a broken stack.
  const std::string deep = std::string(2'000'000, '[') + std::string(2'000'000, ']');
  EXPECT_THAT(message_of<InputError>([&] { parse_json(deep, "a.json"); }), HasSubstr("nested deeper than"));
  EXPECT_NO_THROW(parse_json("{\"words\": \"" + std::string(1000, '[') + "\\\"[\"}", "a.json"));

  std::string keys;
  for (int k = 0; k < 200'000; ++k) keys += "\"" + std::to_string(k) + "\": {\"a\": 1}, ";
  EXPECT_THAT(message_of<InputError>([&] { parse_json("{" + keys + "\"a\": 1}", "a.json"); }),
              HasSubstr("a.json: an object with more than 10000 keys"));
  std::string objects;  // as many in all, few in each
  for (int k = 0; k < 20'000; ++k) objects += "{\"a\": 1, \"b\": {\"c\": 2}}, ";
  EXPECT_NO_THROW(parse_json("[" + objects + "1]", "a.json"));

  std::string dots;
  for (int k = 0; k < 100'000; ++k) dots += "a.";
  // A table per dot; a text that ends in quotes of its own must not hide the key behind it.
  for (const std::string& toml :
       {"[" + dots + "a]\n", dots + "a = 1\n", "b = {" + dots + "a = 1}\n", "b = \"\"\"x\"\"\"\"\n[" + dots + "a]\n"}) {
    EXPECT_THAT(message_of<InputError>([&] { parse_toml(toml, "a.toml"); }), HasSubstr("a.toml: a key with more than"));
  }
  EXPECT_NO_THROW(parse_toml("a = '" + dots + "'  # " + dots + "\nb = \"\\\"" + dots + "\"\nc = \"\"\"" + dots +
                                 "\"\"\"\nd = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]\n",
                             "a.toml"));
}

TEST(Fields, AnUnknownKeyIsRefusedByNameAndPlace) {
  Fields fields = fields_of("a = 1\n[board]\nb = 2\nc = 3\n");
  EXPECT_EQ(fields.integer("a"), 1);
  Fields board = fields.table("board");
  EXPECT_EQ(board.integer("b"), 2);
  fields.finish();
  EXPECT_THAT(message_of<InputError>([&] { board.finish(); }), AllOf(HasSubstr("plan.toml: board"), HasSubstr("'c'")));
  board.ignore("c");
  board.finish();
}

TEST(Fields, ARenamedKeyIsRefusedWithItsNewName) {
  Fields fields = fields_of("pitch = 1.0\n");
  EXPECT_THAT(message_of<InputError>([&] { fields.refuse_renamed("pitch", "pitch_mm"); }),
              AllOf(HasSubstr("'pitch'"), HasSubstr("'pitch_mm'")));
}

TEST(Fields, AWrongKindIsRefusedWithWhatWasFound) {
  Fields fields = fields_of("t = \"x\"\nr = 1.5\ni = 2\nl = [1, \"x\"]\nn = nan\n");
  EXPECT_THAT(message_of<InputError>([&] { fields.number("t"); }), AllOf(HasSubstr("'t'"), HasSubstr("a text")));
  EXPECT_THAT(message_of<InputError>([&] { fields.integer("r"); }), HasSubstr("whole number"));
  EXPECT_THAT(message_of<InputError>([&] { fields.text("i"); }), HasSubstr("a whole number"));
  EXPECT_THAT(message_of<InputError>([&] { fields.numbers("l"); }), HasSubstr("'l'"));
  EXPECT_THAT(message_of<InputError>([&] { fields.number("n"); }), HasSubstr("finite"));
  EXPECT_THAT(message_of<InputError>([&] { fields.number("missing"); }), HasSubstr("'missing' is missing"));
  EXPECT_EQ(fields.number("i"), 2.0);
  EXPECT_FALSE(fields.optional_number("absent").has_value());
}

TEST(Sha256, AgreesWithTheStandardsExample) {
  // FIPS 180-4, example of one block: "abc".
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(WriteAtomically, ReplacesTheOldFileAndLeavesNoOther) {
  const TemporaryFolder folder;
  write_atomically(folder / "sub/a.txt", "one");
  write_atomically(folder / "sub/a.txt", "two");
  EXPECT_EQ(read_bytes(folder / "sub/a.txt"), "two");
  EXPECT_EQ(entries_in(folder / "sub"), 1u);
}

TEST(WriteAtomically, AFolderThatCannotBeIsTheMachinesFault) {
  const TemporaryFolder folder;
  folder.write("file", "x");
  EXPECT_THAT(message_of<EnvironmentError>([&] { write_atomically(folder / "file/a.txt", "one"); }),
              HasSubstr("cannot be written"));
}

// The names are those that write_atomically() and FolderTransaction give to what they have not finished.
TEST(RemoveUnfinished, TakesWhatAKilledProgramLeftAndNothingElse) {
  const TemporaryFolder folder;
  for (const char* kept : {"a.json", "deep/a.json", "a.part", "a.12x.part", "12.part", "a.12.partial"}) {
    write_atomically(folder / kept, "kept");
  }
  for (const char* left : {"a.json.4711.part", "deep/b.png.1.part", "deep/pose.99.part/c.png"}) {
    write_atomically(folder / left, "left");
  }
  remove_unfinished(folder.path());
  EXPECT_EQ(entries_in(folder.path()), 6u);
  EXPECT_EQ(entries_in(folder / "deep"), 1u);
  remove_unfinished(folder / "nothing there");
}

TEST(ReadBytes, NamesAMissingFileAndAFolder) {
  const TemporaryFolder folder;
  EXPECT_THAT(message_of<InputError>([&] { read_bytes(folder / "a"); }), HasSubstr("no such file"));
  EXPECT_THAT(message_of<InputError>([&] { read_bytes(folder.path()); }), HasSubstr("this is a folder"));
}

TEST(FolderTransaction, WithoutCommitNothingStays) {
  const TemporaryFolder folder;
  {
    const FolderTransaction transaction(folder / "out");
    write_atomically(transaction.working() / "a", "x");
  }
  EXPECT_EQ(entries_in(folder.path()), 0u);
}

TEST(FolderTransaction, CommitReplacesTheOldFolderWhole) {
  const TemporaryFolder folder;
  write_atomically(folder / "out/old", "x");
  FolderTransaction transaction(folder / "out/");
  write_atomically(transaction.working() / "new", "y");
  EXPECT_EQ(entries_in(folder / "out"), 1u);
  transaction.commit();
  EXPECT_EQ(read_bytes(folder / "out/new"), "y");
  EXPECT_EQ(entries_in(folder / "out"), 1u);
  EXPECT_EQ(entries_in(folder.path()), 1u);
}

}  // namespace
}  // namespace fringecal

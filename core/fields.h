// Fields: strict reading of one table of a document. Every key must be asked for, or finish() refuses it by name; every
// complaint carries the file and the path of the key.
//
//   Fields board(read_toml(file), file.string());
//   const double pitch_mm = board.number("pitch_mm");
//   const int columns = board.integer("columns");
//   const auto bow_mm = board.optional_number("bow_mm");
//   board.finish();   // an unknown key is an error
//
// All throw InputError.
#pragma once

#include "core/value.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace fringecal {

class Fields {
 public:
  /// file: used in messages only. path: where in the file this table stands ("" for the whole).
  Fields(Value table, std::string file, std::string path = "");

  bool has(std::string_view key) const;
  double number(std::string_view key);
  int integer(std::string_view key);
  bool boolean(std::string_view key);
  std::string text(std::string_view key);
  std::optional<double> optional_number(std::string_view key);
  std::optional<int> optional_integer(std::string_view key);
  std::optional<bool> optional_boolean(std::string_view key);
  std::optional<std::string> optional_text(std::string_view key);
  /// count: the number of elements that must be there; 0 for any.
  std::vector<double> numbers(std::string_view key, std::size_t count = 0);
  std::vector<std::string> texts(std::string_view key);
  Fields table(std::string_view key);
  std::optional<Fields> optional_table(std::string_view key);
  /// The tables of an array of tables; empty where the key is absent.
  std::vector<Fields> tables(std::string_view key);
  /// The value of a key as it stands; null where the key is absent.
  Value raw(std::string_view key);
  /// Marks a key as known without reading it (free content such as a device's own notes).
  void ignore(std::string_view key);

  /// Checks `schema` and `schema_version` of a file that we wrote.
  void expect_schema(std::string_view schema, int newest_version);
  /// A key that has a new name: a file that still has the old one is refused with the new name in the sentence.
  void refuse_renamed(std::string_view old_key, std::string_view new_key);
  /// Refuses the keys that nobody asked for.
  void finish() const;

  /// An InputError about this table: "FILE: PATH: sentence".
  [[noreturn]] void complain(const std::string& sentence) const;
  const std::string& file() const { return file_; }

 private:
  const Value* take(std::string_view key);
  const Value& must(std::string_view key);
  std::string path_of(std::string_view key) const;

  Value table_;
  std::string file_, path_;
  std::vector<std::string> known_;
};

}  // namespace fringecal

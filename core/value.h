// Value: a document tree, the same for JSON and TOML. The readers and writers of all our files stand on it, so that no
// parser's type leaves core/value.cpp.
//
// Numbers keep their kind (integer or real). Reals are written with the fewest digits that read back to the same
// double; keys keep the order in which they were set, so the same content gives the same bytes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace fringecal {

class Value {
 public:
  using Array = std::vector<Value>;
  using Object = std::vector<std::pair<std::string, Value>>;

  Value() = default;  // null
  Value(bool b) : data_(b) {}
  Value(double d) : data_(d) {}
  Value(int i) : data_(static_cast<std::int64_t>(i)) {}
  Value(std::int64_t i) : data_(i) {}
  Value(std::size_t i) : data_(static_cast<std::int64_t>(i)) {}
  Value(const char* s) : data_(std::string(s)) {}
  Value(std::string s) : data_(std::move(s)) {}
  Value(Array a) : data_(std::move(a)) {}
  Value(Object o) : data_(std::move(o)) {}
  /// An array of numbers from any range of doubles (Eigen vectors, std::vector, std::array).
  template <class Range>
  static Value numbers(const Range& range) {
    Array out;
    for (const double x : range) out.emplace_back(x);
    return Value(std::move(out));
  }
  static Value object() { return Value(Object{}); }
  static Value array() { return Value(Array{}); }

  bool is_null() const { return std::holds_alternative<std::monostate>(data_); }
  const bool* if_bool() const { return std::get_if<bool>(&data_); }
  const std::int64_t* if_integer() const { return std::get_if<std::int64_t>(&data_); }
  const double* if_real() const { return std::get_if<double>(&data_); }
  const std::string* if_text() const { return std::get_if<std::string>(&data_); }
  const Array* if_array() const { return std::get_if<Array>(&data_); }
  const Object* if_object() const { return std::get_if<Object>(&data_); }

  /// Sets or replaces a key of an object (a null value becomes an object).
  Value& set(std::string_view key, Value value);
  /// Appends to an array (a null value becomes an array).
  Value& append(Value value);
  /// The value at a key of an object, or nullptr.
  const Value* find(std::string_view key) const;

 private:
  std::variant<std::monostate, bool, std::int64_t, double, std::string, Array, Object> data_;
};

/// Reads a document; the file's name ending does not matter. Throws InputError naming file, line and what is wrong.
Value read_json(const std::filesystem::path& file);
Value read_toml(const std::filesystem::path& file);
Value parse_toml(std::string_view text, const std::string& name_in_messages);
Value parse_json(std::string_view text, const std::string& name_in_messages);

/// Text for people and machines: two-space indentation, arrays of plain values on one line, newline at the end.
/// NaN and infinity have no JSON form: std::logic_error (a result without a value is left out, or null).
std::string to_json(const Value& value);

}  // namespace fringecal

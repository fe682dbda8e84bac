#include "core/fields.h"

#include "core/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace fringecal {
namespace {

std::string kind_of(const Value& v) {
  if (v.if_bool()) return "true or false";
  if (v.if_integer()) return "a whole number";
  if (v.if_real()) return "a number";
  if (v.if_text()) return "a text";
  if (v.if_array()) return "a list";
  if (v.if_object()) return "a table";
  return "nothing (null)";
}

std::optional<double> number_in(const Value& v) {
  if (const auto* i = v.if_integer()) return static_cast<double>(*i);
  if (const auto* d = v.if_real(); d && std::isfinite(*d)) return *d;
  return std::nullopt;
}

}  // namespace

Fields::Fields(Value table, std::string file, std::string path)
    : table_(std::move(table)), file_(std::move(file)), path_(std::move(path)) {
  if (!table_.if_object()) complain("expected a table with keys, found " + kind_of(table_));
}

void Fields::complain(const std::string& sentence) const {
  throw InputError(path_.empty() ? fmt::format("{}: {}", file_, sentence)
                                 : fmt::format("{}: {}: {}", file_, path_, sentence));
}

std::string Fields::path_of(std::string_view key) const {
  return path_.empty() ? std::string(key) : fmt::format("{}.{}", path_, key);
}

bool Fields::has(std::string_view key) const { return table_.find(key) != nullptr; }

const Value* Fields::take(std::string_view key) {
  known_.emplace_back(key);
  const Value* v = table_.find(key);
  return v && !v->is_null() ? v : nullptr;
}

const Value& Fields::must(std::string_view key) {
  const Value* v = take(key);
  if (!v) complain(fmt::format("the key '{}' is missing; add it", key));
  return *v;
}

Value Fields::raw(std::string_view key) {
  const Value* v = take(key);
  return v ? *v : Value();
}

void Fields::ignore(std::string_view key) { known_.emplace_back(key); }

double Fields::number(std::string_view key) {
  const Value& v = must(key);
  const auto n = number_in(v);
  if (!n) complain(fmt::format("'{}' must be a finite number, found {}", key, kind_of(v)));
  return *n;
}

int Fields::integer(std::string_view key) {
  const Value& v = must(key);
  const auto* i = v.if_integer();
  if (!i || *i < std::numeric_limits<int>::min() || *i > std::numeric_limits<int>::max()) {
    complain(fmt::format("'{}' must be a whole number, found {}", key, kind_of(v)));
  }
  return static_cast<int>(*i);
}

bool Fields::boolean(std::string_view key) {
  const Value& v = must(key);
  const auto* b = v.if_bool();
  if (!b) complain(fmt::format("'{}' must be true or false, found {}", key, kind_of(v)));
  return *b;
}

std::string Fields::text(std::string_view key) {
  const Value& v = must(key);
  const auto* s = v.if_text();
  if (!s) complain(fmt::format("'{}' must be a text, found {}", key, kind_of(v)));
  return *s;
}

std::optional<double> Fields::optional_number(std::string_view key) {
  return take(key) ? std::optional(number(key)) : std::nullopt;
}
std::optional<int> Fields::optional_integer(std::string_view key) {
  return take(key) ? std::optional(integer(key)) : std::nullopt;
}
std::optional<bool> Fields::optional_boolean(std::string_view key) {
  return take(key) ? std::optional(boolean(key)) : std::nullopt;
}
std::optional<std::string> Fields::optional_text(std::string_view key) {
  return take(key) ? std::optional(text(key)) : std::nullopt;
}

std::vector<double> Fields::numbers(std::string_view key, std::size_t count) {
  const Value& v = must(key);
  const auto* array = v.if_array();
  if (!array) complain(fmt::format("'{}' must be a list of numbers, found {}", key, kind_of(v)));
  if (count > 0 && array->size() != count) {
    complain(fmt::format("'{}' must have {} numbers, found {}", key, count, array->size()));
  }
  std::vector<double> out;
  for (const auto& element : *array) {
    const auto n = number_in(element);
    if (!n) complain(fmt::format("'{}' must hold finite numbers only, found {}", key, kind_of(element)));
    out.push_back(*n);
  }
  return out;
}

std::vector<std::string> Fields::texts(std::string_view key) {
  const Value& v = must(key);
  const auto* array = v.if_array();
  if (!array) complain(fmt::format("'{}' must be a list of texts, found {}", key, kind_of(v)));
  std::vector<std::string> out;
  for (const auto& element : *array) {
    if (!element.if_text()) complain(fmt::format("'{}' must hold texts only, found {}", key, kind_of(element)));
    out.push_back(*element.if_text());
  }
  return out;
}

Fields Fields::table(std::string_view key) { return Fields(must(key), file_, path_of(key)); }

std::optional<Fields> Fields::optional_table(std::string_view key) {
  return take(key) ? std::optional(table(key)) : std::nullopt;
}

std::vector<Fields> Fields::tables(std::string_view key) {
  std::vector<Fields> out;
  const Value* v = take(key);
  if (!v) return out;
  const auto* array = v->if_array();
  if (!array) complain(fmt::format("'{}' must be a list of tables, found {}", key, kind_of(*v)));
  for (std::size_t i = 0; i < array->size(); ++i) {
    out.emplace_back((*array)[i], file_, fmt::format("{}[{}]", path_of(key), i));
  }
  return out;
}

void Fields::expect_schema(std::string_view schema, int newest_version) {
  const auto found = optional_text("schema");
  if (!found || *found != schema) {
    complain(fmt::format("this is not a {} file (schema is '{}'); give the right file", schema, found.value_or("")));
  }
  const int version = integer("schema_version");
  if (version < 1 || version > newest_version) {
    complain(fmt::format("schema_version {} of {} is not known to this program (newest {}); use a newer fringecal",
                         version, schema, newest_version));
  }
}

void Fields::refuse_renamed(std::string_view old_key, std::string_view new_key) {
  if (has(old_key)) complain(fmt::format("the key '{}' is now called '{}'; rename it", old_key, new_key));
}

void Fields::finish() const {
  for (const auto& [key, value] : *table_.if_object()) {
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) {
      complain(fmt::format("the key '{}' is not known here; remove it or correct its spelling", key));
    }
  }
}

}  // namespace fringecal

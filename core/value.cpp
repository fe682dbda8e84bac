#include "core/value.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <toml++/toml.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>

namespace fringecal {
namespace {

Value from(const nlohmann::ordered_json& j) {
  if (j.is_boolean()) return Value(j.get<bool>());
  if (j.is_number_integer()) return Value(j.get<std::int64_t>());
  if (j.is_number_float()) return Value(j.get<double>());
  if (j.is_string()) return Value(j.get<std::string>());
  if (j.is_array()) {
    Value out = Value::array();
    for (const auto& element : j) out.append(from(element));
    return out;
  }
  if (j.is_object()) {
    Value out = Value::object();
    for (const auto& [key, element] : j.items()) out.set(key, from(element));
    return out;
  }
  return Value();
}

Value from(const toml::node& node) {
  if (const auto* b = node.as_boolean()) return Value(b->get());
  if (const auto* i = node.as_integer()) return Value(static_cast<std::int64_t>(i->get()));
  if (const auto* d = node.as_floating_point()) return Value(d->get());
  if (const auto* s = node.as_string()) return Value(s->get());
  if (const auto* array = node.as_array()) {
    Value out = Value::array();
    for (const auto& element : *array) out.append(from(element));
    return out;
  }
  if (const auto* table = node.as_table()) {
    Value out = Value::object();
    for (const auto& [key, element] : *table) out.set(key.str(), from(element));
    return out;
  }
  // Dates and times have no place in our files; kept as the text that stands there.
  std::ostringstream text;
  if (const auto* date = node.as_date()) text << *date;
  if (const auto* time = node.as_time()) text << *time;
  if (const auto* moment = node.as_date_time()) text << *moment;
  return Value(text.str());
}

constexpr int kDeepest = 256;      // the readers recurse once per level
constexpr int kMostKeys = 10'000;  // of one object: each is looked for among those before it

/// Refuses what would break the stack or take for ever. Brackets and colons in strings do not count.
void refuse_endless(std::string_view json, const std::string& name) {
  std::vector<int> keys(1);  // of the object open at each level
  bool in_text = false;
  for (std::size_t k = 0; k < json.size(); ++k) {
    const char c = json[k];
    if (in_text) {
      if (c == '\\') ++k;
      if (c == '"') in_text = false;
    } else if (c == '"') {
      in_text = true;
    } else if (c == '[' || c == '{') {
      keys.push_back(0);
      if (keys.size() > kDeepest + 1) {
        throw InputError(fmt::format("{}: nested deeper than {}; no file of ours is", name, kDeepest));
      }
    } else if ((c == ']' || c == '}') && keys.size() > 1) {
      keys.pop_back();
    } else if (c == ':' && ++keys.back() > kMostKeys) {
      throw InputError(fmt::format("{}: an object with more than {} keys; no file of ours has one", name, kMostKeys));
    }
  }
}

constexpr int kMostDots = 8;  // in one key: each is a table in a table, to which toml++ sets no bound

/// The most dots in one key or number, those in texts and comments not counted.
int most_dots(std::string_view toml) {
  int dots = 0, most = 0;
  for (std::size_t k = 0; k < toml.size(); ++k) {
    const char c = toml[k];
    if (c == '#') {
      k = std::min(toml.find('\n', k), toml.size());
      dots = 0;
    } else if (c == '"' || c == '\'') {
      const std::string_view thrice = c == '"' ? R"(""")" : "'''";
      const std::string_view end = toml.substr(k).starts_with(thrice) ? thrice : thrice.substr(0, 1);
      for (k += end.size(); k < toml.size() && !toml.substr(k).starts_with(end); ++k) {
        if (c == '"' && toml[k] == '\\') ++k;
      }
      k += end.size() - 1;
      if (end.size() == 3) {  // up to two quotes more belong to the text
        for (int more = 0; more < 2 && k + 1 < toml.size() && toml[k + 1] == c; ++more) ++k;
      }
    } else if (c == '.') {
      most = std::max(most, ++dots);
    } else if (std::string_view("\n,=[]{}").find(c) != std::string_view::npos) {
      dots = 0;
    }
  }
  return most;
}

bool is_plain(const Value& v) { return !v.if_array() && !v.if_object(); }

void write(const Value& v, int depth, std::string& out) {
  const std::string inner(2 * (depth + 1), ' '), outer(2 * depth, ' ');
  if (v.is_null()) {
    out += "null";
  } else if (const auto* b = v.if_bool()) {
    out += *b ? "true" : "false";
  } else if (const auto* i = v.if_integer()) {
    out += fmt::format("{}", *i);
  } else if (const auto* d = v.if_real()) {
    require(std::isfinite(*d), "a number written to JSON is finite");
    std::string text = fmt::format("{}", *d);  // shortest form that reads back to the same double
    if (text.find_first_of(".e") == std::string::npos) text += ".0";
    out += text;
  } else if (const auto* s = v.if_text()) {
    out += nlohmann::json(*s).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  } else if (const auto* array = v.if_array()) {
    bool plain = true;
    for (const auto& element : *array) plain = plain && is_plain(element);
    out += '[';
    for (std::size_t k = 0; k < array->size(); ++k) {
      if (k > 0) out += plain ? ", " : ",";
      if (!plain) out += "\n" + inner;
      write((*array)[k], depth + 1, out);
    }
    if (!plain && !array->empty()) out += "\n" + outer;
    out += ']';
  } else if (const auto* object = v.if_object()) {
    out += '{';
    for (std::size_t k = 0; k < object->size(); ++k) {
      out += (k > 0 ? ",\n" : "\n") + inner;
      write(Value((*object)[k].first), depth + 1, out);
      out += ": ";
      write((*object)[k].second, depth + 1, out);
    }
    if (!object->empty()) out += "\n" + outer;
    out += '}';
  }
}

}  // namespace

Value& Value::set(std::string_view key, Value value) {
  if (is_null()) data_ = Object{};
  auto* object = std::get_if<Object>(&data_);
  require(object != nullptr, "a key is set on an object");
  for (auto& [name, old] : *object) {
    if (name == key) {
      old = std::move(value);
      return *this;
    }
  }
  object->emplace_back(std::string(key), std::move(value));
  return *this;
}

Value& Value::append(Value value) {
  if (is_null()) data_ = Array{};
  auto* array = std::get_if<Array>(&data_);
  require(array != nullptr, "a value is appended to an array");
  array->push_back(std::move(value));
  return *this;
}

const Value* Value::find(std::string_view key) const {
  if (const auto* object = if_object()) {
    for (const auto& [name, value] : *object) {
      if (name == key) return &value;
    }
  }
  return nullptr;
}

Value parse_json(std::string_view text, const std::string& name) {
  refuse_endless(text, name);
  try {
    return from(nlohmann::ordered_json::parse(text));
  } catch (const nlohmann::json::parse_error& e) {
    const std::size_t end = std::min(e.byte, text.size());
    const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(end), '\n');
    throw InputError(fmt::format("{}: line {} is not valid JSON; restore the file or make it again", name, line));
  } catch (const nlohmann::json::exception&) {  // "1e999"
    throw InputError(fmt::format("{}: a number in it is beyond what can be computed with; correct it there", name));
  }
}

Value parse_toml(std::string_view text, const std::string& name) {
  if (most_dots(text) > kMostDots) {
    throw InputError(fmt::format("{}: a key with more than {} dots; no file of ours has one", name, kMostDots));
  }
  try {
    return from(toml::parse(text, std::string_view(name)));
  } catch (const toml::parse_error& e) {
    throw InputError(fmt::format("{}: line {}, column {}: {}; correct the TOML there", name, e.source().begin.line,
                                 e.source().begin.column, std::string(e.description())));
  }
}

Value read_json(const std::filesystem::path& file) { return parse_json(read_bytes(file), file.string()); }
Value read_toml(const std::filesystem::path& file) { return parse_toml(read_bytes(file), file.string()); }

std::string to_json(const Value& value) {
  std::string out;
  write(value, 0, out);
  out += '\n';
  return out;
}

}  // namespace fringecal

#include "metrology/history_series.h"

#include "core/error.h"
#include "metrology/instrument_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <tuple>

namespace fringecal::metrology {
namespace {

constexpr std::string_view kTemperature = "temperature", kRoom = "room";

/// What stands after "KEY": on the first line of that depth, without the comma; empty where there is none.
std::string_view line_of(std::string_view text, int depth, std::string_view key) {
  const std::string begin = fmt::format("\n{:{}}\"{}\": ", "", 2 * depth, key);
  const auto at = text.find(begin);
  if (at == std::string_view::npos) return {};
  auto rest = text.substr(at + begin.size());
  rest = rest.substr(0, rest.find('\n'));
  if (!rest.empty() && rest.back() == ',') rest.remove_suffix(1);
  return rest;
}

/// A JSON text as it reads. Escapes are rare enough to leave them to the parser.
std::string text_from(std::string_view json) {
  if (json.size() < 2 || json.front() != '"') return {};
  if (json.find('\\') == std::string_view::npos) return std::string(json.substr(1, json.size() - 2));
  const Value list = parse_json(fmt::format("[{}]", json), "history");
  const auto* text = list.if_array()->front().if_text();
  return text == nullptr ? "" : *text;
}

std::optional<double> number_from(std::string_view json) {
  double out = 0;
  const auto [end, error] = std::from_chars(json.data(), json.data() + json.size(), out);
  if (error != std::errc() || end != json.data() + json.size()) return std::nullopt;
  return out;
}

/// The lines of each quantity, from the blank before its first key to its end.
template <class Visit>
void each_quantity(std::string_view document, const Visit& visit) {
  const auto begin = document.find("\n  \"quantities\": [\n");
  if (begin == std::string_view::npos) return;
  auto rest = document.substr(begin + 1);
  rest = rest.substr(0, rest.find("\n  ]"));
  for (std::size_t at = rest.find("\n    {\n"); at != std::string_view::npos;) {
    const std::size_t end = rest.find("\n    }", at);
    visit(rest.substr(at + 6, end == std::string_view::npos ? end : end - at - 6));
    at = end == std::string_view::npos ? end : rest.find("\n    {\n", end);
  }
}

/// The quantity of the key among those of one document, found by its symbol's line first: most lines are another's.
std::string_view wanted_of(std::string_view document, const QuantityKey& key, std::string_view symbol_line) {
  std::string_view found;
  double largest = 0;
  for (auto at = document.find(symbol_line); at != std::string_view::npos; at = document.find(symbol_line, at + 1)) {
    const auto lines = document.substr(at, document.find("\n    }", at) - at);
    if (text_from(line_of(lines, 3, "artefact")) != key.artefact) continue;
    if (key.position && text_from(line_of(lines, 3, "position")) != *key.position) continue;
    const auto value = number_from(line_of(lines, 3, "value"));
    if (!value) continue;
    if (found.empty() || std::abs(*value) > largest) {
      found = lines;
      largest = std::abs(*value);
    }
  }
  return found;
}

[[noreturn]] void complain(const HistoryView& entry, const char* what) {
  throw InputError(fmt::format("history, entry {}: {}; \"fringecal history check\" says whether it was altered",
                               entry.number, what));
}

double day_of(const HistoryView& entry) {
  const std::string ended = text_from(line_of(entry.document, 1, "ended"));
  if (ended.empty()) complain(entry, "it does not say when it ended");
  return metrology::day_of(ended);
}

/// The temperature that a verification states; an instrument's record has it among its quantities.
std::optional<double> verification_temperature(const HistoryView& entry) {
  return number_from(line_of(entry.document, 2, "temperature_degC"));
}

bool has_quantities(std::string_view kind) {
  return kind == "verification" || kind == "alignment" || kind == "calibration";
}

}  // namespace

Verification verification_of(const HistoryEntry& entry) {
  const std::string name = fmt::format("history, entry {}", entry.number);
  return verification_from(parse_json(entry.document, name), name);
}

HistorySeries series_of(const History& history, const QuantityKey& asked) {
  HistorySeries out;
  const bool temperature =
      asked.symbol == kTemperature && (asked.artefact == kRoom || asked.artefact == kScannerItself);
  QuantityKey key = asked;
  if (temperature) key.artefact = kScannerItself;
  const std::string symbol_line = fmt::format("\n      \"symbol\": {},", [&] {
    std::string json = to_json(Value(key.symbol));
    json.pop_back();  // the line break at the end of a document
    return json;
  }());
  history.each([&](const HistoryView& entry) {
    if (!has_quantities(entry.kind)) return;
    const auto add = [&](double value, std::optional<double> U) {
      out.values.push_back({day_of(entry), value});
      out.numbers.push_back(entry.number);
      out.U.push_back(U);
    };
    if (temperature && entry.kind == "verification") {
      const auto degC = verification_temperature(entry);
      if (degC) add(*degC, {});
      out.name = "temperature";
      out.unit = "degC";
      return;
    }
    const auto lines = wanted_of(entry.document, key, symbol_line);
    if (lines.empty()) return;
    add(*number_from(line_of(lines, 3, "value")), number_from(line_of(lines, 4, "U")));
    out.unit = text_from(line_of(lines, 3, "unit"));
    out.name = text_from(line_of(lines, 3, "name"));
    const auto lower = number_from(line_of(lines, 3, "lower_limit")),
               upper = number_from(line_of(lines, 3, "upper_limit"));
    out.limits = lower || upper ? std::optional(Limits{lower, upper}) : std::nullopt;
  });
  return out;
}

std::vector<QuantityKey> quantities_of(const History& history) {
  std::vector<QuantityKey> out;
  std::set<std::pair<std::string, std::string>, std::less<>> known;
  const auto add = [&](std::string_view symbol, std::string_view artefact) {
    if (known.emplace(symbol, artefact).second) out.push_back({text_from(symbol), text_from(artefact), std::nullopt});
  };
  bool temperature = false;
  history.each([&](const HistoryView& entry) {
    if (!has_quantities(entry.kind)) return;
    each_quantity(entry.document, [&](std::string_view lines) {
      const auto symbol = line_of(lines, 3, "symbol");
      if (symbol == "\"temperature\"") {
        temperature = true;
      } else {
        add(symbol, line_of(lines, 3, "artefact"));
      }
    });
    temperature = temperature || (entry.kind == "verification" && verification_temperature(entry));
  });
  if (temperature) out.push_back({std::string(kTemperature), std::string(kRoom), std::nullopt});
  return out;
}

std::string summary_of(const HistoryView& entry) {
  const auto text = [&](std::string_view key) { return text_from(line_of(entry.document, 1, key)); };
  if (entry.kind == "verification") {
    const std::string verdict = text("verdict");
    return fmt::format("{}, {}: {}", text("plan"), text("scanner"), verdict.empty() ? "no limits" : verdict);
  }
  if (entry.kind == "certificate") return fmt::format("No. {}", text("number"));
  if (!has_quantities(entry.kind)) return "";
  return fmt::format("{}: {}", text("scanner"), text("outcome"));
}

}  // namespace fringecal::metrology

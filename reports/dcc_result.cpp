#include "reports/dcc_result.h"

#include "core/error.h"

#include <algorithm>
#include <charconv>
#include <string_view>

namespace fringecal::reports {
namespace {

bool has_type(const XmlNode& node, std::string_view type) {
  const std::string types = " " + node.attribute("refType") + " ";
  return types.find(" " + std::string(type) + " ") != std::string::npos;
}

std::optional<std::string> limit(const XmlNode& quantity, std::string_view type) {
  for (const auto& one : quantity.below("quantity")) {
    if (!has_type(one, type)) continue;
    if (const auto real = one.child("real")) return real->text_of("value");
  }
  return std::nullopt;
}

DccResult result_of(const XmlNode& quantity) {
  DccResult out;
  out.name = quantity.text_of("name");
  if (const auto real = quantity.child("real")) {
    out.value = real->text_of("value");
    out.unit = real->text_of("unit");
    for (const auto& expanded : real->below("expandedMU")) {
      out.U = expanded.text_of("valueExpandedMU");
      out.k = expanded.text_of("coverageFactor");
    }
  }
  out.lower = limit(quantity, "fringecal_toleranceLimitLower");
  out.upper = limit(quantity, "fringecal_toleranceLimitUpper");
  return out;
}

/// "History: entry 12, hash 0a1b...": the number and the last word.
void read_entry(const std::string& words, DccMeasurement& out) {
  const auto digit = words.find_first_of("0123456789");
  const auto space = words.find_last_of(' ');
  if (digit == std::string::npos || space == std::string::npos) return;
  std::int64_t number = 0;
  std::from_chars(words.data() + digit, words.data() + words.size(), number);
  out.entry = number;
  out.entry_hash = words.substr(space + 1);
}

}  // namespace

std::string data_sha256_of(const XmlDocument& document) {
  for (const auto& statement : XmlNode::root(document).below("statement")) {
    if (!has_type(statement, "fringecal_data")) continue;
    const std::string words = statement.text_of("declaration");
    const auto end = words.find_last_not_of(" \t\r\n");
    const auto space = words.find_last_of(' ', end);
    if (end != std::string::npos && space != std::string::npos) return words.substr(space + 1, end - space);
  }
  return "";
}

std::vector<DccMeasurement> dcc_measurements(const XmlDocument& document) {
  std::vector<DccMeasurement> out;
  for (const auto& measurement : XmlNode::root(document).below("measurementResult")) {
    DccMeasurement one;
    for (const auto& quantity : measurement.below("quantity")) {
      if (has_type(quantity, "fringecal_result")) one.results.push_back(result_of(quantity));
    }
    for (const auto& meta : measurement.below("metaData")) {
      if (has_type(meta, "fringecal_record")) {
        for (const auto& data : meta.below("dataBase64")) one.record = from_base64(data.text()).value_or("");
      }
      if (has_type(meta, "fringecal_history")) {
        const auto declaration = meta.child("declaration");
        if (declaration) read_entry(declaration->text_of("content"), one);
      }
    }
    out.push_back(std::move(one));
  }
  return out;
}

std::optional<std::string> from_base64(const std::string& text) {
  std::string out;
  std::uint32_t word = 0;
  int bits = 0;
  bool ended = false;
  for (const char c : text) {
    if (c == ' ' || c == '\n' || c == '\r' || c == '\t') continue;
    static constexpr std::string_view kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    if (c == '=') {
      ended = true;
      continue;
    }
    const auto digit = kLetters.find(c);
    if (digit == std::string_view::npos || ended) return std::nullopt;
    word = word << 6 | static_cast<std::uint32_t>(digit);
    bits += 6;
    if (bits >= 8) {
      bits -= 8;
      out += static_cast<char>(word >> bits & 0xFFu);
    }
  }
  return out;
}

}  // namespace fringecal::reports
